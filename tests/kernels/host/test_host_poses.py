"""Poses equal MuJoCo's and placed frames equal numpy's, bit for bit, also after arrays are edited in place."""

import numpy as np
import pytest
import warp as wp
from made_worlds import random_rotations

from rigcast.kernels.geometry import FARTHEST
from rigcast.kernels.host.poses import PlacedFrame, TakenPoses
from rigcast.sensors.specs.mount import Alignment, aligned, placed

COUNT = 7
DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]


def poses(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(COUNT, 3)), random_rotations(rng, COUNT).reshape(COUNT, 9)


def test_poses_are_copied_from_wherever_they_are_this_time() -> None:
    taken = TakenPoses(COUNT)
    for seed in (0, 1, 0):
        position, rotation = poses(seed)
        for step in range(3):  # the same arrays, with other values in them
            position += step
            assert taken.take(position, rotation) == 0
            np.testing.assert_array_equal(taken.position.numpy(), position, err_msg=f"seed {seed}, step {step}")
            np.testing.assert_array_equal(taken.rotation.numpy().reshape(-1, 9), rotation)


@pytest.mark.parametrize(
    ("of_position", "bad"),
    [(True, np.nan), (True, np.inf), (True, -1.01 * FARTHEST), (False, np.nan), (False, np.inf), (False, -np.inf)],
)
def test_a_pose_that_is_not_finite_or_too_far_away_is_counted_and_nowhere(of_position: bool, bad: float) -> None:
    position, rotation = poses(2)
    for row, column in ((0, 0), (3, 1), (6, 2)):
        (position if of_position else rotation)[row, column] = bad
    taken = TakenPoses(COUNT)
    assert taken.take(position, rotation) == 3
    got = taken.position.numpy()
    assert np.isnan(got[[0, 3, 6]]).all()
    np.testing.assert_array_equal(got[[1, 2, 4, 5]], position[[1, 2, 4, 5]])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("alignment", ["base", "yaw", "world"])
def test_a_frame_is_where_numpy_places_it(alignment: Alignment, device: str) -> None:
    for seed in range(20):
        (position, rotation), (offsets, turns) = poses(seed), poses(seed + 100)
        offset = np.eye(4)
        offset[:3, 3], offset[:3, :3] = offsets[0], turns[0].reshape(3, 3)
        which = seed % COUNT
        frame = PlacedFrame(which, offset, alignment, wp.get_device(device))
        for _ in range(2):
            expected = placed(position[which], rotation[which].reshape(3, 3), offset)
            check(frame, frame.place(position, rotation), aligned(expected, alignment), seed)
            position += 0.1  # the same arrays, with other values in them
        check(frame, frame.place(None, None), aligned(offset, alignment), seed)


def check(frame: PlacedFrame, pose: np.ndarray, expected: np.ndarray, seed: int) -> None:
    np.testing.assert_array_equal(pose, expected, err_msg=f"seed {seed}")
    np.testing.assert_array_equal(frame.position.numpy()[0], expected[:3, 3])
    np.testing.assert_array_equal(frame.rotation.numpy()[0], expected[:3, :3])
