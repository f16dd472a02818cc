"""Rays cast one by one on the CPU, as those with unrelated origins are; and what they share with those cast on CUDA.

Warp compiles a file's kernels together: a rig whose rays are all cast in packets does not wait for these.
"""

from typing import Any

import warp as wp

from rigcast.kernels.elements import double_vector_at, matrix_at
from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.fields import write_fields
from rigcast.kernels.hits.hit import NO_SHAPE, Hit, WorldRay, place_of
from rigcast.kernels.hits.out import Fields, Out, read_hit, write_miss, write_place
from rigcast.kernels.launching.slices import OverTiles
from rigcast.kernels.launching.stack import align_stack
from rigcast.kernels.launching.turns import turn_of
from rigcast.kernels.poses.scope import is_within_reach, scope_of
from rigcast.kernels.rays.arrays import RayArrays, direction_of, firing_of, origin_of, span_of
from rigcast.kernels.rays.unit import make_unit

from .ray import cast_ray
from .walk import NUMBERS_OF_STACK

RAYS_PER_RUN = 32
"""Rays that count as one tile where threads are counted."""
RAYS_PER_TURN = wp.constant(128)
"""Of rays that a thread of the CPU casts one by one: few, so that no thread waits long for the last one."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.struct
class Job:
    """What is cast at a geometry, and where its hits go."""

    rays: RayArrays
    visible: wp.array[wp.bool]
    limit: float
    cull: int
    out: Out
    fields: Fields


@wp.func
def is_castable(ray: WorldRay) -> bool:
    """Whether a ray is finite and starts no farther away than FARTHEST."""
    return is_within_reach(ray.origin) and wp.dot(ray.direction, ray.direction) < wp.float64(wp.inf)


@wp.func
def write_hit(g: wp.array[Geometry], out: Out, i: int, hit: Hit, ray: WorldRay) -> None:
    if hit.shape == NO_SHAPE:
        write_miss(out, i, wp.inf)
        return
    place = place_of(g, hit, ray)
    write_place(out, i, hit.shape, place.distance, place.face, place.normal, ray.limit)


@wp.func
def ray_number(k: int, rays: RayArrays, which: wp.array[int]) -> int:
    """Of the k-th ray of all that `which` names, of each world, or all if it is empty."""
    if which.shape[0] == 0:
        return k
    return k / which.shape[0] * rays.count + which[k % which.shape[0]]


@wp.func
def world_ray(g: wp.array[Geometry], job: Job, i: int, firing: int) -> WorldRay:
    rotation = matrix_at(job.rays.rotation, firing)
    ray = WorldRay()
    ray.origin = double_vector_at(job.rays.position, firing) + rotation * origin_of(job.rays, i)
    ray.direction = rotation * direction_of(job.rays, i)
    ray.scope = scope_of(g, span_of(job.rays, firing), firing)
    ray.limit = job.limit
    ray.cull = job.cull
    return ray


@wp.func
def read_ray(job: Job, i: int, firing: int) -> None:
    """Turn what ray i hits into what it reads, if that is wanted."""
    if job.out.is_read:
        read_hit(job.out, i, job.rays.rotation[firing])
        write_fields(job.fields, job.out, job.rays, i)


@wp.func
def cast_run(begin: int, end: int, g: wp.array[Geometry], job: Job, which: wp.array[int]) -> None:
    """Rays begin to end - 1, of each world those that `which` names, or all if it is empty.

    A loop within a function, for Warp compiles the body of a kernel twice.
    """
    stack = wp.zeros(shape=NUMBERS_OF_STACK, dtype=int)
    composed = wp.zeros(shape=1, dtype=TriangleBlock)
    for k in range(begin, end):
        i = ray_number(int(k), job.rays, which)
        firing = firing_of(job.rays, i)
        ray = world_ray(g, job, i, firing)
        if is_castable(ray):
            write_hit(g, job.out, i, cast_ray(g, ray, stack, composed), ray)
        else:
            write_miss(job.out, i, wp.nan)
        read_ray(job, i, firing)


@wp.struct
class Alone:
    """Which rays are cast one by one, and scratch of each thread of the CPU."""

    count: int
    which: wp.array[int]  # of each world; empty for all
    copies: wp.array2d[Geometry]  # (threads, 1)


@wp.kernel
def cast_turns(thread: int, turns: wp.array[int], g: Geometry, job: Job, alone: Alone) -> None:
    """On the CPU, rays that no other thread takes, RAYS_PER_TURN at a time. turns: how many were taken."""
    align_stack()
    g.visible = job.visible
    alone.copies[thread, 0] = g
    begin = turn_of(turns) * RAYS_PER_TURN
    while begin < alone.count:
        end = wp.min(begin + RAYS_PER_TURN, alone.count)
        if job.rays.vectors.shape[0] > 0:
            make_unit(begin, end, job.rays.vectors, job.rays.directions)
        cast_run(begin, end, alone.copies[thread], job, alone.which)
        begin = turn_of(turns) * RAYS_PER_TURN


def prepare_turns(geometry: Geometry, job: Job, which: wp.array, count: int) -> OverTiles:
    """The launch of a cast of so many rays on the CPU. which: numbers of rays, as of `Alone`."""

    def inputs(threads: int) -> list[Any]:
        alone = Alone()
        alone.count, alone.which = count, which
        alone.copies = wp.empty((threads, 1), dtype=Geometry, device="cpu")
        return [geometry, job, alone]

    return OverTiles(cast_turns, -(-count // RAYS_PER_RUN), inputs)
