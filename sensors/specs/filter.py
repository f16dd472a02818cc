"""Which geoms a sensor's rays may hit."""

from collections.abc import Sequence
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from rigcast.sensors.faults import Fault, refuse
from rigcast.sensors.names import expected_one_of, model_names

from .spec import Integers, Spec, Takes, optional

_BODY = mujoco.mjtObj.mjOBJ_BODY


class Filter(Spec):
    """Which geoms rays may hit, on top of MuJoCo's rule that a fully transparent geom is never hit.

    Flexes and skins are treated like geoms, by their own groups; a skin does not collide. A flex or skin of several
    bodies is excluded, or static, if all of its bodies are.
    """

    geom_groups: Takes[Integers | None, Sequence[Annotated[int, Field(ge=0, le=5)]] | None] = optional(
        default=None, description="geom groups that may be hit, each 0 to 5; null: all of them"
    )
    static: bool = Field(default=True, description="whether geoms that cannot move may be hit")
    exclude_bodies: Sequence[str] = Field(default=(), description="bodies whose geoms are never hit")
    exclude_subtree: bool = Field(
        default=False, description="whether the descendants of exclude_bodies are never hit either"
    )
    geometry: Literal["all", "visual", "collision"] = Field(
        default="all",
        description="visual: geoms with contype and conaffinity 0; collision: the others",
    )

    @field_validator("geom_groups")
    @classmethod
    def _each_group_once(cls, groups: Sequence[int] | None) -> Sequence[int] | None:
        if groups is None or len(set(groups)) == len(groups):
            return groups
        flags = len(groups) == 6 and set(groups) <= {0, 1}
        meant = f"; six flags, as for mj_ray, would be {[i for i in range(6) if groups[i]]}" if flags else ""
        raise ValueError(f"must have each group at most once, got {list(groups)}{meant}")

    @model_validator(mode="after")
    def _subtree_of_something(self) -> "Filter":
        if self.exclude_subtree and not self.exclude_bodies:
            raise ValueError("exclude_subtree needs exclude_bodies, got no body")
        return self

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """Faults that prevent use of this filter on `model`: names of bodies that the model does not have."""
        unknown = [(i, body) for i, body in enumerate(self.exclude_bodies) if _body_id(model, body) < 0]
        if not unknown:
            return []
        names = model_names(model, _BODY, model.nbody)
        return [
            Fault(("exclude_bodies", i), f"no body {body!r} in the model, {expected_one_of(body, names)}")
            for i, body in unknown
        ]

    def visible(self, model: mujoco.MjModel) -> NDArray[np.bool_]:
        """(ngeom,) bool: True for geoms that rays may hit. Raises InputError for an unknown body."""
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        opaque = is_opaque(model, model.geom_rgba, model.geom_matid)
        return opaque & self.admits(model.geom_group, collides) & ~self.hidden_bodies(model)[model.geom_bodyid]

    def admits(self, group: NDArray[np.int32], collides: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which objects (n,) bool rays may hit by their groups and whether they collide, (n,) each."""
        # MuJoCo clamps groups in the same way (mj_ray, engine_ray.c).
        seen = np.isin(np.clip(group, 0, 5), range(6) if self.geom_groups is None else list(self.geom_groups))
        if self.geometry != "all":
            seen &= collides if self.geometry == "collision" else ~collides
        return seen

    def hidden_bodies(self, model: mujoco.MjModel) -> NDArray[np.bool_]:
        """Bodies (nbody,) bool whose geoms are never hit. Raises InputError for an unknown body."""
        refuse("Filter", self.faults(model))
        hidden = self._excluded(model)
        if not self.static:
            hidden |= model.body_weldid == 0
        return hidden

    def _excluded(self, model: mujoco.MjModel) -> NDArray[np.bool_]:
        """The excluded bodies (nbody,) bool: exclude_bodies, and their descendants with exclude_subtree."""
        excluded = np.zeros(model.nbody, bool)
        excluded[[_body_id(model, body) for body in self.exclude_bodies]] = True
        while self.exclude_subtree:
            grown = excluded | excluded[model.body_parentid]
            if (grown == excluded).all():
                break
            excluded = grown
        return excluded


def is_opaque(model: mujoco.MjModel, rgba: NDArray[np.float32], material: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether alpha is not 0, (n,) bool. The alpha is the material's if there is one, as in mj_ray."""
    alpha = rgba[:, 3].copy()
    has_material = material >= 0
    alpha[has_material] = model.mat_rgba[material[has_material], 3]
    return np.asarray(alpha != 0)


def _body_id(model: mujoco.MjModel, name: str) -> int:
    return int(mujoco.mj_name2id(model, _BODY, name))
