"""Timing of casters in turn in the same worlds."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np
import warp as wp

from rigcast.bench.casters import Floats
from rigcast.bench.figure import Figure, Spread
from rigcast.bench.race import in_turns, triangles_of
from rigcast.bench.scaling import Series

from .contenders import MujocoWarp, Rigcast, Run, captured
from .crowd import Crowd
from .limits import limits
from .rightness import Right, right, sameness, seen

CALLS = 20  # calls whose time on the host is measured


@dataclass(frozen=True)
class Way:
    """One way to cast the rays of all worlds. ms: time of a frame. mrays: millions of rays per second. ratio: speed of
    rigcast's `sense` to this one's, round by round."""

    name: str
    ms: Spread
    mrays: Spread
    ratio: Spread


@dataclass(frozen=True)
class Batch:
    """Results for a number of worlds with a total number of rays.

    parts: of rigcast's frame, and the casters' memory on CUDA. same: fraction of the rays for which mujoco_warp has the
    same geom and, to 1 cm, distance; None without it. seen: fractions of the rays by what they hit.
    """

    worlds: int
    rays: int
    ways: tuple[Way, ...]
    parts: tuple[Figure, ...]
    right: tuple[Right, ...]
    same: float | None
    seen: dict[str, float]


@dataclass(frozen=True)
class OnDevice:
    """Results on a device, for different numbers of worlds. limits: its peak rates, if it is a GPU;
    on a CPU their kernels do not use all threads."""

    device: str
    workload: str
    geoms: int
    triangles: int
    batches: tuple[Batch, ...]
    limits: tuple[Figure, ...]

    def by_way(self) -> dict[str, Series]:
        """The speed of each way over the number of worlds."""
        sizes = tuple(batch.worlds for batch in self.batches)
        names = [way.name for way in self.batches[0].ways]
        speeds = zip(*([way.mrays for way in batch.ways] for batch in self.batches), strict=True)
        return {name: Series("worlds", sizes, mrays) for name, mrays in zip(names, speeds, strict=True)}


def measure_worlds(
    crowd: Crowd, sizes: Sequence[int], device: wp.Device, casters: Collection[str], rounds: int
) -> OnDevice:
    """Time rigcast in the first n worlds for each n in `sizes`, and mujoco_warp if it is among the casters."""
    model = crowd.workload.model
    about = device.name, crowd.workload.name, model.ngeom, triangles_of(model)
    batches = tuple(_batch(crowd, size, device, MujocoWarp.name in casters, rounds) for size in sizes)
    return OnDevice(*about, batches, tuple(limits(rounds, device)) if device.is_cuda else ())


def _batch(crowd: Crowd, worlds: int, device: wp.Device, is_compared: bool, rounds: int) -> Batch:
    settle, at_first = partial(wp.synchronize_device, device), _used(device)
    ours = Rigcast(crowd, worlds, device)
    by_ours, poses = _used(device), ours.poses()
    answers, ways = {ours.name: ours.answer()}, _ways_of_rigcast(ours)
    figures = [_on_host(ours, settle), _memory(ours.name, by_ours - at_first)]
    if is_compared:
        before = _used(device)
        theirs = MujocoWarp(crowd, worlds, device, poses)
        figures.append(_memory(theirs.name, _used(device) - before))
        answers[theirs.name] = theirs.answer()
        ways |= _ways_of_mujoco_warp(theirs)
    parts = {"update": ours.update, "cast": ours.cast, "points": ours.sense_points}
    times = {name: clock for name, (clock, _) in in_turns(ways | parts, rounds, settle).items()}
    rays = worlds * len(crowd.directions)
    return Batch(
        worlds,
        rays,
        tuple(_way(name, times[name], rays, times[ours.name]) for name in ways),
        (*_parts(times), *(figure for figure in figures if figure.unit != "MB" or device.is_cuda)),
        tuple(right(crowd, poses, answers)),
        sameness(*answers.values()) if is_compared else None,
        seen(crowd.workload.model, answers[ours.name]),
    )


def _ways_of_rigcast(ours: Rigcast) -> dict[str, Run]:
    ways: dict[str, Run] = {ours.name: ours.sense}
    if ours.device.is_cuda:
        ways[f"{ours.name}, graph"] = captured(ours.sense, ours.device)
    return ways


def _ways_of_mujoco_warp(theirs: MujocoWarp) -> dict[str, Run]:
    ways: dict[str, Run] = {theirs.name: theirs.frame, f"{theirs.name}, no refit": theirs.cast}
    if theirs.device.is_cuda:
        ways[f"{theirs.name}, graph"] = captured(theirs.frame, theirs.device)
    return ways


def _way(name: str, seconds: Floats, rays: int, ours: Floats) -> Way:
    return Way(name, Spread.of(1e3 * seconds), Spread.of(rays / seconds / 1e6), Spread.of(seconds / ours))


def _parts(seconds: dict[str, Floats]) -> Iterator[Figure]:
    for key, what in (
        ("update", "poses taken, trees over geoms brought up to date"),
        ("cast", "rays cast and read"),
        ("points", "all of sense, and points"),
    ):
        yield Figure(key, f"rigcast: {what}", "ms", Spread.of(1e3 * seconds[key]))


def _on_host(ours: Rigcast, settle: Run) -> Figure:
    times = []
    for _ in range(CALLS):
        settle()
        began = perf_counter()
        ours.sense()
        times.append(perf_counter() - began)
    settle()
    return Figure("host", "rigcast: until sense returns", "ms", Spread.of(1e3 * np.array(times)))


def _used(device: wp.Device) -> int:
    """Return the bytes that Warp has allocated on a CUDA device; 0 on the CPU."""
    return int(wp.get_mempool_used_mem_current(device)) if device.is_cuda and device.is_mempool_enabled else 0


def _memory(caster: str, used: int) -> Figure:
    return Figure(f"memory_{caster}", f"{caster}: memory, scene and all", "MB", Spread.of(used / 1e6))
