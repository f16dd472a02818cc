"""The names and classes behind the ids of a frame."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError
from rigcast.sensors.faults import Fault, refuse
from rigcast.sensors.names import did_you_mean

Classes = Mapping[str, Sequence[str]]
"""Class name -> names of geoms and bodies; `*`, `?` and `[...]` match as in a shell."""


@dataclass(frozen=True)
class IdTable:
    """What the geom and body ids of a model stand for; row i is id i.

    `geom_name` (ngeom,) and `body_name` (nbody,) are strings, `geom_body` (ngeom,) int32 body ids, `geom_class`
    (ngeom,) int32 rows of `class_name`, whose row 0, "", is for geoms of no class.
    A geom or body without a name is called by kind and id: "geom_12", "body_3".
    """

    geom_name: NDArray[np.str_]
    geom_body: NDArray[np.int32]
    geom_class: NDArray[np.int32]
    body_name: NDArray[np.str_]
    class_name: NDArray[np.str_]

    @classmethod
    def of(cls, model: mujoco.MjModel, classes: Classes | None = None) -> "IdTable":
        """The table of a model.

        classes: a name stands for a geom, or for a body with all that is below it; a geom's own name counts
        before its body's, a body's before its parent's.

        Raises InputError for a name that the model does not have, or that two classes claim.
        """
        classes = {} if classes is None else classes
        refuse("classes", class_faults(model, classes))
        geom_names, body_names = _geom_names(model), _body_names(model)
        geom_body = np.array(model.geom_bodyid, dtype=np.int32)
        body_class = _body_classes(model, body_names, classes)
        own = (_class_of(name, classes) for name in geom_names)
        geom_class = [body_class[body] if k is None else k for k, body in zip(own, geom_body, strict=True)]
        return cls(
            geom_name=np.array(geom_names, dtype=np.str_),
            geom_body=geom_body,
            geom_class=np.array(geom_class, dtype=np.int32),
            body_name=np.array(body_names, dtype=np.str_),
            class_name=np.array(["", *classes], dtype=np.str_),
        )

    def lists(self) -> dict[str, list[str] | list[int]]:
        """The columns by name, as plain lists."""
        return {name: column.tolist() for name, column in vars(self).items()}

    def json(self) -> str:
        """The table as one JSON object of lists, in plain ASCII."""
        return json.dumps(self.lists())

    def class_of(self, geom_id: NDArray[np.int32]) -> NDArray[np.int32]:
        """(...) the class of each geom id; 0 where that is -1."""
        return np.where(geom_id >= 0, self.geom_class[geom_id], 0).astype(np.int32)


def class_faults(model: mujoco.MjModel, classes: Classes) -> list[Fault]:
    """What keeps `classes` from being those of a model: names that it lacks, things in two classes."""
    known = [*_geom_names(model), *_body_names(model)]
    unknown = [
        Fault((label, i), f"no geom or body {name!r} in the model{did_you_mean(name, known)}")
        for label, names in classes.items()
        for i, name in enumerate(names)
        if not any(fnmatchcase(other, name) for other in known)
    ]
    return unknown + [_disputed(name, classes) for name in dict.fromkeys(known) if len(_claims(name, classes)) > 1]


def require_few_classes(ids: IdTable, most: int, what: str) -> None:
    """Raise InputError where there are more classes than a format has numbers for."""
    if len(ids.class_name) - 1 > most:
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


def _geom_names(model: mujoco.MjModel) -> list[str]:
    return [model.geom(i).name or f"geom_{i}" for i in range(model.ngeom)]


def _body_names(model: mujoco.MjModel) -> list[str]:
    return [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
