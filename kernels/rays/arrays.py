"""Rays of a sensor, in one world or in many, frozen or fired one after the other."""

from dataclasses import dataclass, replace
from functools import cached_property

import warp as wp

from rigcast.kernels.vectors import of_ray

from .coherent import Bundles, Packets, Warps

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class RayArrays:
    """Rays, where a kernel reads them; empty arrays for what Rays has None of."""

    count: int  # of the rays of one world
    directions: wp.array[wp.vec3d]
    vectors: wp.array[wp.vec3d]
    origins: wp.array[wp.vec3d]
    firing: wp.array[int]
    # of every firing of every world:
    firings: int  # in one world
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]
    span: wp.array[int]
    fraction: wp.array[wp.float64]


@dataclass(frozen=True)
class Rays:
    """N rays in the frame of a sensor, the same in each of W worlds, as Warp arrays on one device.

    A *firing* is what leaves at one time, from one pose of the sensor: all rays of a frozen reading, or those of a
    column of a spinning lidar. Of F firings in W worlds, firing f of world w is entry w F + f.

    directions: (N,) vec3d, unit, or (W, N) where worlds differ. origins: likewise [m], or (1,) for all rays.
    position, rotation: (W F,) vec3d [m] and mat33d, the sensor's poses in the world; columns are its axes. The rays of
    a pose that is not finite, such as one in a world that is not to be looked at, give NaN.
    packets: the same N rays on the CPU in packets of one origin and one firing each, or in bundles of one direction and
    one firing, or on CUDA in warps; None to cast each alone, one after the other.
    firing: (N,) int32, which of the F firings each ray belongs to; None where there is one.
    span: (W F,) int32, in which span of the geometry each firing is; None for world w in span w.
    fraction: (W F,) float64, how far from the first instant of its span to the second, 0 to 1; None for 0.
    vectors: (W N,) vec3d, of any length, of which a cast one by one on the CPU makes the directions on its way, over
    what is there; None where these are directions already.
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
        """W N, the rays of all worlds."""
        return int(self.directions.shape[-1]) * self.worlds

    def of_worlds(self, part: slice) -> "Rays":
        """Those of some of the worlds, as if there were no others."""
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
        """The same for a kernel."""
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
    """The firing, among those of all worlds, of ray k, among those of all worlds."""
    world = int(0)
    if k >= rays.count:
        world = int(k / rays.count)
    if rays.firings == 1:
        return world
    return world * rays.firings + rays.firing[k - world * rays.count]


@wp.func
def direction_of(rays: RayArrays, k: int) -> wp.vec3d:
    """Of ray k of all worlds, in the sensor's frame."""
    return of_ray(rays.directions, k)


@wp.func
def origin_of(rays: RayArrays, k: int) -> wp.vec3d:
    """Of ray k of all worlds, in the sensor's frame [m]."""
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
