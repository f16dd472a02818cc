"""The rays of several sensors in one launch on CUDA, so that it does not run empty between them.

What they cast lies in memory, as a kernel takes no arrays of structs, and not among the arguments.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.out import write_miss
from rigcast.kernels.rays.arrays import firing_of
from rigcast.kernels.single.cast import is_castable, ray_number, read_ray, world_ray, write_hit

from .cast import BLOCK, BLOCKS, Share, lane, place_of_frames, place_of_ray, turn_of_warp
from .ray import Frame, Ray, cast_ray
from .walk import ENTRIES, address_of_stack

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.func
def cast_shares(g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array[int]) -> None:
    """Rays that no other warp takes, of one sensor after the other."""
    entries = wp.zeros(shape=ENTRIES, dtype=wp.uint64)
    stack = address_of_stack(entries)
    ray = wp.array(ptr=place_of_ray(), shape=(1,), dtype=Ray)
    frames = wp.array(ptr=place_of_frames(), shape=(2,), dtype=Frame)
    for sensor in range(shares.shape[0]):
        share = shares[sensor]
        g.visible = share[0].job.visible
        first = turn_of_warp(taken, sensor)
        while first < share[0].count:
            k = first + lane()
            if k < share[0].count:
                i = ray_number(k, share[0].job.rays, share[0].which)
                ray[0].number = i
                ray[0].world = world_ray(held[sensor], share[0].job, i, firing_of(share[0].job.rays, i))
                if is_castable(ray[0].world):
                    cast_ray(g, held[sensor], ray, frames, stack)
                    write_hit(held[sensor], share[0].job.out, ray[0].number, ray[0].best, ray[0].world)
                else:
                    write_miss(share[0].job.out, ray[0].number, wp.nan)
                read_ray(share[0].job, ray[0].number, firing_of(share[0].job.rays, ray[0].number))
            first = turn_of_warp(taken, sensor)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays_of_several(
    g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array[int]
) -> None:
    """The rays of all shares, in the geometry but for what is visible, which is held for each sensor, (sensors, 1).

    As many threads as fill warps.
    """
    cast_shares(g, held, shares, taken)
