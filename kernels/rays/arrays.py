"""The rays of a sensor, in one world or many, fired at once or one after the other."""

from dataclasses import dataclass, replace
from functools import cached_property

import warp as wp

from rigcast.kernels.elements import double_vector_at
from rigcast.kernels.vectors import of_ray

from .coherent import Bundles, Packets, Warps

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BYTES_PER_DIRECTION = wp.types.type_size_in_bytes(wp.vec3d)


@wp.struct
class RayArrays:
    """Rays as a struct for kernels; arrays that are None in Rays are empty."""

    count: int  # rays per world
    directions: wp.array[wp.vec3d]
    vectors: wp.array[wp.vec3d]
    origins: wp.array[wp.vec3d]
    firing: wp.array[int]
    # per firing of every world:
    firings: int  # firings per world
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]
    span: wp.array[int]
    fraction: wp.array[wp.float64]


@dataclass(frozen=True)
class Rays:
    """N rays in the frame of a sensor, the same in each of W worlds, as Warp arrays on one device.

    A *firing* is the set of rays that leave at one time from one pose of the sensor: all rays of a reading taken at
    once, or a column of a spinning lidar. With F firings per world, firing f of world w is entry w F + f.

    directions: (N,) vec3d, unit; or (W, N) if worlds differ. origins: likewise [m], or (1,) for all rays.
    position, rotation: (W F,) vec3d [m] and mat33d, the sensor's poses in the world; columns are its axes. A pose that
    is not finite, such as that of a world to be left out, makes its rays NaN.
    packets: the same N rays sorted for the cast: on the CPU into packets of one origin and one firing each, or into
    bundles of one direction and one firing each; on CUDA into warps. None to cast them singly, in order.
    firing: (N,) int32, the firing of each ray within its world; None if there is only one.
    span: (W F,) int32, the span of the geometry in which each firing is; None: span w for world w.
    fraction: (W F,) float64, the time of each firing within its span, from 0 (first instant) to 1 (second); None for 0.
    vectors: (W N,) vec3d of any length, which a cast of single rays on the CPU normalises into `directions`; None if
    `directions` are given.
    """

    directions: wp.array
    origins: wp.array
    position: wp.array
    rotation: wp.array
    packets: Packets | Bundles | Warps | None = None
    worlds: int = 1
    firing: wp.array | None = None
    span: wp.array | None = None
    fraction: wp.array | None = None
    vectors: wp.array | None = None

    @property
    def total(self) -> int:
        """Number of rays of all worlds, W N."""
        return int(self.directions.shape[-1]) * self.worlds

    def of_worlds(self, part: slice) -> "Rays":
        """The rays of some of the worlds, as if there were no others, at their only instant."""
        firings = self.position.size // self.worlds
        own = slice(part.start * firings, part.stop * firings)
        return replace(
            self,
            directions=_of_worlds(self.directions, part),
            origins=_of_worlds(self.origins, part),
            position=self.position[own],
            rotation=self.rotation[own],
            worlds=part.stop - part.start,
            span=None,
            fraction=None,
        )

    @cached_property
    def arrays(self) -> RayArrays:
        """The rays as a struct for kernels."""
        arrays = RayArrays()
        arrays.count = self.directions.shape[-1]
        arrays.directions, arrays.origins = _flat(self.directions), _flat(self.origins)
        arrays.firings = self.position.size // self.worlds
        arrays.position, arrays.rotation = self.position, self.rotation
        for name in ("firing", "span", "fraction", "vectors"):
            if getattr(self, name) is not None:  # a struct begins with empty arrays
                setattr(arrays, name, getattr(self, name))
        return arrays


def _of_worlds(vectors: wp.array, part: slice) -> wp.array:
    return vectors if vectors.ndim == 1 else vectors[part]


def _flat(array: wp.array) -> wp.array:
    return array if array.ndim == 1 else array.flatten()


@wp.func
def firing_of(rays: RayArrays, k: int) -> int:
    """The firing of ray k, both counted over all worlds."""
    world = int(0)
    if k >= rays.count:
        world = int(k / rays.count)
    return firing_in(rays, world, k - world * rays.count)


@wp.func
def firing_in(rays: RayArrays, world: int, own: int) -> int:
    """The firing, counted over all worlds, of ray `own` of a world."""
    if rays.firings == 1:
        return world
    return world * rays.firings + rays.firing[own]


@wp.func
def vector_in(vectors: wp.array[wp.vec3d], rays: RayArrays, world: int, own: int) -> wp.vec3d:
    """The direction or origin of ray `own` of a world: `of_ray` without a division, which is slow."""
    size = vectors.shape[0]
    i = wp.where(size == rays.count, own, world * rays.count + own)
    return double_vector_at(vectors, wp.where(size == 1, 0, i))


@wp.func
def direction_of(rays: RayArrays, k: int) -> wp.vec3d:
    """Direction of ray k, counted over all worlds, in the sensor's frame."""
    return of_ray(rays.directions, k)


@wp.func
def origin_of(rays: RayArrays, k: int) -> wp.vec3d:
    """Origin [m] of ray k, counted over all worlds, in the sensor's frame."""
    return of_ray(rays.origins, k)


@wp.func
def span_of(rays: RayArrays, firing: int) -> int:
    if rays.span.shape[0] == 0:
        if rays.firings == 1:
            return firing
        return int(firing / rays.firings)
    return rays.span[firing]


@wp.func
def fraction_of(rays: RayArrays, firing: int) -> wp.float64:
    if rays.fraction.shape[0] == 0:
        return wp.float64(0.0)
    return rays.fraction[firing]
