"""Hits as sensor readings: range limits, normals in the sensor's frame, and the fields that follow from them.

Each ray takes less time than starting a Warp thread on the CPU, so a thread handles a run of rays there. Loops are
`while`: the compiler would keep the counter of a `for` in memory, and each ray would wait for it.
"""

from collections.abc import Callable

import warp as wp

from rigcast.kernels.launching.slices import launch_over_runs, prepare_over_runs
from rigcast.kernels.rays.arrays import RayArrays, Rays, direction_of, firing_of, origin_of
from rigcast.kernels.vectors import to_float

from .arrays import HitArrays
from .fields import depth_at, point_at
from .out import Out, read_hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.func
def ray_of(i: int, per_ray: int) -> int:
    """The ray that value i belongs to, without a division if each ray has one value."""
    if per_ray == 1:
        return i
    return int(i / per_ray)


@wp.kernel
def read_hits(
    first: int,
    run: int,  # rays per thread
    rays: RayArrays,
    per_ray: int,
    out: Out,  # per_ray of each ray
) -> None:
    i = (first + wp.tid()) * run
    end = wp.min(i + run, out.distance.shape[0])
    while i < end:
        read_hit(out, i, rays.rotation[firing_of(rays, ray_of(i, per_ray))])
        i += 1


def read(hits: HitArrays, rays: Rays, min_range: float) -> None:
    """Turn hits into readings in place, with normals in the rays' frame.

    Where the distance is below min_range [m] it becomes -inf, the shape -1 and the normal 0.

    Args:
        hits: k in a row for each ray of all worlds, with normals in the world.
    """
    out = hits.out()
    out.min_range = min_range
    inputs = [rays.arrays, _per_ray(hits.distance, rays)]
    launch_over_runs(read_hits, hits.distance.size, inputs, [out], hits.distance.device)


def prepare_read(rays: RayArrays, per_ray: int, count: int, out: Out, device: wp.DeviceLike) -> Callable[[], object]:
    """A repeatable `read` of `count` hits, `per_ray` of each ray. rays, out: read anew at each launch."""
    return prepare_over_runs(read_hits, count, [rays, per_ray], [out], device)


def _per_ray(values: wp.array, rays: Rays) -> int:
    """Number of values per ray."""
    return int(values.size // max(1, rays.total))


@wp.kernel
def bound_readings(
    first: int,
    run: int,  # rays per thread
    max_range: float,
    out: Out,
) -> None:
    i = (first + wp.tid()) * run
    end = wp.min(i + run, out.distance.shape[0])
    while i < end:
        if out.distance[i] < out.min_range:
            out.distance[i] = -wp.inf
        elif out.distance[i] > max_range:
            out.distance[i] = wp.inf
        if not wp.isfinite(out.distance[i]):
            out.shape[i] = -1
            out.normal[i] = wp.vec3(0.0, 0.0, 0.0)
        i += 1


def bound(hits: HitArrays, min_range: float, max_range: float) -> None:
    """Replace measured distances below min_range by -inf and above max_range [m] by +inf, in place.

    Where the distance is not finite, the shape becomes -1 and the normal 0.
    """
    out = hits.out()
    out.min_range = min_range
    launch_over_runs(bound_readings, hits.distance.size, [max_range], [out], hits.distance.device)


@wp.func
def point_in_frame(rays: RayArrays, i: int, distance: float) -> wp.vec3d:
    """The end of ray i at this range [m] in the sensor's frame; NaN if the range is not finite."""
    return point_at(origin_of(rays, i), direction_of(rays, i), distance)


@wp.kernel
def points_in_frame(
    first: int, run: int, rays: RayArrays, per_ray: int, distance: wp.array[float], points: wp.array[wp.vec3]
) -> None:
    k = (first + wp.tid()) * run
    end = wp.min(k + run, distance.shape[0])
    while k < end:
        points[k] = to_float(point_in_frame(rays, ray_of(k, per_ray), distance[k]))
        k += 1


@wp.kernel
def points_in_world(
    first: int, run: int, rays: RayArrays, per_ray: int, distance: wp.array[float], points: wp.array[wp.vec3d]
) -> None:
    k = (first + wp.tid()) * run
    end = wp.min(k + run, distance.shape[0])
    while k < end:
        i = ray_of(k, per_ray)
        firing = firing_of(rays, i)
        points[k] = rays.position[firing] + rays.rotation[firing] * point_in_frame(rays, i, distance[k])
        k += 1


@wp.kernel
def depth_along_z(first: int, run: int, rays: RayArrays, distance: wp.array[float], depth: wp.array[float]) -> None:
    i = (first + wp.tid()) * run
    end = wp.min(i + run, distance.shape[0])
    while i < end:
        depth[i] = depth_at(direction_of(rays, i), distance[i])
        i += 1


@wp.kernel
def depth_in_steps(first: int, run: int, depth: wp.array[float], scale: float, steps: wp.array[wp.uint16]) -> None:
    """Depths rounded to whole steps; 0 where that does not fit 16 bits."""
    i = (first + wp.tid()) * run
    end = wp.min(i + run, depth.shape[0])
    while i < end:
        count = wp.round(depth[i] / scale)
        steps[i] = wp.uint16(0)
        if count >= 0.0 and count <= 65535.0:
            steps[i] = wp.uint16(int(count))
        i += 1


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
    const unsigned count = table.shape[0];
    for (int i = begin; i < end; ++i) {
        const int k = index.data[i];
        values.data[i] = unsigned(k) < count ? table.data[k] : -1;
    }
""")
def look_up_run(  # type: ignore[no-untyped-def]
    begin: int, end: int, table: wp.array[int], index: wp.array[int], values: wp.array[int]
):
    """Set values = table[index] from begin to end - 1; -1 if out of range. Native, as in Warp -1 is the last entry."""


@wp.kernel
def look_up_entries(first: int, run: int, table: wp.array[int], index: wp.array[int], values: wp.array[int]) -> None:
    """Set values = table[index]; -1 where the index is out of range."""
    begin = (first + wp.tid()) * run
    look_up_run(begin, wp.min(begin + run, index.shape[0]), table, index, values)


def points(distance: wp.array, rays: Rays, out: wp.array | None = None) -> wp.array:
    """Points (n k,) vec3 [m] in the sensor's frame of n rays with k distances each; NaN where the distance is not
    finite. out: array to write to and return; None makes a new one."""
    out = wp.empty(distance.size, dtype=wp.vec3, device=distance.device) if out is None else out
    inputs = [rays.arrays, _per_ray(distance, rays), distance]
    launch_over_runs(points_in_frame, distance.size, inputs, [out], distance.device)
    return out


def world_points(distance: wp.array, rays: Rays, out: wp.array | None = None) -> wp.array:
    """Points (n k,) vec3d [m] in the world of n rays with k distances each; NaN where the distance is not finite."""
    out = wp.empty(distance.size, dtype=wp.vec3d, device=distance.device) if out is None else out
    inputs = [rays.arrays, _per_ray(distance, rays), distance]
    launch_over_runs(points_in_world, distance.size, inputs, [out], distance.device)
    return out


def z_depth(distance: wp.array, rays: Rays, out: wp.array | None = None) -> wp.array:
    """Depths (n,) float32 [m], the z coordinates of the points; +-inf or NaN where the range is."""
    out = wp.empty(distance.size, dtype=float, device=distance.device) if out is None else out
    launch_over_runs(depth_along_z, distance.size, [rays.arrays, distance], [out], distance.device)
    return out


def depth_16bit(depth: wp.array, scale: float, out: wp.array | None = None) -> wp.array:
    """Depths (n,) uint16 in steps of `scale` [m]; 0 where the depth [m] is not finite, negative or > 65535 steps."""
    out = wp.empty(depth.size, dtype=wp.uint16, device=depth.device) if out is None else out
    launch_over_runs(depth_in_steps, depth.size, [depth, scale], [out], depth.device)
    return out


def look_up(table: wp.array, index: wp.array, out: wp.array | None = None) -> wp.array:
    """Entries (n,) int32 table[index]; -1 where the index is out of range, such as -1."""
    out = wp.empty(index.size, dtype=int, device=index.device) if out is None else out
    launch_over_runs(look_up_entries, index.size, [table, index], [out], index.device)
    return out
