"""The names and classes behind the ids of a frame."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import chain
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import Fault, refuse
from rigcast.sensors.names import did_you_mean
from rigcast.sensors.specs.prop import Prop

Classes = Mapping[str, Sequence[str]]
"""Class name -> names of geoms, bodies, flexes, skins and props; `*`, `?` and `[...]` match as in a shell."""

_KINDS = ("geom", "flex", "skin", "prop")


@dataclass(frozen=True)
class IdTable:
    """The meaning of ids; row i is id i.

    For geoms, flexes, skins and props `geom_name` (n,) ... are strings and `geom_class` (n,) ... int32 rows of
    `class_name`, whose row 0, "", is for no class. `geom_body`, `prop_body` (n,) int32 are body ids, rows of
    `body_name`. What has no name is called by kind and id: "geom_12", "body_3".
    """

    geom_name: NDArray[np.str_]
    geom_body: NDArray[np.int32]
    geom_class: NDArray[np.int32]
    body_name: NDArray[np.str_]
    flex_name: NDArray[np.str_]
    flex_class: NDArray[np.int32]
    skin_name: NDArray[np.str_]
    skin_class: NDArray[np.int32]
    prop_name: NDArray[np.str_]
    prop_body: NDArray[np.int32]
    prop_class: NDArray[np.int32]
    class_name: NDArray[np.str_]

    @classmethod
    def of(cls, model: mujoco.MjModel, classes: Classes | None = None, props: Sequence[Prop] = ()) -> "IdTable":
        """The table of a model, and of the props beside it.

        classes: a name stands for a geom, flex, skin or prop, or for a body with all that is below it; a thing's
        own name counts before its body's, a body's before its parent's.

        Raises InputError for a name that nothing has, or that is in two classes, and for names that are not a list.
        """
        classes = _as_classes(classes)
        refuse("classes", class_faults(model, classes, props))
        names = _names(model, props)
        bodies = {"geom": model.geom_bodyid, "prop": [prop.mount.bind(model).body_id for prop in props]}
        body_class = _body_classes(model, names["body"], classes)
        columns: dict[str, NDArray[Any]] = {f"{kind}_name": _strings(names[kind]) for kind in names}
        columns |= {f"{kind}_body": np.array(ids, dtype=np.int32) for kind, ids in bodies.items()}
        for kind in _KINDS:
            inherited = [body_class[body] for body in bodies[kind]] if kind in bodies else [0] * len(names[kind])
            own = [_class_of(name, classes) for name in names[kind]]
            given = [i if o is None else o for i, o in zip(inherited, own, strict=True)]
            columns[f"{kind}_class"] = np.array(given, dtype=np.int32)
        return cls(**columns, class_name=_strings(["", *classes]))

    @classmethod
    def from_json(cls, text: str) -> "IdTable":
        """The table that `json` wrote."""
        lists: dict[str, list[Any]] = json.loads(text)
        kinds = {name: np.str_ if name.endswith("_name") else np.int32 for name in lists}
        columns: dict[str, NDArray[Any]] = {name: np.array(lists[name], kind) for name, kind in kinds.items()}
        return cls(**columns)

    def lists(self) -> dict[str, list[str] | list[int]]:
        """The columns by name, as plain lists."""
        return {name: column.tolist() for name, column in vars(self).items()}

    def json(self) -> str:
        """The table as one JSON object of lists, in plain ASCII."""
        return json.dumps(self.lists())

    def class_of(self, fields: Mapping[str, NDArray[Any]]) -> NDArray[np.int32]:
        """The class (...) of what each ray hit, from `geom_id` and the other ids in its fields; 0 for a miss."""
        classes = np.zeros(fields["geom_id"].shape, np.int32)
        for kind in _KINDS:
            ids = fields.get(f"{kind}_id")
            if ids is not None:
                hit = ids >= 0
                classes[hit] = getattr(self, f"{kind}_class")[ids[hit]]
        return classes


def _as_classes(given: Classes | None) -> Classes:
    if given is None:
        return {}
    require_type("classes", given, Mapping)
    for label, names in given.items():
        if isinstance(names, str) or not isinstance(names, Sequence):
            raise InputError(f"classes: {label}: got {names!r}, expected a list of names")
    return given


def class_faults(model: mujoco.MjModel, classes: Classes, props: Sequence[Prop]) -> list[Fault]:
    """Faults of `classes` for a model: names that nothing has, and objects in two classes."""
    known = list(chain.from_iterable(_names(model, props).values()))
    unknown = [
        Fault((label, i), f"no geom, body, flex, skin or prop {name!r}{did_you_mean(name, known)}")
        for label, names in classes.items()
        for i, name in enumerate(names)
        if not any(fnmatchcase(other, name) for other in known)
    ]
    return unknown + [_disputed(name, classes) for name in dict.fromkeys(known) if len(_claims(name, classes)) > 1]


def require_few_classes(ids: IdTable, most: int | None, what: str) -> None:
    """Raise InputError if there are more classes than a format can store; None: no limit."""
    if most is not None and len(ids.class_name) - 1 > most:
        raise InputError(f"{what} holds at most {most} classes, got {len(ids.class_name) - 1}")


def _disputed(name: str, classes: Classes) -> Fault:
    first, second, *_ = _claims(name, classes)
    return Fault((second,), f"{name!r} is in class {first!r} already, expected one class for each")


def _claims(name: str, classes: Classes) -> list[str]:
    return [label for label, patterns in classes.items() if any(fnmatchcase(name, p) for p in patterns)]


def _class_of(name: str, classes: Classes) -> int | None:
    claims = _claims(name, classes)
    return list(classes).index(claims[0]) + 1 if claims else None


def _body_classes(model: mujoco.MjModel, names: Sequence[str], classes: Classes) -> list[int]:
    """The class of each body: its own, else its parent's, else 0. Parents come before their children."""
    found: list[int] = []
    for body, name in enumerate(names):
        own = _class_of(name, classes)
        inherited = found[model.body_parentid[body]] if body else 0
        found.append(inherited if own is None else own)
    return found


def _names(model: mujoco.MjModel, props: Sequence[Prop]) -> dict[str, list[str]]:
    """The names of all objects by kind."""
    counts = {"geom": model.ngeom, "body": model.nbody, "flex": model.nflex, "skin": model.nskin}
    names = {kind: [_name(model, kind, i) for i in range(count)] for kind, count in counts.items()}
    return names | {"prop": [prop.name for prop in props]}


def _name(model: mujoco.MjModel, kind: str, i: int) -> str:
    return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) or f"{kind}_{i}"


def _strings(values: Sequence[str]) -> NDArray[np.str_]:
    return np.array(values, dtype=np.str_)
