"""Checks of a rig against MuJoCo: each sensor's rays in several states of a simulation, judged by `rigcast.oracle`."""

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast import oracle
from rigcast.oracle import Comparison, RayHits, Things, Verdict, deformable
from rigcast.oracle.things import TYPES
from rigcast.sensors.errors import InputError, require_type, require_whole
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.scene.parts.part import Owner

WRONG_SHOWN = 5


@dataclass(frozen=True)
class Row:
    """The rays of one sensor that hit one type of geom, flexes, skins or props, or nothing ("none").

    Errors are |t - t_ref| [m] of rays that agree on a hit, and the same over the bound for agreement;
    0 if there are no such rays.
    """

    sensor: str
    geom_type: str
    rays: int
    agree: int
    edge: int
    wrong: int
    worst_error: float
    p999_error: float
    worst_of_bound: float
    p999_of_bound: float


@dataclass(frozen=True)
class Hit:
    """A hit: distance [m]; kind, id and name of the object; outward normal. A miss: distance None, id -1, normal 0."""

    distance: float | None
    kind: Owner | None
    id: int
    name: str | None
    normal: tuple[float, ...]


@dataclass(frozen=True)
class WrongRay:
    """Everything needed to replay a wrong ray: the state, by steps and time [s], and the ray in the world frame.

    ray is its index in the sensor's reading, for instance (row, column).
    """

    sensor: str
    step: int
    time: float
    ray: tuple[int, ...]
    origin: tuple[float, ...]
    direction: tuple[float, ...]
    got: Hit
    expected: Hit


@dataclass(frozen=True)
class Report:
    """The result of a check: rows by sensor and geom type, the first few wrong rays, the times checked [s].

    Every judged ray agrees, is in the edge band, or is wrong: rays = agree + edge + wrong.

    not_judged: number of rays left out because they end on a flex or skin and MuJoCo is older than 4.
    """

    rows: tuple[Row, ...]
    wrong_rays: tuple[WrongRay, ...]
    times: tuple[float, ...]
    not_judged: int = 0

    @property
    def rays(self) -> int:
        """Number of rays that were judged."""
        return sum(row.rays for row in self.rows)

    @property
    def agree(self) -> int:
        """Number of rays that agree with MuJoCo."""
        return sum(row.agree for row in self.rows)

    @property
    def edge(self) -> int:
        """Number of rays that end so close to an edge that either answer counts."""
        return sum(row.edge for row in self.rows)

    @property
    def wrong(self) -> int:
        """Number of rays that do not agree."""
        return sum(row.wrong for row in self.rows)


@dataclass(frozen=True, eq=False)
class _Part:
    """The judged rays of one sensor in one state.

    index (n,) is the place of each in the flat reading, not_judged the number of its rays that cannot be judged.
    """

    sensor: str
    step: int
    time: float
    shape: tuple[int, ...]
    index: npt.NDArray[np.intp]
    origins: npt.NDArray[np.float64]
    directions: npt.NDArray[np.float64]
    found: Comparison
    not_judged: int


def check(
    rig: Rig,
    data: mujoco.MjData,
    *,
    rays: int = 20_000,
    states: int = 5,
    duration: float = 1.0,
    seed: int = 0,
) -> Report:
    """Cast a rig's rays in several states of a simulation and judge each by mj_ray, as `rigcast check` does.

    Args:
        rig: its sensors' nominal rays are cast, without range limits and measurement effects.
        data: the first state. It is stepped: afterwards it is in the last state.
        rays: about how many in all, shared evenly among sensors and states and drawn at random from each reading; a
            sensor that has fewer is checked whole.
        states: how many, evenly over `duration`.
        duration: simulated time from the first to the last state [s].
        seed: of the random choice of rays.

    Geoms are judged by mj_ray, SDF geoms and props by mj_ray on their meshes, flexes and skins by mj_rayFlex and
    mju_raySkin; MuJoCo before 4 cannot answer for flexes and skins, and rays that end on them are not judged.

    Raises:
        InputError: an argument of another type or out of range, before anything is cast, or data that `Rig.sense`
            refuses.

    >>> report = rigcast.check(rig, data)
    >>> assert report.wrong == 0, report.wrong_rays
    """
    require_type("check: rig", rig, Rig)
    require_whole("check: rays", rays, 1)
    require_whole("check: states", states, 1)
    require_whole("check: seed", seed, 0)
    if not (isinstance(duration, float | int | np.number) and 0 <= float(duration) < math.inf):
        raise InputError(f"check: duration: got {duration!r}, expected a number of seconds from 0 on")
    parts: list[_Part] = []
    rng = np.random.default_rng(seed)
    quota = max(1, rays // (states * len(rig.sensors)))
    for step in _states(rig.model, data, states, duration):
        parts += [_judge(rig, data, spec.name, step, quota, rng) for spec in rig.sensors]
    things = Things.of(rig.model, rig.props)
    rows = [row for spec in rig.sensors for row in _rows(things, [p for p in parts if p.sensor == spec.name])]
    wrong = [(part, ray) for part in parts for ray in part.found.where(Verdict.WRONG).tolist()]
    return Report(
        tuple(rows),
        tuple(_wrong_ray(things, part, ray) for part, ray in wrong[:WRONG_SHOWN]),
        tuple(dict.fromkeys(part.time for part in parts)),
        sum(part.not_judged for part in parts),
    )


def _states(model: mujoco.MjModel, data: mujoco.MjData, states: int, duration: float) -> Iterator[int]:
    """Step the data from state to state; yield the number of steps made so far."""
    previous = 0
    for step in np.rint(np.linspace(0, duration, states) / model.opt.timestep).astype(int).tolist():
        for _ in range(step - previous):
            mujoco.mj_step(model, data)
        previous = step
        yield step


def _judge(rig: Rig, data: mujoco.MjData, sensor: str, step: int, quota: int, rng: np.random.Generator) -> _Part:
    """Cast all of a sensor's rays, judge at most `quota` of them."""
    rays, hits = rig.rays(data, [sensor])[sensor], rig.cast(data, [sensor])[sensor].numpy()
    shape = hits.distance.shape
    # pixels that a fisheye lens leaves dark have no ray
    has_ray = np.isfinite(rays.directions).all(axis=-1).reshape(-1)
    is_geom = ((hits.flex_id < 0) & (hits.skin_id < 0)).reshape(-1)
    can_judge = np.flatnonzero(has_ray & (is_geom | deformable.CAN_JUDGE))
    index = np.sort(rng.choice(can_judge, min(quota, can_judge.size), replace=False))
    directions = rays.directions.reshape(-1, 3)[index]
    origins = np.broadcast_to(rays.origins, rays.directions.shape).reshape(-1, 3)[index]
    numbers = Things.of(rig.model, rig.props).numbers(hits)
    got = RayHits.of(hits)._replace(geom_id=numbers).take(index)
    spec = next(spec for spec in rig.sensors if spec.name == sensor)
    posed = _posed(rig.model, data)
    found = oracle.compare(rig.model, posed, origins, directions, got, spec.filter, rig.props)
    not_judged = int(has_ray.sum()) - can_judge.size
    return _Part(sensor, step, data.time, shape, index, origins, directions, found, not_judged)


def _posed(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """Return a copy with the poses of shapes and mounts at `data.time`: mj_step leaves them a step behind."""
    posed = copy.copy(data)
    mujoco.mj_kinematics(model, posed)
    mujoco.mj_comPos(model, posed)
    mujoco.mj_flex(model, posed)
    mujoco.mj_camlight(model, posed)
    return posed


def _rows(things: Things, parts: list[_Part]) -> Iterator[Row]:
    """Yield one sensor's rows, by type."""
    kind = things.types_of(np.concatenate([part.found.things() for part in parts]))
    verdict = np.concatenate([part.found.verdict for part in parts])
    error = np.concatenate([part.found.error for part in parts])
    scaled = np.concatenate([part.found.scaled for part in parts])
    for one in sorted(set(kind.tolist()), key=TYPES.index):
        of, good = kind == one, (kind == one) & (verdict == Verdict.AGREE)
        counts = [int((verdict[of] == each).sum()) for each in Verdict]
        errors = [*_worst_and_p999(error[good]), *_worst_and_p999(scaled[good])]
        yield Row(parts[0].sensor, one, int(of.sum()), *counts, *errors)


def _worst_and_p999(values: npt.NDArray[np.float64]) -> tuple[float, float]:
    return (float(values.max()), float(np.quantile(values, 0.999))) if values.size else (0.0, 0.0)


def _wrong_ray(things: Things, part: _Part, ray: int) -> WrongRay:
    place = tuple(int(i) for i in np.unravel_index(part.index[ray], part.shape))
    start, towards = tuple(part.origins[ray].tolist()), tuple(part.directions[ray].tolist())
    got, expected = (_hit(things, hits, ray) for hits in (part.found.got, part.found.expected))
    return WrongRay(part.sensor, part.step, part.time, place, start, towards, got, expected)


def _hit(things: Things, hits: RayHits, ray: int) -> Hit:
    number, normal = int(hits.geom_id[ray]), tuple(hits.normal[ray].tolist())
    distance = float(hits.distance[ray]) if np.isfinite(hits.distance[ray]) else None
    if not 0 <= number < len(things.kinds):
        return Hit(distance, None, number, None, normal)
    return Hit(distance, things.kinds[number], things.ids[number], things.names[number], normal)
