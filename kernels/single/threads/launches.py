"""Casts on CUDA: one launch for the rays of one sensor or of several, then one for the hits of each.

A warp that finds no ray of one sensor left goes on to the next sensor.
"""

from collections.abc import Callable, Sequence

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.single.cast import Job

from .cast import BLOCKS, Share, cast_rays, hold
from .hits import BLOCK, complete_hits

MOST = 8
"""Sets of other casts for which launches are kept. They vary, because frames of some sensors are held for longer."""


class InThreads:
    """A repeatable cast of one sensor: the first `count` rays of those that `which` lists, or of all if it is empty."""

    def __init__(self, geometry: Geometry, job: Job, which: wp.array, count: int) -> None:
        self.geometry, self.job, self.which, self.count = geometry, job, which, count
        self._with: dict[tuple[InThreads, ...], list[Callable[[], None]]] = {}

    def launch_with(self, others: Sequence["InThreads"]) -> object:
        """Make this cast and others of one geometry at once; return the launches, which hold what they read."""
        key = tuple(others)
        launches = self._with.get(key)
        if launches is None:
            launches = _prepare([self, *others])
            if len(self._with) == MOST:
                self._with.clear()
            if not self.which.device.is_capturing:  # else their memory belongs to the graph
                self._with[key] = launches
        for launch in launches:
            launch()
        return launches


def _prepare(casts: Sequence[InThreads]) -> list[Callable[[], None]]:
    """The launches that store what the cast reads, the one that casts the rays of all, and those that complete hits."""
    device = casts[0].which.device
    held = wp.empty((len(casts), 1), dtype=Geometry, device=device)
    shares = wp.empty((len(casts), 1), dtype=Share, device=device)
    taken = wp.empty(len(casts), dtype=int, device=device)
    launches = []
    for k, each in enumerate(casts):
        inputs = [k, each.geometry, each.job, each.which, each.count, held, shares, taken]
        # in blocks of BLOCK threads, as Warp compiles the module for one block size
        launches.append(recorded(hold, 1, inputs, [], device, BLOCK))
    first = casts[0]
    kernel, inputs = cast_rays, [first.geometry, held, first.job, first.which, first.count, taken]
    if len(casts) > 1:
        from .several import cast_rays_of_several  # here, so that a single sensor does not wait for it to compile

        kernel, inputs = cast_rays_of_several, [first.geometry, held, shares, taken]
    blocks = min(-(-sum(each.count for each in casts) // BLOCK), BLOCKS * device.sm_count)
    launches.append(recorded(kernel, BLOCK * blocks, inputs, [], device, BLOCK))
    for k, each in enumerate(casts):
        launches.append(recorded(complete_hits, each.count, [k, held, each.job, each.which], [], device, BLOCK))
    return launches
