"""Reflectance of surfaces, where the model's colours do not determine it."""

from collections.abc import Sequence

import mujoco
from pydantic import Field, model_validator

from rigcast.sensors.faults import Fault
from rigcast.sensors.names import expected_one_of, model_names

from .spec import Share, Spec

_OBJECTS = {
    "geom": (mujoco.mjtObj.mjOBJ_GEOM, "ngeom"),
    "material": (mujoco.mjtObj.mjOBJ_MATERIAL, "nmat"),
    "body": (mujoco.mjtObj.mjOBJ_BODY, "nbody"),
}


class Surface(Spec):
    """Reflectance of a geom, of everything with a material or on a body, or of a prop, at the sensors' wavelength.

    What no entry sets comes from the model: reflectivity is the luminance of the rgba (0.2126 r + 0.7152 g + 0.0722 b;
    textures are ignored), transmission is 1 - alpha, mirror is the `reflectance` of the material. The rgba is that in
    which MuJoCo draws it: the material's, unless the geom has its own. A prop has a reflectivity of 0.5, and neither
    transmits nor mirrors. Of several entries for one thing the last counts.
    """

    geom: str | None = Field(default=None, description="name of a geom")
    material: str | None = Field(default=None, description="name of a material: of geoms, flexes and skins")
    body: str | None = Field(default=None, description="name of a body: of its geoms, and of props mounted on it")
    prop: str | None = Field(default=None, description="name of a prop")
    reflectivity: float | None = Field(
        default=None,
        ge=0,
        description="share of the light reflected diffusely; above 1 for retro-reflectors",
    )
    transmission: Share | None = Field(default=None, description="share of the light transmitted")
    mirror: Share | None = Field(
        default=None, description="share of the light that is not transmitted which is reflected as by a mirror"
    )

    @model_validator(mode="after")
    def _one_owner(self) -> "Surface":
        given = [key for key in (*_OBJECTS, "prop") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of geom, material, body and prop, got {' and '.join(given) or 'none'}")
        return self

    def faults(self, model: mujoco.MjModel, props: Sequence[str]) -> list[Fault]:
        """Faults that prevent its use on `model` with props of these names: a name that does not exist."""
        if self.prop is not None:
            if self.prop in props:
                return []
            return [Fault(("prop",), f"no prop {self.prop!r}, {expected_one_of(self.prop, props)}")]
        key, name = next((key, getattr(self, key)) for key in _OBJECTS if getattr(self, key) is not None)
        kind, count = _OBJECTS[key]
        if mujoco.mj_name2id(model, kind, name) >= 0:
            return []
        names = model_names(model, kind, getattr(model, count))
        return [Fault((key,), f"no {key} {name!r} in the model, {expected_one_of(name, names)}")]
