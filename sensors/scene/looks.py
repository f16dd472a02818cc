"""Optical properties of surfaces, from the colours and materials of a model and from the user's `surfaces`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.effects.lidars.echoes import SurfaceArrays
from rigcast.sensors.faults import refuse
from rigcast.sensors.specs.surface import Surface

_LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear red, green and blue: ITU-R BT.709
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)  # of a geom in MJCF; a material's colour takes its place


@dataclass(frozen=True, eq=False)
class Looks:
    """Optics per shape, on the device: surfaces, see rigcast.kernels.effects.lidars.echoes; textured, (n,) bool.

    has_transparent, has_mirrors: whether any shape transmits light, or reflects some as a mirror.
    """

    surfaces: SurfaceArrays
    textured: wp.array
    has_transparent: bool
    has_mirrors: bool

    @cached_property  # used by every frame
    def reflectivity(self) -> wp.array:
        return self.surfaces.reflectivity


class LooksTable:
    """The optical properties of the shapes of a scene.

    Args:
        owners, ids: (n,) kind and MuJoCo id of each shape's object. bodies: (n,) its body, -1 for none.
        props: their names. surfaces: override the model's colours; of several for one shape the last counts.

    Raises:
        InputError: a surface names something that does not exist.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        shapes: tuple[NDArray[np.str_], NDArray[np.int32], NDArray[np.int32]],
        props: Sequence[str],
        surfaces: Sequence[Surface],
    ) -> None:
        for k, surface in enumerate(surfaces):
            refuse(f"surfaces[{k}]", surface.faults(model, props))
        self._model, self._props, self._overrides = model, props, tuple(surfaces)
        self._owners, self._ids, self._bodies = shapes

    def read(self, device: wp.DeviceLike) -> Looks:
        """The optical properties by the model's present colours and materials."""
        model = self._model
        rgba, material = self._drawn()
        values = {
            "reflectivity": rgba[:, :3] @ np.array(_LUMINANCE),
            "transmission": 1.0 - rgba[:, 3],
            "mirror": np.append(model.mat_reflectance, 0.0)[material],
        }
        for surface in self._overrides:
            here = self._belongs(surface, material)
            for name, column in values.items():
                given = getattr(surface, name)
                column[here] = column[here] if given is None else given
        arrays = SurfaceArrays()
        for name, column in values.items():
            setattr(arrays, name, wp.array(column, dtype=float, device=device))
        textured = np.append((model.mat_texid >= 0).any(axis=-1), False)[material]
        return Looks(
            arrays,
            wp.array(textured, dtype=wp.bool, device=device),
            has_transparent=bool((values["transmission"] > 0).any()),
            has_mirrors=bool((values["mirror"] > 0).any()),
        )

    def _drawn(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """The colour (n, 4) in which each shape is drawn, and the id (n,) of its material, -1 for none."""
        model, count = self._model, len(self._ids)
        rgba, material = np.tile(np.array(_DEFAULT_RGBA), (count, 1)), np.full(count, -1, np.int32)
        for owner in ("geom", "flex", "skin"):
            here = self._owners == owner
            rgba[here] = getattr(model, f"{owner}_rgba")[self._ids[here]]
            material[here] = getattr(model, f"{owner}_matid")[self._ids[here]]
        # as mjv_updateScene does
        takes_material = (material >= 0) & (rgba == np.array(_DEFAULT_RGBA)).all(axis=1)
        rgba[takes_material] = model.mat_rgba[material[takes_material]]
        return rgba, material

    def _belongs(self, surface: Surface, material: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which shapes (n,) a surface entry applies to."""
        if surface.geom is not None:
            return (self._owners == "geom") & (self._ids == self._model.geom(surface.geom).id)
        if surface.material is not None:
            return np.asarray(material == self._model.mat(surface.material).id)
        if surface.body is not None:
            return np.asarray(self._bodies == self._model.body(surface.body).id)
        return (self._owners == "prop") & (self._ids == self._props.index(str(surface.prop)))
