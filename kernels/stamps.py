"""When each ray of a reading was fired."""

import warp as wp

from .launch import launch_over_rays

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def add_time(first: int, time: wp.float64, firing_times: wp.array[wp.float64], stamps: wp.array[wp.float64]) -> None:
    i = first + wp.tid()
    stamps[i] = time + firing_times[i]


def stamps(time: float, firing_times: wp.array) -> wp.array:
    """(n,) float64 [s]: time + firing_times, (n,) float64 [s], rounded once."""
    out = wp.empty(firing_times.size, dtype=wp.float64, device=firing_times.device)
    launch_over_rays(add_time, out.size, [wp.float64(time), firing_times], [out], out.device)
    return out
