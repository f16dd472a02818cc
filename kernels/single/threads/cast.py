"""Rays cast in threads of CUDA, as many as it runs at once, each of which takes one ray after the other."""

from collections.abc import Callable

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.out import write_miss
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.launching.turns import turn_of
from rigcast.kernels.rays.arrays import firing_of
from rigcast.kernels.single.cast import Job, is_castable, ray_number, read_ray, world_ray, write_hit

from .ray import Frame, Ray, cast_ray
from .walk import ENTRIES, address_of_stack

BLOCK = 128
"""Threads of a block."""
BLOCKS = 5
"""Of a multiprocessor: 20 warps, for each of whose threads there are 96 registers."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.kernel
def hold(g: Geometry, job: Job, held: wp.array[Geometry], taken: wp.array[int]) -> None:
    """The geometry, for functions that must not copy it; and no ray is taken."""
    g.visible = job.visible
    held[0] = g
    taken[0] = 0


@wp.func
def cast_turns(
    g: Geometry, held: wp.array[Geometry], job: Job, which: wp.array[int], count: int, taken: wp.array[int]
) -> None:
    """Rays that no other thread takes. A function, for Warp compiles the body of a kernel twice."""
    entries = wp.zeros(shape=ENTRIES, dtype=wp.uint64)
    stack = address_of_stack(entries)
    ray = wp.zeros(shape=1, dtype=Ray)
    frames = wp.zeros(shape=2, dtype=Frame)
    k = turn_of(taken)
    while k < count:
        i = ray_number(k, job.rays, which)
        firing = firing_of(job.rays, i)
        ray[0].world = world_ray(held, job, i, firing)
        if is_castable(ray[0].world):
            cast_ray(g, held, ray, frames, stack)
            write_hit(held, job.out, i, ray[0].best, ray[0].world)
        else:
            write_miss(job.out, i, wp.nan)
        read_ray(job, i, firing)
        k = turn_of(taken)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays(
    g: Geometry, held: wp.array[Geometry], job: Job, which: wp.array[int], count: int, taken: wp.array[int]
) -> None:
    """The first `count` rays of those that `which` names, or all if it is empty."""
    g.visible = job.visible
    cast_turns(g, held, job, which, count, taken)


def prepare_threads(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Callable[[], object]]:
    """The launches of a cast of so many rays, for as often as it is wanted."""
    if count == 0:
        return []
    device = which.device
    held, taken = wp.empty(1, dtype=Geometry, device=device), wp.empty(1, dtype=int, device=device)
    threads = min(count, BLOCK * BLOCKS * device.sm_count)
    return [
        recorded(hold, 1, [geometry, job, held, taken], [], device, BLOCK),  # as Warp compiles for one size of blocks
        recorded(cast_rays, threads, [geometry, held, job, which, count, taken], [], device, BLOCK),
    ]
