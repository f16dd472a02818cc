"""Times of firing of the rays of a reading."""

import warp as wp

from rigcast.kernels.launching.slices import launch_over_rays

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def add_time(
    first: int,
    begun: wp.array[wp.float64],
    firing_times: wp.array[wp.float64],  # empty for all at once
    stamps: wp.array[wp.float64],
) -> None:
    i = first + wp.tid()
    time = begun[i / (stamps.shape[0] / begun.shape[0])]
    if firing_times.shape[0] > 0:
        time += firing_times[i % firing_times.shape[0]]
    stamps[i] = time


def stamps(begun: wp.array, firing_times: wp.array | None, count: int, out: wp.array | None = None) -> wp.array:
    """Stamps (count,) float64 [s], one per ray of every world: begin of the world's reading plus the ray's firing time.

    begun: (W,) float64 [s]. firing_times: float64 [s], of any shape, the same in all worlds; None if all rays are fired
    at once. Each sum is rounded once.
    """
    out = wp.empty(count, dtype=wp.float64, device=begun.device) if out is None else out
    fired = wp.empty(0, dtype=wp.float64, device=begun.device) if firing_times is None else firing_times.flatten()
    launch_over_rays(add_time, count, [begun, fired], [out], out.device)
    return out
