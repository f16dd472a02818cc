"""Casters in turns in the same worlds, and what each gets right."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np
import warp as wp

from rigcast.bench.casters import Answer
from rigcast.bench.figure import Figure, Spread
from rigcast.bench.race import CLOSE, in_turns, rightness, triangles_of
from rigcast.oracle import Oracle, RayHits
from rigcast.sensors.specs.filter import Filter

from .contenders import MujocoWarp, Rigcast, Run, captured
from .crowd import Crowd, spread_over
from .limits import limits

JUDGED = 16  # worlds that are held to mj_ray
FEW = 20  # calls whose time on the host is taken


@dataclass(frozen=True)
class Way:
    """One way to cast the rays of all worlds. ms: of a frame. mrays: millions of rays in a second. ratio: of those of
    rigcast's `sense` to this one's, round by round."""

    name: str
    ms: Spread
    mrays: Spread
    ratio: Spread


@dataclass(frozen=True)
class Right:
    """What a caster gets right in the worlds that are judged: fractions of rays as in `Speed`, and of rays with
    mj_ray's geom."""

    caster: str
    agree: float
    close: float
    geom: float


@dataclass(frozen=True)
class OfWorlds:
    """So many worlds with so many rays in all. seen: fractions of the rays that hit the robot, the height field, other
    things and nothing. same: of those whose geom and distance, to 1 cm, two casters agree in, None without another."""

    worlds: int
    rays: int
    ways: tuple[Way, ...]
    parts: tuple[Figure, ...]
    right: tuple[Right, ...]
    same: float | None
    seen: dict[str, float]


@dataclass(frozen=True)
class OnDevice:
    """What was measured on a device, in batches of fewer and more worlds, and what the device does at most."""

    device: str
    workload: str
    geoms: int
    triangles: int
    batches: tuple[OfWorlds, ...]
    limits: tuple[Figure, ...]


def measure_worlds(
    crowd: Crowd, sizes: Sequence[int], device: wp.Device, casters: Collection[str], rounds: int
) -> OnDevice:
    """Measure in batches of so many of the worlds, beside mujoco_warp if it is among the casters."""
    model = crowd.workload.model
    return OnDevice(
        device.name,
        crowd.workload.name,
        model.ngeom,
        triangles_of(model),
        tuple(_batch(crowd, size, device, casters, rounds) for size in sizes),
        tuple(limits(rounds, device)),
    )


def _batch(crowd: Crowd, worlds: int, device: wp.Device, names: Collection[str], rounds: int) -> OfWorlds:
    """Time all ways in turns in the first so many worlds."""
    before = _used(device)
    ours = Rigcast(crowd, worlds, device)
    memory = [_memory("rigcast", _used(device) - before)]
    ways, casters = _ways_of_rigcast(ours), [(ours.name, ours.answer)]
    if MujocoWarp.name in names:
        before = _used(device)
        theirs = MujocoWarp(crowd, worlds, device, ours.poses())
        memory.append(_memory("mujoco_warp", _used(device) - before))
        ways |= _ways_of_mujoco_warp(theirs)
        casters.append((theirs.name, theirs.answer))
    ours.sense()
    answers = {name: answer() for name, answer in casters}
    settle = partial(wp.synchronize_device, device)
    seconds = {name: times[0] for name, times in in_turns(ways | _parts(ours), rounds, settle).items()}
    rays = worlds * len(crowd.directions)
    return OfWorlds(
        worlds,
        rays,
        tuple(
            Way(name, *(Spread.of(x) for x in (1e3 * t, rays / t / 1e6, t / seconds["rigcast"])))
            for name, t in ((name, seconds[name]) for name in ways)
        ),
        (
            *(Figure(name, what, "ms", Spread.of(1e3 * seconds[name])) for name, what in _PARTS.items()),
            _on_host(ours, settle),
            *(memory if device.is_cuda else []),
        ),
        tuple(_rightness(crowd, worlds, ours, answers)),
        _sameness(*answers.values()) if len(answers) == 2 else None,
        _seen(crowd, answers["rigcast"]),
    )


def _ways_of_rigcast(ours: Rigcast) -> dict[str, Run]:
    ways: dict[str, Run] = {"rigcast": ours.sense}
    if ours.device.is_cuda:
        ways["rigcast, graph"] = captured(ours.sense, ours.device)
    return ways


def _ways_of_mujoco_warp(theirs: MujocoWarp) -> dict[str, Run]:
    ways: dict[str, Run] = {"mujoco_warp": theirs.frame}
    if theirs.device.is_cuda:
        ways["mujoco_warp, graph"] = captured(theirs.frame, theirs.device)
    ways["mujoco_warp, no refit"] = theirs.cast
    return ways


_PARTS = {
    "update": "rigcast: poses taken and trees over geoms brought up to date",
    "cast": "rigcast: cast and read alone",
}


def _parts(ours: Rigcast) -> Mapping[str, Run]:
    return {"update": ours.update, "cast": ours.cast}


def _on_host(ours: Rigcast, settle: Run) -> Figure:
    """How long Python takes to launch a frame."""
    times = []
    for _ in range(FEW):
        settle()
        began = perf_counter()
        ours.sense()
        times.append(perf_counter() - began)
    settle()
    return Figure("host", "rigcast: until sense returns", "ms", Spread.of(1e3 * np.array(times)))


def _used(device: wp.Device) -> int:
    return int(wp.get_mempool_used_mem_current(device)) if device.is_cuda and device.is_mempool_enabled else 0


def _memory(caster: str, used: int) -> Figure:
    return Figure(f"memory_{caster}", f"{caster}: memory on the device", "MB", Spread.of(used / 1e6))


def _rightness(crowd: Crowd, worlds: int, ours: Rigcast, answers: Mapping[str, Answer]) -> Iterator[Right]:
    judged, poses, count = spread_over(worlds, JUDGED), ours.poses(), len(crowd.directions)
    directions = np.concatenate([crowd.directions @ poses[k, :3, :3].T for k in judged])
    which = np.concatenate([np.arange(k * count, (k + 1) * count) for k in judged])
    reference = _reference(crowd, judged, ours)
    for name, answer in answers.items():
        assert answer.geom_id is not None
        agree, close = rightness(directions, Answer(answer.distance[which], None, None), reference)
        yield Right(name, agree, close, float((answer.geom_id[which] == reference.geom_id).mean()))


def _reference(crowd: Crowd, judged: Sequence[int], ours: Rigcast) -> RayHits:
    seen, poses = Filter(geom_groups=crowd.workload.groups), ours.poses()
    each = [
        Oracle(crowd.workload.model, crowd.data(k), seen).cast(poses[k, :3, 3], crowd.directions @ poses[k, :3, :3].T)
        for k in judged
    ]
    return RayHits(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def _sameness(one: Answer, other: Answer) -> float:
    assert one.geom_id is not None
    both = np.isfinite(one.distance)
    with np.errstate(invalid="ignore"):
        near = np.where(both, np.abs(one.distance - other.distance) <= CLOSE, np.isposinf(other.distance))
    return float((near & (one.geom_id == other.geom_id)).mean())


def _seen(crowd: Crowd, answer: Answer) -> dict[str, float]:
    model, hit = crowd.workload.model, np.asarray(answer.geom_id)
    body = model.body_rootid[model.geom_bodyid]
    robot = body == model.body_rootid[model.jnt_bodyid[0]]
    kinds = {"robot": robot, "height field": model.geom_type == 1, "solids": ~robot & (model.geom_type != 1)}
    shares = {name: float((is_one[hit] & (hit >= 0)).mean()) for name, is_one in kinds.items()}
    return shares | {"nothing": float((hit < 0).mean())}
