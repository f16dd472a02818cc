"""Correctness of casters in many worlds: compared with mj_ray in some worlds, with each other in all."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.bench.casters import Answer, Floats
from rigcast.bench.race import CLOSE, rightness, spread_over
from rigcast.oracle import Oracle, RayHits
from rigcast.sensors.specs.filter import Filter

from .crowd import Crowd

JUDGED = 16  # worlds that are compared with mj_ray


@dataclass(frozen=True)
class Right:
    """Fractions of the rays in the judged worlds with mj_ray's hits, misses and distances, see `Speed`,
    and with its geom."""

    caster: str
    agree: float
    close: float
    geom: float


def right(crowd: Crowd, poses: Floats, answers: Mapping[str, Answer]) -> Iterator[Right]:
    """Compare each caster's answer, world after world, with mj_ray. poses: (nworld, 4, 4) of the sensor."""
    judged, count = spread_over(len(poses), JUDGED), len(crowd.directions)
    turned = [crowd.directions @ poses[k, :3, :3].T for k in judged]
    reference = _mj_ray(crowd, judged, poses[judged, :3, 3], turned)
    rays = np.concatenate([np.arange(k * count, (k + 1) * count) for k in judged])
    for name, answer in answers.items():
        agree, close = rightness(np.concatenate(turned), Answer(answer.distance[rays], None, None), reference)
        yield Right(name, agree, close, float((_geoms(answer)[rays] == reference.geom_id).mean()))


def _mj_ray(crowd: Crowd, worlds: Sequence[int], origins: Floats, directions: Sequence[Floats]) -> RayHits:
    model, seen = crowd.workload.model, Filter(geom_groups=crowd.workload.groups)
    rays = zip(worlds, origins, directions, strict=True)
    each = [Oracle(model, crowd.data(world), seen).cast(origin, towards) for world, origin, towards in rays]
    return RayHits(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def sameness(one: Answer, other: Answer) -> float:
    """Return the fraction of rays for which two casters agree on the geom and, to 1 cm, on the distance."""
    with np.errstate(invalid="ignore"):
        near = np.abs(one.distance - other.distance) <= CLOSE
    near |= np.isposinf(one.distance) & np.isposinf(other.distance)
    return float((near & (_geoms(one) == _geoms(other))).mean())


def seen(model: mujoco.MjModel, answer: Answer) -> dict[str, float]:
    """Return the fractions of rays that hit the robot (of the first joint), the height field, other things, nothing."""
    hit, root = _geoms(answer), model.body_rootid[model.geom_bodyid]
    is_robot, is_field = root == model.body_rootid[model.jnt_bodyid[0]], model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD
    kinds = {"robot": is_robot, "height field": is_field, "other things": ~is_robot & ~is_field}
    shares = {name: float((is_one[hit] & (hit >= 0)).mean()) for name, is_one in kinds.items()}
    return shares | {"nothing": float((hit < 0).mean())}


def _geoms(answer: Answer) -> npt.NDArray[np.integer]:
    assert answer.geom_id is not None  # which both casters report
    return answer.geom_id
