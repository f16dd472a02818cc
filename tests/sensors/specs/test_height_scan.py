"""A height scan's rays start on a level grid and go straight down."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.mount import Mount, aligned

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")


def scan(**arguments: Any) -> HeightScan:
    return HeightScan(**{"name": "feet", "mount": Mount(), "size": (1.6, 1.0), "spacing": 0.1, **arguments})


@pytest.mark.parametrize(
    ("size", "spacing", "columns", "rows"),
    [((1.6, 1.0), 0.1, 17, 11), ((0.2, 0.1), 1.0, 1, 1), ((0.25, 0.3), 0.1, 3, 4), ((1.0, 2.0), 0.5, 3, 5)],
)
def test_grid_is_centred_and_x_runs_first(size: tuple[float, float], spacing: float, columns: int, rows: int) -> None:
    pattern = scan(size=size, spacing=spacing).pattern(MODEL)
    assert pattern.shape == (columns * rows,)
    assert pattern.origins is not None
    grid = pattern.origins.reshape(rows, columns, 3)
    np.testing.assert_allclose(grid.mean(axis=(0, 1)), 0, atol=1e-12)
    np.testing.assert_allclose(np.diff(grid[..., 0], axis=1), spacing)
    np.testing.assert_allclose(np.diff(grid[..., 1], axis=0), spacing)
    np.testing.assert_array_equal(grid[..., 2], 0)
    np.testing.assert_array_equal(pattern.directions, np.tile([0, 0, -1], (columns * rows, 1)))


@pytest.mark.parametrize(
    ("euler_deg", "yaw_deg"),
    [((0, 0, 0), 0), ((0, 0, 130), 130), ((20, -30, 60), 60), ((0, 90, 0), 0), ((170, 10, -90), -90)],
)
def test_yaw_alignment_keeps_position_and_heading(euler_deg: tuple[float, float, float], yaw_deg: float) -> None:
    upright = aligned(Mount(pos=(1, 2, 3), euler_deg=euler_deg).offset, "yaw")
    expected = Mount(pos=(1, 2, 3), euler_deg=(0, 0, yaw_deg)).offset
    np.testing.assert_allclose(upright, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"size": (1.0, 0.0)}, r"size\[1\]: must be greater than 0"),
        ({"size": 1.0}, "size: must be a list, got 1.0"),
        ({"spacing": 0}, "spacing: must be greater than 0"),
        ({"spacing": 1e-4}, r"spacing: makes 1.6e\+08 rays of size 1.6 x 1 m, expected at most 67108864"),
        ({"alignment": "body"}, "alignment: must be 'base', 'yaw' or 'world', got 'body'"),
        ({"preset": "velodyne_vlp16"}, "preset: 'velodyne_vlp16' is a lidar, expected a height_scan"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scan(**arguments)
