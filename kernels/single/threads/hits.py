"""The kernel that completes hits on CUDA: one thread per ray, after the cast.

It is a kernel of its own, because its code would push that of the cast out of the instruction cache.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.hit import Hit, hit_within
from rigcast.kernels.hits.out import Out, write, write_miss
from rigcast.kernels.rays.arrays import firing_in
from rigcast.kernels.single.cast import Job, is_castable, ray_to_cast, read_ray, world_ray, write_hit

BLOCK = 128
"""Threads of a block."""
BLOCKS = 6
"""Blocks per multiprocessor: 24 warps, which leaves 80 registers to each thread."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.func
def hold_hit(out: Out, i: int, hit: Hit) -> None:
    """Write the hit of ray i as the cast found it, in the arrays in which it will be completed."""
    write(out, i, hit.near, hit.shape, hit.triangle, wp.vec3(hit.far, 0.0, 0.0))


@wp.func
def held_hit(out: Out, i: int) -> Hit:
    """The hit of ray i as written by `hold_hit`."""
    return hit_within(out.distance[i], out.normal[i][0], out.shape[i], out.face[i])


@wp.func
def complete_hit(g: wp.array[Geometry], job: Job, world: int, own: int) -> None:
    """Replace the held hit of ray `own` of a world by its distance, face and normal, or by a reading and its derived
    fields."""
    i = world * job.rays.count + own
    hit = held_hit(job.out, i)
    firing = firing_in(job.rays, world, own)
    ray = world_ray(g, job, world, own, firing)
    if is_castable(ray):
        write_hit(g, job.out, i, hit, ray)
    else:
        write_miss(job.out, i, wp.nan)
    read_ray(job, i, firing)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def complete_hits(sensor: int, held: wp.array2d[Geometry], job: Job, which: wp.array[int]) -> None:
    """Complete the held hits of one sensor, of the rays that `which` lists, or of all if it is empty."""
    at = ray_to_cast(wp.tid(), job.rays, which)
    complete_hit(held[sensor], job, at[0], at[1])
