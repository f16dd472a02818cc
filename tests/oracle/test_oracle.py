"""The judge itself: mj_ray under every filter, and hand-made disagreements of every kind."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
from judged_casts import assert_none_wrong

from rigcast import InputError, oracle
from rigcast.oracle import RayHits, Verdict
from rigcast.sensors.specs.filter import Filter

# A 2 m cube "box" at the origin, a sphere "ball" behind it along +x, a box "twin" whose left side lies in the
# cube's right side, on a floor that only collides; "arm" and its child "hand" hold one geom each.
MODEL = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" pos="0 0 -3" contype="1" conaffinity="1"/>
    <geom name="box" type="box" size="1 1 1" contype="0" conaffinity="0" group="2"/>
    <geom name="ball" type="sphere" size="1" pos="6 0 0" contype="0" conaffinity="0"/>
    <geom name="twin" type="box" size="1 1 1" pos="2 0.5 0" group="3"/>
    <body name="arm" pos="0 6 0"><freejoint/><geom name="arm" type="sphere" size="1"/>
      <body name="hand" pos="0 3 0"><geom name="hand" type="sphere" size="1" contype="0"
      conaffinity="0"/></body>
    </body>
  </worldbody>
</mujoco>
""")
DATA = mujoco.MjData(MODEL)
mujoco.mj_kinematics(MODEL, DATA)
FLOOR, BOX, BALL, TWIN, ARM, HAND = range(6)
MISS = (np.inf, -1, (0, 0, 0))
Answer = tuple[float, int, tuple[float, float, float]]


def hits(*answers: Answer) -> RayHits:
    """Return the hits with these distances, ids and normals."""
    distance, geom_id, normal = zip(*answers, strict=True)
    return RayHits(np.array(distance), np.array(geom_id, np.int32), np.array(normal, float))


@pytest.mark.parametrize(
    ("filter", "from_left", "down", "over"),
    [
        (Filter(), BOX, FLOOR, HAND),
        (Filter(geom_groups=(0, 3)), TWIN, FLOOR, HAND),
        (Filter(geom_groups=(2,)), BOX, -1, -1),
        (Filter(static=False), -1, -1, HAND),
        (Filter(exclude_bodies=("hand",)), BOX, FLOOR, ARM),
        (Filter(exclude_bodies=("arm",)), BOX, FLOOR, HAND),
        (Filter(exclude_bodies=("arm", "hand")), BOX, FLOOR, -1),
        (Filter(exclude_bodies=("arm",), exclude_subtree=True), BOX, FLOOR, -1),
        (Filter(exclude_bodies=("world",)), -1, -1, HAND),
        (Filter(exclude_bodies=("world",), exclude_subtree=True), -1, -1, -1),
        (Filter(geometry="visual"), BOX, -1, HAND),
        (Filter(geometry="collision"), TWIN, FLOOR, ARM),
        (Filter(geometry="visual", exclude_bodies=("hand",), static=False), -1, -1, -1),
        (Filter(geometry="collision", geom_groups=(3,)), TWIN, -1, -1),
    ],
    ids=str,
)
def test_the_oracle_sees_what_the_filter_lets_it_see(filter: Filter, from_left: int, down: int, over: int) -> None:
    origins = [(-9, 0.7, 0), (9, 9, -2), (0, 12, -1.8)]
    directions = [(2, 0, 0), (0, 0, -1e-3), (0, -1, 0.3)]
    before = MODEL.geom_rgba.copy(), MODEL.geom_matid.copy()
    got = oracle.Oracle(MODEL, DATA, filter).cast(origins, directions)
    assert got.geom_id.tolist() == [from_left, down, over]
    np.testing.assert_array_equal(MODEL.geom_rgba, before[0])
    np.testing.assert_array_equal(MODEL.geom_matid, before[1])


def test_distances_are_metres_and_a_miss_is_inf_and_no_geom() -> None:
    got = oracle.Oracle(MODEL, DATA).cast((-4, 0, 0), [(1e-3, 0, 0), (500, 0, 0), (-1, 0, 0)])
    np.testing.assert_allclose(got.distance, [3, 3, np.inf], rtol=1e-12)
    assert got.geom_id.tolist() == [BOX, BOX, -1]
    np.testing.assert_allclose(got.normal, [(-1, 0, 0), (-1, 0, 0), (0, 0, 0)], atol=1e-15)


DATA = mujoco.MjData(MODEL)
mujoco.mj_kinematics(MODEL, DATA)
OTHER = mujoco.MjModel.from_xml_string("<mujoco/>")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((OTHER, DATA), "oracle: data belongs to another model than that given"),
        ((MODEL, mujoco.MjData(MODEL)), "oracle: data: poses have not been computed, expected"),
        ((DATA, MODEL), "oracle: model: got MjData, expected MjModel"),
        ((MODEL, DATA, {"static": True}), "oracle: filter: got dict, expected Filter or None"),
        (
            (MODEL, DATA, Filter(exclude_bodies=("amr",))),
            "oracle: filter: exclude_bodies[0]: no body 'amr' in the model, expected one of world, arm, hand; did you",
        ),
    ],
)
def test_what_mj_ray_would_answer_wrongly_is_refused(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError) as caught:
        oracle.Oracle(*arguments)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(("origin", "direction"), [((0, 0, 0), (1, 0)), (0.0, (1, 0, 0))])
def test_rays_without_three_numbers_are_refused(origin: Any, direction: Any) -> None:
    with pytest.raises(InputError, match=r"oracle: got origins \(3?,?\), directions .* expected \(\.\.\., 3\)"):
        oracle.Oracle(MODEL, DATA).cast(origin, direction)


@pytest.mark.parametrize("direction", [(0, 0, 0), (np.nan, 0, 1), (np.inf, 0, 0)])
def test_a_direction_that_would_end_the_process_is_refused(direction: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"ray 1: .*expected finite, not 0"):
        oracle.Oracle(MODEL, DATA).cast((0, 0, 0), [(1, 0, 0), direction])


LEFT = ((-4.0, 0.0, 0.0), (1.0, 0.0, 0.0))  # meets the cube at 3
PAST = ((-4.0, 1 + 5e-6, 0.0), (1.0, 0.0, 0.0))  # 5 um past the cube's edge: meets the twin's left side at 5
FAR_PAST = ((-4.0, 1 + 1e-4, 0.0), (1.0, 0.0, 0.0))
TIED = ((0.0, 0.2, 0.0), (1.0, 0.0, 0.0))  # from inside the cube out, where the twin begins: both at 1
SLANT = ((-2.5, 0.0, 1.1), (1.0, 0.0, -0.05))  # meets the cube's top at cos = 0.05
ABOVE = ((0.0, 0.0, 9.0), (0.0, 0.6, 0.8))  # meets nothing
RIM = ((6.0, -9.0, 1.0 - 1e-6), (0.0, 1.0, 0.0))  # meets the ball 1 um below its top


@pytest.mark.parametrize(
    ("ray", "answer", "verdict"),
    [
        pytest.param(LEFT, (3.0, BOX, (-1, 0, 0)), Verdict.AGREE, id="right"),
        pytest.param(LEFT, (3 + 3.9e-5, BOX, (-1, 0, 0)), Verdict.AGREE, id="distance within its bound"),
        pytest.param(LEFT, (3 + 3e-4, BOX, (-1, 0, 0)), Verdict.WRONG, id="distance out of the band"),
        pytest.param(LEFT, (3 - 3e-4, BOX, (-1, 0, 0)), Verdict.WRONG, id="distance too short"),
        pytest.param(LEFT, (3.0, BALL, (-1, 0, 0)), Verdict.WRONG, id="wrong geom"),
        pytest.param(LEFT, (3.0, 17, (-1, 0, 0)), Verdict.WRONG, id="no such geom"),
        pytest.param(LEFT, (3.0, -1, (-1, 0, 0)), Verdict.WRONG, id="hit without geom"),
        pytest.param(LEFT, (3.0, BOX, (1, 0, 0)), Verdict.WRONG, id="normal flipped"),
        pytest.param(LEFT, (3.0, BOX, (0, 0, 0)), Verdict.WRONG, id="normal zero"),
        pytest.param(LEFT, (3.0, BOX, (-2, 0, 0)), Verdict.WRONG, id="normal not unit"),
        pytest.param(LEFT, (3.0, BOX, (-0.9998, 0.02, 0)), Verdict.AGREE, id="normal within its bound"),
        pytest.param(LEFT, (3.0, BOX, (-0.995, 0.0999, 0)), Verdict.WRONG, id="normal turned"),
        pytest.param(LEFT, MISS, Verdict.WRONG, id="missed"),
        pytest.param(LEFT, (-1.0, -1, (0, 0, 0)), Verdict.WRONG, id="missed as -1 m"),
        pytest.param(LEFT, (5.0, BOX, (1, 0, 0)), Verdict.WRONG, id="exit instead of entry"),
        pytest.param(LEFT, (np.nan, BOX, (-1, 0, 0)), Verdict.WRONG, id="NaN distance"),
        pytest.param(LEFT, (3.0, BOX, (np.nan, 0, 0)), Verdict.WRONG, id="NaN normal"),
        pytest.param(ABOVE, MISS, Verdict.AGREE, id="miss"),
        pytest.param(ABOVE, (0.0, -1, (0, 0, 0)), Verdict.WRONG, id="miss as 0 m"),
        pytest.param(ABOVE, (-1.0, -1, (0, 0, 0)), Verdict.WRONG, id="miss as -1 m"),
        pytest.param(ABOVE, (np.nan, -1, (0, 0, 0)), Verdict.WRONG, id="miss as NaN"),
        pytest.param(ABOVE, (np.inf, 0, (0, 0, 0)), Verdict.WRONG, id="miss with a geom"),
        pytest.param(ABOVE, (np.inf, -1, (0, 0, 1)), Verdict.WRONG, id="miss with a normal"),
        pytest.param(ABOVE, (1e6, FLOOR, (0, 0, 1)), Verdict.WRONG, id="hit where there is nothing"),
        pytest.param(PAST, (5.0, TWIN, (-1, 0, 0)), Verdict.AGREE, id="past the edge"),
        pytest.param(PAST, (3.0, BOX, (-1, 0, 0)), Verdict.EDGE, id="edge hit 5 um past it"),
        pytest.param(PAST, (3.0, BOX, (0, 1, 0)), Verdict.EDGE, id="edge hit on its other side"),
        pytest.param(PAST, (3.0, BOX, (1, 0, 0)), Verdict.WRONG, id="edge hit, normal flipped"),
        pytest.param(FAR_PAST, (3.0, BOX, (-1, 0, 0)), Verdict.WRONG, id="edge hit 100 um past it"),
        pytest.param(TIED, (1.0, BOX, (1, 0, 0)), Verdict.AGREE, id="tied, the lower id"),
        pytest.param(TIED, (1.0, TWIN, (-1, 0, 0)), Verdict.AGREE, id="tied, the higher id"),
        pytest.param(TIED, (1.0, TWIN, (1, 0, 0)), Verdict.WRONG, id="tied, the other's normal"),
        pytest.param(SLANT, (2.0025 + 3e-4, BOX, (0, 0, 1)), Verdict.AGREE, id="slanted, within its bound"),
        pytest.param(SLANT, (2.0025 + 2e-3, BOX, (0, 0, 1)), Verdict.WRONG, id="slanted, out of the band"),
        pytest.param(RIM, MISS, Verdict.EDGE, id="rim missed"),
    ],
)
def test_every_kind_of_disagreement_gets_its_verdict(
    ray: tuple[tuple[float, float, float], tuple[float, float, float]], answer: Answer, verdict: Verdict
) -> None:
    got = oracle.compare(MODEL, DATA, ray[0], [ray[1]], hits(answer))
    assert Verdict(got.verdict[0]) == verdict, f"got {answer}, mj_ray says {got.expected}"


# Boxes "low" and "high" are one and the same cube; the faces of "back" lie 100 um behind theirs, or before them.
TWINS = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody>
  <geom name="low" type="box" size="1 1 1"/><geom name="high" type="box" size="1 1 1"/>
  <geom name="back" type="box" size="1 1 1" pos="1e-4 0 0"/><geom name="ball" type="sphere" size="3" pos="9 0 0"/>
</worldbody></mujoco>
""")
LOW, HIGH, BACK, BEHIND = range(4)
INTO = ((-4.0, 0.0, 0.0), (1.0, 0.0, 0.0))
BESIDE = ((-4.0, 1 + 5e-6, 0.0), (1.0, 0.0, 0.0))  # 5 um past the cubes' edge, to the ball at 10
BESIDE_FAR = ((-4.0, 1 + 1e-4, 0.0), (1.0, 0.0, 0.0))
WITHIN = ((-4.0, 0.0, 1.0), (1.0, 0.0, 0.0))  # in the plane of the cubes' tops
OUT_OF = ((1 - 5e-6, 0.0, 0.0), (1.0, 0.0, 0.0))  # from 5 um inside the cubes' right sides


@pytest.mark.parametrize(
    ("ray", "answer", "verdict"),
    [
        pytest.param(INTO, (3.0, HIGH, (-1, 0, 0)), Verdict.AGREE, id="tied, no band needed"),
        pytest.param(INTO, (3.0001, BACK, (-1, 0, 0)), Verdict.WRONG, id="not tied, no band"),
        pytest.param(BESIDE, (3.0, LOW, (-1, 0, 0)), Verdict.EDGE, id="what the neighbour hits"),
        pytest.param(BESIDE, (3.0, HIGH, (-1, 0, 0)), Verdict.EDGE, id="what is tied with what the neighbour hits"),
        pytest.param(BESIDE, (3.0001, BACK, (-1, 0, 0)), Verdict.WRONG, id="100 um behind what the neighbour hits"),
        pytest.param(BESIDE, (3.0, BACK, (-1, 0, 0)), Verdict.WRONG, id="where the other is, by a third's name"),
        pytest.param(BESIDE, (3.0, HIGH, (1, 0, 0)), Verdict.WRONG, id="tied, normal flipped"),
        pytest.param(BESIDE, (3.0, HIGH, (0, 0, 1)), Verdict.WRONG, id="tied, normal of a face that is not met"),
        pytest.param(BESIDE, (3.0003, HIGH, (-1, 0, 0)), Verdict.WRONG, id="tied, distance out of the band"),
        pytest.param(BESIDE, (3.0, BEHIND, (-1, 0, 0)), Verdict.WRONG, id="the ball where the cubes are"),
        pytest.param(BESIDE_FAR, (3.0, HIGH, (-1, 0, 0)), Verdict.WRONG, id="tied, 100 um past the edge"),
        pytest.param(WITHIN, (3.0, HIGH, (-1, 0, 0)), Verdict.AGREE, id="within a face, by the side"),
        pytest.param(WITHIN, (3.0, HIGH, (0, 0, 1)), Verdict.EDGE, id="within a face, by the face"),
        pytest.param(WITHIN, (3.0, HIGH, (0, 1, 0)), Verdict.WRONG, id="within a face, by another"),
        pytest.param(WITHIN, (2.9, HIGH, (0, 0, 1)), Verdict.WRONG, id="within a face's plane, before the face"),
        pytest.param(OUT_OF, (5e-6, HIGH, (1, 0, 0)), Verdict.AGREE, id="out of both"),
        pytest.param(OUT_OF, (0.0, HIGH, (1, 0, 0)), Verdict.AGREE, id="out of both, on the surface"),
        pytest.param(OUT_OF, (1.05e-4, BACK, (1, 0, 0)), Verdict.EDGE, id="out of the third, as from just outside"),
        pytest.param(OUT_OF, (3e-4, BACK, (1, 0, 0)), Verdict.WRONG, id="out of the third, too far"),
    ],
)
def test_a_tie_in_the_band_excuses_only_what_lies_in_one_place(
    ray: tuple[tuple[float, float, float], tuple[float, float, float]], answer: Answer, verdict: Verdict
) -> None:
    data = mujoco.MjData(TWINS)
    mujoco.mj_kinematics(TWINS, data)
    got = oracle.compare(TWINS, data, ray[0], [ray[1]], hits(answer))
    assert Verdict(got.verdict[0]) == verdict, f"got {answer}, mj_ray says {got.expected}"


def test_errors_are_those_of_the_rays_and_the_judge_keeps_their_order() -> None:
    directions = np.array([(1.0, 0, 0), (0, 0, 1), (1, 0, 0)])
    got = oracle.compare(MODEL, DATA, (-4, 0, 0), directions, hits((3 + 2e-5, BOX, (-1, 0, 0)), MISS, MISS))
    np.testing.assert_allclose(got.error, [2e-5, 0, np.inf], rtol=1e-6)
    np.testing.assert_allclose(got.scaled, [0.5, 0, np.inf], rtol=1e-6)
    assert got.verdict.tolist() == [Verdict.AGREE, Verdict.AGREE, Verdict.WRONG]
    assert got.where(Verdict.WRONG).tolist() == [2]
    assert got.things().tolist() == [BOX, -1, BOX]


def test_hits_of_other_rays_are_refused() -> None:
    with pytest.raises(ValueError, match="hits of 2 rays expected"):
        oracle.compare(MODEL, DATA, (0, 0, 0), np.eye(3)[:2], hits(MISS))


Fault = Callable[[RayHits], RayHits]


def rounded(true: RayHits) -> RayHits:
    """Return the hits with distances and normals rounded to float32."""
    return RayHits(true.distance.astype("f4").astype(float), true.geom_id, true.normal.astype("f4").astype(float))


def replaced(**fields: Callable[[RayHits], Any]) -> Fault:
    """Return a fault that replaces these fields."""
    return lambda true: true._replace(**{name: make(true) for name, make in fields.items()})


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(replaced(distance=lambda t: t.distance * (1 + 1e-3)), id="scaled"),
        pytest.param(replaced(distance=lambda t: np.where(t.geom_id < 0, 0, t.distance)), id="0 on a miss"),
        pytest.param(replaced(normal=lambda t: -t.normal), id="flipped"),
        pytest.param(replaced(geom_id=lambda t: np.roll(t.geom_id, 1)), id="shifted"),
        pytest.param(replaced(normal=lambda t: np.nan * t.normal), id="NaN"),
    ],
)
def test_a_broken_caster_is_wrong_and_mj_ray_in_float32_is_not(fault: Fault) -> None:
    model = scenes.scene(3)
    data = scenes.state(model, 3, 1)
    origins, directions = (part[:150] for part in scenes.rays(model, data, 3, 1, "towards"))
    true = rounded(oracle.Oracle(model, data).cast(origins, directions))
    right = oracle.compare(model, data, origins, directions, true)
    assert (right.verdict == Verdict.AGREE).all()
    assert right.scaled.max() < 0.1
    broken = fault(true)
    changed = np.flatnonzero(
        (broken.distance != true.distance)
        | (broken.geom_id != true.geom_id)
        | (broken.normal != true.normal).any(axis=1)
    )
    wrong = oracle.compare(model, data, origins, directions, broken).where(Verdict.WRONG)
    assert set(wrong) <= set(changed)
    assert len(wrong) > 0.5 * len(changed) > 0


@pytest.mark.parametrize("seed", range(4))
def test_a_caster_whose_rays_are_rounded_to_float32_is_never_wrong(seed: int) -> None:
    """Rounding moves rays by less than the edge band, so the search must find those that graze or pass an edge."""
    model = scenes.scene(seed)
    data = scenes.state(model, seed, 0)
    for kind in scenes.KINDS:
        origins, directions = scenes.rays(model, data, seed, 0, kind)
        near = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        moved = rounded(oracle.Oracle(model, data).cast(origins.astype("f4"), near.astype("f4")))
        assert_none_wrong(model, data, origins, directions, moved, what=f"seed {seed}, {kind}")
