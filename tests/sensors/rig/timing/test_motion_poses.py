"""The parts of a reading with motion: slots of rays, the steps that it spans, and poses between them."""

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast.sensors.rig.timing.motion import PACKED_SLOT, SLOT, Firings, History, Knot, Track, slerp
from rigcast.sensors.scene.parts.part import ShapePoses

NOTHING = ShapePoses(np.empty((0, 3)), np.empty((0, 9)))


def knot(time: float, pose: NDArray[np.float64] | None = None) -> Knot:
    return Knot(time, NOTHING, {"eye": np.eye(4) if pose is None else pose})


def turned(axis: NDArray[np.float64], angle: float, position: tuple[float, float, float]) -> NDArray[np.float64]:
    quaternion, matrix, pose = np.empty(4), np.empty(9), np.eye(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis / np.linalg.norm(axis), angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    pose[:3, :3], pose[:3, 3] = matrix.reshape(3, 3), position
    return pose


# column period [s], rows and when each fires after the one before [s], and the slot that is expected
@pytest.mark.parametrize(
    ("period", "rows", "delay", "packed", "slot"),
    [
        (97.65625e-6, 64, 0.0, True, SLOT),
        (1e-6, 40, 0.0, True, SLOT),
        (55.296e-6, 16, 2.304e-6, False, SLOT),
        (55.296e-6, 16, 2.304e-6, True, PACKED_SLOT),
        (1 / 7200, 1, 0.0, False, SLOT),
    ],
)
def test_rays_of_a_firing_are_within_a_slot_of_each_other(
    period: float, rows: int, delay: float, packed: bool, slot: float
) -> None:
    times = (period * np.arange(1000) + delay * np.arange(rows)[:, None]).ravel()
    firings = Firings.of(times, packed=packed)
    error = times - firings.times[firings.of_ray]
    assert np.abs(error).max() <= slot / 2 + 1e-12
    if period > slot and not delay:
        assert not error.any(), "columns that are farther apart have their exact time"
    assert (np.diff(firings.times) > 0).all()
    assert firings.end == times.max()
    assert set(firings.of_ray.tolist()) == set(range(len(firings.times)))


# begin, end, the steps wanted, of steps at 0, 1, 2, 3
@pytest.mark.parametrize(
    ("begin", "end", "wanted"),
    [
        (0.5, 2.5, [0, 1, 2, 3]),
        (1.0, 2.0, [1, 2]),
        (1.2, 1.4, [1, 2]),
        (2.0, 2.0, [2, 2]),
        (-1.0, 0.0, [0, 0]),
        (3.0, 3.1, [3, 3]),
    ],
)
def test_history_gives_the_steps_that_a_reading_spans(begin: float, end: float, wanted: list[int]) -> None:
    history = History()
    for time in range(4):
        history.add(knot(time))
    assert [each.time for each in history.over(begin, end)] == wanted


def test_history_forgets_what_no_reading_spans() -> None:
    history = History()
    for time in range(6):
        history.add(knot(time))
    history.forget_before(3.5)
    assert [each.time for each in history.over(-9.0, 9.0)] == [3, 4, 5]
    history.forget_before(5.0)
    assert [each.time for each in history.over(-9.0, 9.0)] == [5, 5]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("angle", [1e-12, 1e-7, 1e-3, 0.5, 3.1])
def test_a_turn_at_a_steady_pace_is_followed_exactly(seed: int, angle: float) -> None:
    rng = np.random.default_rng(seed)
    axis, start = rng.normal(size=3), turned(rng.normal(size=3), rng.uniform(0, 3), (1, 2, 3))
    end = start @ turned(axis, angle, (0, 0, 0))
    end[:3, 3] = 4, 0, 3
    times = np.array([10.0, 10.5, 10.75, 11.0])
    track = Track.along([knot(10, start), knot(11, end)], "eye", times)
    for k, fraction in enumerate(times - 10):
        expected = start @ turned(axis, fraction * angle, (0, 0, 0))
        np.testing.assert_allclose(track.rotation[k], expected[:3, :3], atol=1e-12, err_msg=f"seed {seed}")
        np.testing.assert_allclose(track.position[k], [1 + 3 * fraction, 2 - 2 * fraction, 3])


def test_turns_go_the_shorter_way() -> None:
    start, end = np.array([[1.0, 0, 0, 0]]), -np.array([[np.cos(0.1), np.sin(0.1), 0, 0]])
    middle = slerp(start, end, np.array([0.5]))[0]
    np.testing.assert_allclose(middle, [np.cos(0.05), np.sin(0.05), 0, 0], atol=1e-15)


def test_times_between_many_steps_and_beyond_them() -> None:
    poses = [turned(np.array([0.0, 0, 1]), 0.1 * k, (k, 0, 0)) for k in range(4)]
    track = Track.along(
        [knot(k, pose) for k, pose in enumerate(poses)], "eye", np.array([-1.0, 0.25, 1.0, 2.5, 3.0, 9.0])
    )
    np.testing.assert_array_equal(track.span, [0, 0, 1, 2, 2, 2])
    np.testing.assert_allclose(track.fraction, [0, 0.25, 0, 0.5, 1, 1])
    np.testing.assert_allclose(track.position[:, 0], [0, 0.25, 1, 2.5, 3, 3])


def test_a_pose_that_is_not_a_number_stays_so() -> None:
    lost = np.full((4, 4), np.nan)
    track = Track.along([knot(0), knot(1, lost)], "eye", np.array([0.5]))
    assert np.isnan(track.position).all()
    assert np.isnan(track.rotation).all()
