"""The rays of several sensors in one launch on CUDA, so that it does not run empty between them.

What they cast lies in memory and not among the arguments, of which a kernel has the same for any number of sensors.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry

from .cast import BLOCK, BLOCKS, Share, cast_share

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.func
def cast_shares(g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array[int]) -> None:
    """Rays that no other warp takes, of one sensor after the other."""
    for sensor in range(shares.shape[0]):
        share = shares[sensor]
        g.visible = share[0].job.visible
        cast_share(sensor, g, held[sensor], share[0].job, share[0].which, share[0].count, taken)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays_of_several(
    g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array[int]
) -> None:
    """The rays of all shares, in the geometry but for what is visible, which is held for each sensor, (sensors, 1).

    As many threads as fill warps.
    """
    cast_shares(g, held, shares, taken)
