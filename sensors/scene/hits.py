"""The result of a cast."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.hits.arrays import HitArrays
from rigcast.sensors.device import DeviceArray
from rigcast.sensors.errors import InputError

from .parts.part import OWNERS, Owner
from .shape_ids import ShapeIds


class NumpyHits(NamedTuple):
    """The fields of Hits as numpy arrays."""

    distance: NDArray[np.float32]
    geom_id: NDArray[np.int32]
    flex_id: NDArray[np.int32]
    skin_id: NDArray[np.int32]
    prop_id: NDArray[np.int32]
    face: NDArray[np.int32]
    normal: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Hits:
    """The first hit of each ray, as Warp arrays on the scene's device, of the shape (...) of the rays.

    Ids are looked up when you ask for them, except geom ids in a scene that has only geoms. For a single ray, (3,),
    Warp arrays have shape (1,) and those of `numpy()` shape ().
    """

    shape: tuple[int, ...]
    _arrays: HitArrays = field(repr=False)
    _shape_ids: ShapeIds = field(repr=False)

    @cached_property
    def distance(self) -> DeviceArray:
        """(...) float32 [m], whatever the direction's length; +inf on a miss, NaN for a ray that could not be cast."""
        return self._shaped(self._arrays.distance)

    @cached_property
    def face(self) -> DeviceArray:
        """(...) int32, triangle within the mesh or height field, -1 otherwise."""
        return self._shaped(self._arrays.face)

    @cached_property
    def normal(self) -> DeviceArray:
        """(..., 3) float32, unit, outward whatever the ray's direction, in the world; 0 on a miss."""
        return self._arrays.normal.view(wp.float32).reshape((*self._own_shape, 3))

    @cached_property
    def geom_id(self) -> DeviceArray:
        """(...) int32, -1 unless a geom was hit."""
        return self._ids("geom")

    @cached_property
    def flex_id(self) -> DeviceArray:
        """(...) int32, -1 unless a flex was hit."""
        return self._ids("flex")

    @cached_property
    def skin_id(self) -> DeviceArray:
        """(...) int32, -1 unless a skin was hit."""
        return self._ids("skin")

    @cached_property
    def prop_id(self) -> DeviceArray:
        """(...) int32, -1 unless a prop was hit."""
        return self._ids("prop")

    def numpy(self) -> NumpyHits:
        """All fields as numpy arrays; on the CPU they are views of the Warp arrays.

        Ids of a kind that the scene does not have are a read-only broadcast of -1.
        """
        nothing = np.broadcast_to(np.int32(-1), self.shape)
        known = {f"{owner}_id": owner in self._shape_ids.of_shape for owner in OWNERS}
        ids = {name: self._numpy(getattr(self, name)) if is_known else nothing for name, is_known in known.items()}
        normal = self.normal.numpy().reshape((*self.shape, 3))
        return NumpyHits(**ids, distance=self._numpy(self.distance), face=self._numpy(self.face), normal=normal)

    def room_for(self, shape: tuple[int, ...], device: wp.Device) -> HitArrays:
        """The arrays, to be overwritten with other hits of rays of this shape.

        Raises:
            InputError: they have another shape, or are on another device.
        """
        if shape != self.shape or self._arrays.distance.device != device:
            raise InputError(
                f"Scene.cast: out: got hits of shape {self.shape} on {self._arrays.distance.device}, "
                f"expected {shape} on {device}"
            )
        return self._arrays

    @property
    def _own_shape(self) -> tuple[int, ...]:
        return self.shape or (1,)

    def _shaped(self, array: wp.array) -> DeviceArray:
        """The array in the shape of the rays; itself if it has it, as a view takes as long as casting many rays."""
        return array if array.shape == self._own_shape else array.reshape(self._own_shape)

    def _ids(self, owner: Owner) -> wp.array:
        shape, ids = self._arrays.shape, self._shape_ids
        if owner not in ids.of_shape:
            return wp.full(self._own_shape, -1, dtype=int, device=shape.device)
        return self._shaped(shape if ids.are_shapes(owner) else ids.look_up(owner, shape))

    def _numpy(self, array: wp.array) -> NDArray[Any]:
        return np.asarray(array.numpy().reshape(self.shape))
