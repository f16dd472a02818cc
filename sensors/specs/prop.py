"""Props: meshes that are not in the MuJoCo model."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import Fault
from rigcast.sensors.meshes import read_mesh
from rigcast.sensors.names import require_different

from .mount import Mount
from .spec import FilePath, Keys, Numbers, Spec, Takes, optional


def _as_scale(given: Any) -> Any:
    values = given if isinstance(given, tuple) else (given,)
    are_numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if len(values) not in (1, 3) or not are_numbers or not np.isfinite(values).all() or 0 in values:
        raise ValueError(f"must be one number or three, none of them 0, got {given!r}")
    return tuple(map(float, values)) if len(values) == 3 else float(values[0])


Scale = Annotated[float | tuple[float, float, float], BeforeValidator(_as_scale)]


class Prop(Spec):
    """A mesh that rays hit but that is not in the MuJoCo model, fixed to the world or carried by a body.

    A hit on a prop has its index in the list of props as `prop_id`, the mount's body as `body_id`, and `geom_id` -1. A
    filter excludes it with its body (`exclude_bodies`), and with `static=False` if the body cannot move. Geom groups,
    `geometry` and transparency do not apply to props.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$", description="unique name of the prop: letters, digits, _ and -")
    file: Takes[str | Path, FilePath] = Field(
        description="mesh file, .stl, .obj, .ply or .glb; in a rig file a path relative to it"
    )
    mount: Takes[Mount | Keys, Mount] = optional(
        default_factory=Mount, description="pose of the mesh's origin and axes"
    )
    scale: Takes[float | Numbers, Scale] = optional(
        default=1.0, description="factor on the file's coordinates: one number, or x, y, z"
    )
    allow_outside: bool = Field(default=False, description="whether a rig file may name a file outside its folder")

    def faults(self, model: mujoco.MjModel) -> list[Fault]:
        """Faults that prevent use of this prop on `model`: a mount that the model does not have."""
        return [fault.under("mount") for fault in self.mount.faults(model)]

    def triangles(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Vertices (n, 3) [m] in the mount's frame and faces (m, 3), outward as in the file even where mirrored.

        Raises InputError, as `read_mesh` does, with the prop's name.
        """
        try:
            vertices, faces = read_mesh(self.file)
        except InputError as error:
            raise InputError(f"prop {self.name!r}: {error}") from None
        scale = np.broadcast_to(self.scale, 3)
        return vertices * scale, faces[:, ::-1] if np.prod(np.sign(scale)) < 0 else faces


def as_props(given: object) -> tuple[Prop, ...]:
    """The props as a tuple. Raises InputError for anything but a list of props with different names."""
    if isinstance(given, Prop) or not isinstance(given, Iterable):
        raise InputError(f"props: got {type(given).__name__}, expected a list of props")
    props = tuple(given)
    for k, prop in enumerate(props):
        require_type(f"props[{k}]", prop, Prop)
    require_different("props", [prop.name for prop in props])
    return props
