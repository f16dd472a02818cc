"""A lidar's rays point where its table of beams says."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
HALF = np.sqrt(0.5)


def lidar(**arguments: Any) -> Lidar:
    return Lidar(**{"name": "top", "mount": Mount(), "elevation_deg": [0], "columns": 4, **arguments})


@pytest.mark.parametrize(
    ("arguments", "row", "column", "direction"),
    [
        ({}, 0, 0, (1, 0, 0)),
        ({}, 0, 1, (0, 1, 0)),
        ({}, 0, 2, (-1, 0, 0)),
        ({}, 0, 3, (0, -1, 0)),
        ({"elevation_deg": [-45, 45]}, 0, 0, (HALF, 0, -HALF)),
        ({"elevation_deg": [-45, 45]}, 1, 1, (0, HALF, HALF)),
        ({"elevation_deg": [90]}, 0, 2, (0, 0, 1)),
        ({"elevation_deg": [0, 0], "azimuth_offset_deg": [0, 90]}, 0, 0, (1, 0, 0)),
        ({"elevation_deg": [0, 0], "azimuth_offset_deg": [0, 90]}, 1, 0, (0, 1, 0)),
        ({"columns": 3, "azimuth_deg": [-90, 90]}, 0, 0, (0, -1, 0)),
        ({"columns": 3, "azimuth_deg": [-90, 90]}, 0, 1, (1, 0, 0)),
        ({"columns": 3, "azimuth_deg": [-90, 90]}, 0, 2, (0, 1, 0)),
        ({"columns": 1, "azimuth_deg": [90, 180]}, 0, 0, (0, 1, 0)),
    ],
)
def test_ray_points(arguments: dict[str, Any], row: int, column: int, direction: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(lidar(**arguments).pattern(MODEL).directions[row, column], direction, atol=1e-15)


def test_pattern_has_a_row_per_beam_and_says_which() -> None:
    pattern = lidar(elevation_deg=np.linspace(-30, 50, 7), columns=33).pattern(MODEL)
    assert pattern.shape == (7, 33)
    assert pattern.directions.dtype == np.float64
    np.testing.assert_allclose(np.linalg.norm(pattern.directions, axis=-1), 1, atol=1e-15)
    assert pattern.ring is not None
    assert pattern.column is not None
    assert pattern.ring.dtype == pattern.column.dtype == np.int32
    np.testing.assert_array_equal(pattern.ring, np.repeat(np.arange(7), 33).reshape(7, 33))
    np.testing.assert_array_equal(pattern.column, np.tile(np.arange(33), (7, 1)))
    assert pattern.origins is None
    assert pattern.intrinsics is None


def test_everything_but_the_optics_defaults_to_the_ideal() -> None:
    spec = lidar()
    assert (spec.type, spec.rate_hz, spec.min_range, spec.max_range) == ("lidar", None, 0.0, np.inf)


def test_specs_are_equal_by_value_and_cannot_be_changed() -> None:
    assert lidar() == lidar(elevation_deg=np.zeros(1))
    assert hash(lidar()) == hash(lidar())
    with pytest.raises(ValueError, match="frozen"):
        lidar().columns = 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "a b"}, r"Lidar 'a b': name: must match .*, got 'a b'"),
        ({"name": ""}, "name: must match"),
        ({"name": "../x"}, "name: must match"),
        ({"elevation_deg": []}, "elevation_deg: must have at least 1 value"),
        ({"elevation_deg": [0, 91]}, r"elevation_deg\[1\]: must be less than or equal to 90, got 91"),
        ({"elevation_deg": [float("nan")]}, r"elevation_deg\[0\]: .*got nan"),
        ({"elevation_deg": ["10 deg"]}, r"elevation_deg\[0\]: must be a number, got '10 deg' \(.*\[deg\]"),
        ({"azimuth_offset_deg": [1, 2]}, "azimuth_offset_deg: must have one value per row .*, 1, got 2"),
        ({"azimuth_deg": [90, 90]}, "azimuth_deg: must be .*from < to"),
        ({"azimuth_deg": [0, 361]}, "azimuth_deg: must be .*from < to <= from"),
        ({"columns": 0}, "columns: must be greater than or equal to 1, got 0"),
        ({"columns": 10**9}, "columns: must be less than or equal to 100000"),
        ({"columns": 10.0}, "columns: must be an integer, got 10.0"),
        ({"rate_hz": 0}, "rate_hz: must be greater than 0, got 0"),
        ({"rate_hz": float("inf")}, "rate_hz: must be a finite number, got inf"),
        ({"min_range": -1}, "min_range: must be greater than or equal to 0, got -1"),
        ({"min_range": float("inf")}, "min_range: must be a finite number, got inf"),
        ({"min_range": 5, "max_range": 5}, "max_range: must be above min_range, 5 m, got 5 m"),
        ({"max_range": float("nan")}, "max_range: .*got nan"),
        ({"max_range": "100m"}, r"max_range: must be a number, got '100m' \(.*\[m\]"),
        ({"mount": "torso"}, "mount: must be a mapping, got 'torso'"),
        ({"mount": {"bdy": "torso"}}, "mount.bdy: unknown key 'bdy'.*did you mean 'body'?"),
        ({"colums": 5}, "unknown key 'colums', .*did you mean 'columns'?"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        lidar(**arguments)


def test_optics_are_required() -> None:
    with pytest.raises(InputError, match="elevation_deg and columns: required where no preset is given"):
        Lidar(name="top", mount=Mount())


def test_all_faults_are_told_at_once() -> None:
    with pytest.raises(InputError) as caught:
        lidar(columns=-1, rate_hz="fast", bogus=1)
    assert [line.split(":")[1].strip() for line in str(caught.value).splitlines()] == [
        "rate_hz",
        "columns",
        "bogus",
    ]
    assert "pydantic" not in str(caught.value)
