"""The kernel that casts the rays of several sensors in one launch on CUDA, so that the GPU does not idle between them.

Their shares are in memory, because a kernel has the same number of arguments for any number of sensors.
"""

import warp as wp

from rigcast.kernels.geometry import Geometry

from .cast import BLOCKS, Share, cast_share
from .hits import BLOCK

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.func
def cast_shares(g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array[int]) -> None:
    """Cast the rays of one sensor after the other, until all are taken."""
    for sensor in range(shares.shape[0]):
        share = shares[sensor]
        g.visible = share[0].job.visible
        cast_share(sensor, g, held[sensor], share[0].job, share[0].which, share[0].count, taken)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays_of_several(
    g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array[int]
) -> None:
    """Cast the rays of all shares. held: (sensors, 1), the geometry with the shapes visible to each sensor.

    The number of threads must be a multiple of the warp size.
    """
    cast_shares(g, held, shares, taken)
