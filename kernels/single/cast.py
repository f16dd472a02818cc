"""Casts of single rays on the CPU, such as rays with unrelated origins; and the code shared with single rays on CUDA.

Warp compiles the kernels of a file together, so a rig whose rays are all cast in packets does not compile these.
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
from rigcast.kernels.rays.arrays import RayArrays, firing_in, span_of, vector_in
from rigcast.kernels.rays.unit import make_unit

from .ray import cast_ray
from .walk import NUMBERS_OF_STACK

RAYS_PER_TILE = 32
"""Number of rays that counts as one tile when the number of threads is chosen."""
RAYS_PER_TURN = wp.constant(128)
"""Number of rays that a CPU thread claims at a time; small, so that no thread waits long for the last one."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.struct
class Job:
    """The arguments of a cast, besides the geometry: rays, visible shapes, limit [m], culling; and its outputs."""

    rays: RayArrays
    visible: wp.array[wp.bool]
    limit: float
    cull: int
    out: Out
    fields: Fields


@wp.func
def is_castable(ray: WorldRay) -> bool:
    """Whether a ray is finite and no coordinate of its origin exceeds FARTHEST."""
    return is_within_reach(ray.origin) and wp.dot(ray.direction, ray.direction) < wp.float64(wp.inf)


@wp.func
def write_hit(g: wp.array[Geometry], out: Out, i: int, hit: Hit, ray: WorldRay) -> None:
    if hit.shape == NO_SHAPE:
        write_miss(out, i, wp.inf)
        return
    place = place_of(g, hit, ray)
    write_place(out, i, hit.shape, place.distance, place.face, place.normal, ray.limit)


@wp.func
def ray_to_cast(k: int, rays: RayArrays, which: wp.array[int]) -> wp.vec2i:
    """World of the k-th ray to cast, and its number there: of those that `which` lists in each world, or of all rays if
    it is empty."""
    count = wp.where(which.shape[0] > 0, which.shape[0], rays.count)
    world = int(0)
    if k >= count:
        world = k / count
    own = k - world * count
    if which.shape[0] > 0:
        own = which[own]
    return wp.vec2i(world, own)


@wp.func
def world_ray(g: wp.array[Geometry], job: Job, world: int, own: int, firing: int) -> WorldRay:
    """Ray `own` of a world."""
    rotation = matrix_at(job.rays.rotation, firing)
    ray = WorldRay()
    origin = vector_in(job.rays.origins, job.rays, world, own)
    ray.origin = double_vector_at(job.rays.position, firing) + rotation * origin
    ray.direction = rotation * vector_in(job.rays.directions, job.rays, world, own)
    ray.scope = scope_of(g, span_of(job.rays, firing), firing)
    ray.limit = job.limit
    ray.cull = job.cull
    return ray


@wp.func
def read_ray(job: Job, i: int, firing: int) -> None:
    """Turn the hit of ray i into a reading and write its derived fields, if the job asks for readings."""
    if job.out.is_read:
        read_hit(job.out, i, job.rays.rotation[firing])
        write_fields(job.fields, job.out, job.rays, i)


@wp.func
def cast_run(begin: int, end: int, g: wp.array[Geometry], job: Job, which: wp.array[int]) -> None:
    """Cast rays begin to end - 1 of those that `which` lists in each world, or of all rays if it is empty.

    The loop is in a function because Warp compiles the body of a kernel twice.
    """
    stack = wp.zeros(shape=NUMBERS_OF_STACK, dtype=int)
    composed = wp.zeros(shape=1, dtype=TriangleBlock)
    for k in range(begin, end):
        at = ray_to_cast(int(k), job.rays, which)
        i = at[0] * job.rays.count + at[1]
        firing = firing_in(job.rays, at[0], at[1])
        ray = world_ray(g, job, at[0], at[1], firing)
        if is_castable(ray):
            write_hit(g, job.out, i, cast_ray(g, ray, stack, composed), ray)
        else:
            write_miss(job.out, i, wp.nan)
        read_ray(job, i, firing)


@wp.struct
class InSingles:
    """The rays to cast one by one, and the scratch of each CPU thread."""

    count: int  # rays to cast, over all worlds
    which: wp.array[int]  # numbers of rays within each world; empty for all
    copies: wp.array2d[Geometry]  # (threads, 1)


@wp.kernel
def cast_singles(thread: int, turns: wp.array[int], g: Geometry, job: Job, these: InSingles) -> None:
    """Cast rays on the CPU, RAYS_PER_TURN per turn; each thread claims turns. turns: number of turns claimed so far."""
    align_stack()
    g.visible = job.visible
    these.copies[thread, 0] = g
    begin = turn_of(turns) * RAYS_PER_TURN
    while begin < these.count:
        end = wp.min(begin + RAYS_PER_TURN, these.count)
        if job.rays.vectors.shape[0] > 0:
            make_unit(begin, end, job.rays.vectors, job.rays.directions)
        cast_run(begin, end, these.copies[thread], job, these.which)
        begin = turn_of(turns) * RAYS_PER_TURN


def prepare_singles(geometry: Geometry, job: Job, which: wp.array, count: int) -> OverTiles:
    """A launch that casts `count` rays on the CPU. which: numbers of rays, as in `InSingles`."""

    def inputs(threads: int) -> list[Any]:
        these = InSingles()
        these.count, these.which = count, which
        these.copies = wp.empty((threads, 1), dtype=Geometry, device="cpu")
        return [geometry, job, these]

    return OverTiles(cast_singles, -(-count // RAYS_PER_TILE), inputs)
