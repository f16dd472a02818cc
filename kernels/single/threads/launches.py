"""Casts on CUDA: one launch for the rays of one sensor, or of several.

A warp that finds no ray of one sensor left goes on to the next.
"""

from collections.abc import Callable, Sequence

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.single.cast import Job

from .cast import BLOCK, BLOCKS, Share, cast_rays, hold

MOST = 8
"""Sets of others with which launches of a cast are kept: one sensor's frames may be held for longer than another's."""


class InThreads:
    """A cast of `count` rays of one sensor, of those that `which` names or of all, for as often as it is wanted."""

    def __init__(self, geometry: Geometry, job: Job, which: wp.array, count: int) -> None:
        self.geometry, self.job, self.which, self.count = geometry, job, which, count
        self._with: dict[tuple[InThreads, ...], list[Callable[[], None]]] = {}

    def launch_with(self, others: Sequence["InThreads"]) -> object:
        """All at once, at one geometry. Gives the launches, which hold what they read."""
        key = tuple(others)
        launches = self._with.get(key)
        if launches is None:
            launches = _prepare([self, *others])
            if len(self._with) == MOST:
                self._with.clear()
            if not self.which.device.is_capturing:  # else the graph has the memory that they use
                self._with[key] = launches
        for launch in launches:
            launch()
        return launches


def _prepare(casts: Sequence[InThreads]) -> list[Callable[[], None]]:
    """One launch that casts the rays of all, after those that hand over what it reads."""
    device = casts[0].which.device
    held = wp.empty((len(casts), 1), dtype=Geometry, device=device)
    shares = wp.empty((len(casts), 1), dtype=Share, device=device)
    taken = wp.empty(len(casts), dtype=int, device=device)
    launches = []
    for k, each in enumerate(casts):
        inputs = [k, each.geometry, each.job, each.which, each.count, held, shares, taken]
        launches.append(recorded(hold, 1, inputs, [], device, BLOCK))  # as Warp compiles for one size of blocks
    first = casts[0]
    kernel, inputs = cast_rays, [first.geometry, held, first.job, first.which, first.count, taken]
    if len(casts) > 1:
        from .several import cast_rays_of_several  # here, as one sensor does not wait until it is compiled

        kernel, inputs = cast_rays_of_several, [first.geometry, held, shares, taken]
    blocks = min(-(-sum(each.count for each in casts) // BLOCK), BLOCKS * device.sm_count)
    launches.append(recorded(kernel, BLOCK * blocks, inputs, [], device, BLOCK))
    return launches
