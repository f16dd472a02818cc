"""Rays cast in threads of CUDA, as many as it runs at once, each of which takes one ray after the other.

One launch casts the rays of several sensors: a thread that finds none left of one goes on to the next.
"""

from collections.abc import Callable, Sequence

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.out import write_miss
from rigcast.kernels.inline import noinline
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
MOST = 8
"""Sets of others with which launches of a cast are kept: one sensor's frames may be held for longer than another's."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.struct
class Share:
    """What is cast of one sensor: the first `count` rays of those that `which` names, or of all if it is empty."""

    job: Job
    which: wp.array[int]
    count: int


@wp.kernel
def hold(
    sensor: int,
    g: Geometry,
    job: Job,
    which: wp.array[int],
    count: int,
    held: wp.array2d[Geometry],
    shares: wp.array2d[Share],
    taken: wp.array2d[int],
) -> None:
    """What a sensor casts at and its share, where functions need not copy them; and none of its rays is taken."""
    g.visible = job.visible
    held[sensor, 0] = g
    share = Share()
    share.job = job
    share.which = which
    share.count = count
    shares[sensor, 0] = share
    taken[sensor, 0] = 0


@noinline
def take_ray(held: wp.array2d[Geometry], shares: wp.array2d[Share], ray: wp.array[Ray], k: int) -> bool:
    """Ray k of its sensor's share, and whether it can be cast."""
    sensor = ray[0].sensor
    ray[0].number = ray_number(k, shares[sensor, 0].job.rays, shares[sensor, 0].which)
    firing = firing_of(shares[sensor, 0].job.rays, ray[0].number)
    ray[0].world = world_ray(held[sensor], shares[sensor, 0].job, ray[0].number, firing)
    return is_castable(ray[0].world)


@noinline
def write_ray(held: wp.array2d[Geometry], shares: wp.array2d[Share], ray: wp.array[Ray], is_cast: bool) -> None:
    """What it hits, or that it could not be cast."""
    sensor = ray[0].sensor
    i = ray[0].number
    if is_cast:
        write_hit(held[sensor], shares[sensor, 0].job.out, i, ray[0].best, ray[0].world)
    else:
        write_miss(shares[sensor, 0].job.out, i, wp.nan)
    read_ray(shares[sensor, 0].job, i, firing_of(shares[sensor, 0].job.rays, i))


@wp.func
def cast_turns(g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array2d[int]) -> None:
    """Rays that no other thread takes, of one sensor after the other."""
    entries = wp.zeros(shape=ENTRIES, dtype=wp.uint64)
    stack = address_of_stack(entries)
    ray = wp.zeros(shape=1, dtype=Ray)
    frames = wp.zeros(shape=2, dtype=Frame)
    while ray[0].sensor < shares.shape[0]:
        k = turn_of(taken[ray[0].sensor])
        if k < shares[ray[0].sensor, 0].count:
            is_cast = take_ray(held, shares, ray, k)
            if is_cast:
                cast_ray(g, held, ray, frames, stack)
            write_ray(held, shares, ray, is_cast)
        else:
            ray[0].sensor += 1


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays(g: Geometry, held: wp.array2d[Geometry], shares: wp.array2d[Share], taken: wp.array2d[int]) -> None:
    """The rays of all shares, in the geometry but for what is visible, which is held for each sensor, (sensors, 1)."""
    cast_turns(g, held, shares, taken)


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
    taken = wp.empty((len(casts), 1), dtype=int, device=device)
    threads = min(sum(each.count for each in casts), BLOCK * BLOCKS * device.sm_count)
    launches = []
    for k, each in enumerate(casts):
        inputs = [k, each.geometry, each.job, each.which, each.count, held, shares, taken]
        launches.append(recorded(hold, 1, inputs, [], device, BLOCK))  # as Warp compiles for one size of blocks
    launches.append(recorded(cast_rays, threads, [casts[0].geometry, held, shares, taken], [], device, BLOCK))
    return launches
