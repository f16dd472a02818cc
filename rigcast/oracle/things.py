"""A common numbering of all objects that rays hit: geoms first, by MuJoCo's ids, then flexes, skins and props."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.oracle.ray import Ints
from rigcast.sensors.scene.parts.part import OWNERS, Owner
from rigcast.sensors.specs.prop import Prop

NOTHING = "none"  # the type for a ray that misses
_GEOM_TYPES = [mujoco.mjtGeom(k).name.removeprefix("mjGEOM_").lower() for k in range(int(mujoco.mjtGeom.mjNGEOMTYPES))]
TYPES = (NOTHING, *_GEOM_TYPES, "flex", "skin", "prop")


@dataclass(frozen=True)
class Things:
    """The objects that rays can hit.

    Thing i is of the kind `kinds[i]`, and `ids[i]`, `names[i]` (or None) and `types[i]` are its own id, name and type:
    that of a geom as MJCF writes it, or "flex", "skin", "prop".
    """

    kinds: tuple[Owner, ...]
    ids: tuple[int, ...]
    names: tuple[str | None, ...]
    types: tuple[str, ...]

    @classmethod
    def of(cls, model: mujoco.MjModel, props: Sequence[Prop] = ()) -> "Things":
        objects = mujoco.mjtObj
        names: dict[Owner, list[str | None]] = {
            "geom": [mujoco.mj_id2name(model, objects.mjOBJ_GEOM, k) for k in range(model.ngeom)],
            "flex": [mujoco.mj_id2name(model, objects.mjOBJ_FLEX, k) for k in range(model.nflex)],
            "skin": [mujoco.mj_id2name(model, objects.mjOBJ_SKIN, k) for k in range(model.nskin)],
            "prop": [prop.name for prop in props],
        }
        rows = [(kind, k, name or None) for kind in OWNERS for k, name in enumerate(names[kind])]
        kinds, ids, named = zip(*rows, strict=True) if rows else ((), (), ())
        geom_types = [_GEOM_TYPES[int(kind)] for kind in model.geom_type]
        return cls(kinds, ids, named, (*geom_types, *kinds[model.ngeom :]))

    def numbers(self, hits: Any) -> Ints:
        """Return (n,) the number of the object that each ray hit by a caster's answer, -1 for none, -2 for two at once.

        hits: an object with `geom_id`, and with `flex_id`, `skin_id` and `prop_id` where the caster knows these.
        """
        number = np.asarray(hits.geom_id, np.int32).reshape(-1)
        for kind in OWNERS[1:]:
            known = getattr(hits, f"{kind}_id", None)
            if known is None:
                continue
            ids = np.asarray(known, np.int32).reshape(-1)
            is_other = ids >= 0
            if not is_other.any():
                continue
            first = self.kinds.index(kind) if kind in self.kinds else len(self.kinds)
            number = np.where(is_other & (number != -1), -2, np.where(is_other, first + ids, number))
        return np.asarray(number, np.int32)

    def types_of(self, numbers: Ints) -> npt.NDArray[np.str_]:
        """Return (n,) the type of each of these objects, one of TYPES; NOTHING if it does not exist."""
        known = (numbers >= 0) & (numbers < len(self.types))
        return np.array([*self.types, NOTHING])[np.where(known, numbers, -1)]
