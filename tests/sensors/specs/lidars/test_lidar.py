"""A lidar's rays point where its table of beams says."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.lidars.lidar import Lidar
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
        ({"clockwise": True}, 0, 1, (0, -1, 0)),
        ({"clockwise": True, "columns": 3, "azimuth_deg": [-90, 90]}, 0, 0, (0, 1, 0)),
        ({"clockwise": True, "columns": 3, "azimuth_deg": [-90, 90]}, 0, 2, (0, -1, 0)),
        ({"columns": 4, "azimuth_deg": [-180, 180]}, 0, 0, (-1, 0, 0)),
        ({"columns": 4, "azimuth_deg": [-180, 180]}, 0, 3, (0, 1, 0)),
        ({"columns": 4, "azimuth_deg": [90, 450]}, 0, 3, (1, 0, 0)),
        ({"columns": 4, "azimuth_deg": [0, 360], "clockwise": True}, 0, 0, (1, 0, 0)),
        ({"columns": 4, "azimuth_deg": [0, 360], "clockwise": True}, 0, 1, (0, -1, 0)),
        ({"columns": 1, "azimuth_deg": [0, 360]}, 0, 0, (1, 0, 0)),
        ({"clockwise": True, "azimuth_offset_deg": [90]}, 0, 0, (0, 1, 0)),
        # 5 readings/s, 0.04 s a column: 72 deg on each; the second row 0.02 s later, so 36 deg further
        (
            {"columns": 5, "rate_hz": 5, "elevation_deg": [0, 0], "firing_time_us": [0, 20e3]},
            1,
            2,
            (-1, 0, 0),
        ),
        (
            {"columns": 5, "rate_hz": 5, "elevation_deg": [0, 0], "firing_time_us": [20e3, 0], "clockwise": True},
            0,
            2,
            (-1, 0, 0),
        ),
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


MS = 1e-3


@pytest.mark.parametrize(
    ("arguments", "times"),
    [
        pytest.param({}, None, id="no rate"),
        pytest.param({"firing_time_us": [0]}, None, id="no rate, one row"),
        pytest.param({"rate_hz": 10}, [[0, 25 * MS, 50 * MS, 75 * MS]], id="a turn"),
        pytest.param({"rate_hz": 10, "clockwise": True}, [[0, 25 * MS, 50 * MS, 75 * MS]], id="clockwise"),
        pytest.param({"rate_hz": 10, "scan_time": 0.0}, None, id="flash"),
        pytest.param({"rate_hz": 10, "scan_time": 0.09}, [[0, 30 * MS, 60 * MS, 90 * MS]], id="own time"),
        pytest.param({"scan_time": 0.09}, [[0, 30 * MS, 60 * MS, 90 * MS]], id="own time, no rate"),
        pytest.param({"rate_hz": 10, "azimuth_deg": [-180, 180]}, [[0, 25 * MS, 50 * MS, 75 * MS]], id="a turn"),
        pytest.param({"rate_hz": 10, "azimuth_deg": [0, 108]}, [[0, 10 * MS, 20 * MS, 30 * MS]], id="sector"),
        pytest.param(
            {"rate_hz": 10, "elevation_deg": [0, 1], "columns": 2, "firing_time_us": [1500, 500]},
            [[1 * MS, 51 * MS], [0, 50 * MS]],
            id="rows in turn",
        ),
        pytest.param(
            {"rate_hz": 10, "azimuth_deg": [0, 180], "elevation_deg": [0, 1], "columns": 1, "firing_time_us": [0, 6e4]},
            [[0], [60 * MS]],
            id="a sector of one column",
        ),
        pytest.param(
            {"elevation_deg": [0, 1], "columns": 2, "firing_time_us": [0, 500]},
            [[0, 0], [0.5 * MS, 0.5 * MS]],
            id="rows in turn, no rate",
        ),
    ],
)
def test_rays_fire_when_the_head_gets_there(arguments: dict[str, Any], times: list[list[float]] | None) -> None:
    pattern = lidar(**arguments).pattern(MODEL)
    if times is None:
        assert pattern.firing_times is None
        assert pattern.duration == 0
    else:
        assert pattern.firing_times is not None
        np.testing.assert_allclose(pattern.firing_times, np.array(times), rtol=1e-14)
        assert pattern.duration == pytest.approx(np.max(times))


@pytest.mark.parametrize(("rate_hz", "columns"), [(5, 3616), (10, 1808), (20, 904), (1e6 / 55.296, 1)])
def test_a_column_period_gives_as_many_columns_as_a_turn_has_time_for(rate_hz: float, columns: int) -> None:
    spec = Lidar(name="top", mount=Mount(), elevation_deg=[0], column_period_us=55.296, rate_hz=rate_hz)
    pattern = spec.pattern(MODEL)
    assert pattern.shape == (1, columns)
    times = np.arange(columns) * 55.296e-6
    turned = 2 * np.pi * rate_hz * times
    np.testing.assert_allclose(pattern.directions[0, :, 0], np.cos(turned), atol=1e-12)
    np.testing.assert_allclose(pattern.directions[0, :, 1], np.sin(turned), atol=1e-12)
    if columns > 1:
        assert pattern.firing_times is not None
        np.testing.assert_allclose(pattern.firing_times, times[None], rtol=1e-14)


def test_beams_leave_from_where_ousters_formula_has_them() -> None:
    """x = (r - n) cos(th_e + th_a) cos phi + n cos th_e, and so on, with r measured from the axis (Ouster SDK)."""
    altitude, azimuth, n, width, r = np.array([20.95, 1.12, -21.82]), np.array([4.21, -1.4, -4.21]), 0.015806, 16, 7.5
    spec = lidar(elevation_deg=altitude, azimuth_offset_deg=-azimuth, columns=width, clockwise=True, origin_radius=n)
    pattern = spec.pattern(MODEL)
    th_e = 2 * np.pi * (1 - np.arange(width) / width)[None]
    th_a, phi = -2 * np.pi * azimuth[:, None] / 360, 2 * np.pi * altitude[:, None] / 360
    x = (r - n) * np.cos(th_e + th_a) * np.cos(phi) + n * np.cos(th_e)
    y = (r - n) * np.sin(th_e + th_a) * np.cos(phi) + n * np.sin(th_e)
    z = (r - n) * np.sin(phi) + 0 * th_e
    assert pattern.origins is not None
    ends = pattern.origins + (r - n) * pattern.directions
    np.testing.assert_allclose(ends, np.stack([x, y, z], axis=-1), atol=1e-12)


def test_rows_have_their_own_heights() -> None:
    pattern = lidar(elevation_deg=[0, 1], origin_height=[0.01, -0.02]).pattern(MODEL)
    np.testing.assert_array_equal(pattern.origins, np.broadcast_to([[[0, 0, 0.01]], [[0, 0, -0.02]]], (2, 4, 3)))


def test_everything_but_the_optics_defaults_to_the_ideal() -> None:
    spec = lidar()
    assert (spec.type, spec.rate_hz, spec.min_range, spec.max_range) == ("lidar", None, 0.0, np.inf)


def test_a_value_without_a_name_is_refused_and_what_is_required_named_first() -> None:
    made: Any = Lidar
    with pytest.raises(
        InputError, match=r"^Lidar: got 'top' without a name, expected some of name=\.\.\., mount=\.\.\., "
    ):
        made("top")


def test_specs_are_equal_by_value_and_cannot_be_changed() -> None:
    assert lidar() == lidar(elevation_deg=np.zeros(1))
    assert hash(lidar()) == hash(lidar())
    with pytest.raises(
        InputError, match=r"^Lidar: columns cannot be set; Lidar\.model_copy\(update=...\) gives another"
    ):
        lidar().columns = 5
    with pytest.raises(InputError, match=r"^Lidar: columns cannot be deleted; Lidar\.model_copy\(update=...\) gives"):
        del lidar().columns


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
        ({"firing_time_us": [1, 2]}, "firing_time_us: must have one value per row .*, 1, got 2"),
        ({"origin_height": [1, 2]}, "origin_height: must have one value per row .*, 1, got 2"),
        ({"firing_time_us": [-1]}, r"firing_time_us\[0\]: must be greater than or equal to 0, got -1"),
        ({"column_period_us": 50}, "give columns or column_period_us, got both"),
        ({"rate_hz": 10, "scan_time": 0.11}, r"a reading takes 0.11 s, longer than 1 / rate_hz, 0.1 s"),
        ({"rate_hz": 10, "elevation_deg": [0, 1], "firing_time_us": [0, 26000]}, "a reading takes 0.101 s, longer"),
        ({"phase": 0.1}, "phase: needs rate_hz, got none"),
        ({"jitter": 0.1, "phase": 0.1}, "phase and jitter: needs rate_hz"),
        ({"rate_hz": 10, "phase": 0.1}, "phase: must be below 1 / rate_hz, 0.1 s, got 0.1 s"),
        ({"rate_hz": 10, "jitter": 0.05}, "jitter: must be below 0.5 / rate_hz, 0.05 s, got 0.05 s"),
        ({"latency": -1}, "latency: must be greater than or equal to 0, got -1"),
        ({"frame_loss": 1.5}, "frame_loss: must be less than or equal to 1, got 1.5"),
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
        ({"mount": "torso"}, "mount: must be a mapping of body, site, camera, pos, quat, euler_deg, got 'torso'"),
        ({"mount": {"bdy": "torso"}}, "mount.bdy: unknown key 'bdy'.*did you mean 'body'?"),
        ({"directions": [[1, 0, 0]]}, "unknown key 'directions', which belongs in 'rays'"),
        ({"colums": 5}, "unknown key 'colums', .*did you mean 'columns'?"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        lidar(**arguments)


@pytest.mark.parametrize(
    "arguments", [{"colums": 5}, {"columns": 0}, {"min_range": 5, "max_range": 5}, {"name": "a b"}]
)
def test_a_copy_is_refused_what_the_constructor_is(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        lidar(**arguments)
    with pytest.raises(InputError) as of_copy:
        lidar().model_copy(update=arguments)
    assert str(of_copy.value).split(": ", 1)[1] == str(caught.value).split(": ", 1)[1]


def test_a_copy_takes_other_values_and_drops_those_that_they_replace() -> None:
    assert lidar(rate_hz=10).model_copy(update={"columns": 8}) == lidar(rate_hz=10, columns=8)
    copy = lidar(rate_hz=10).model_copy(update={"column_period_us": 50.0})
    assert (copy.columns, copy.column_period_us) == (0, 50)  # 0: given by the period
    assert Mount(body="a").model_copy(update={"pos": (1, 2, 3)}) == Mount(body="a", pos=(1, 2, 3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "elevation_deg and columns: required where no preset gives them"),
        ({"preset": "livox_avia", "columns": 100}, "elevation_deg: required where no preset gives it"),
    ],
)
def test_optics_are_required(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Lidar(name="top", mount=Mount(), **arguments)


@pytest.mark.parametrize(
    ("arguments", "rays"),
    [
        ({"elevation_deg": [0.0] * 1000, "columns": 100_000}, "1.00e+8"),
        ({"elevation_deg": [0, 1], "column_period_us": 1e-4, "rate_hz": 10}, "2.00e+9"),
        ({"preset": "velodyne_vlp16", "rate_hz": 1e-5}, "2.89e+10"),
        ({"preset": "livox_avia", "rate_hz": 1e-4}, "2.40e+9"),
        ({"preset": "livox_mid360", "rate_hz": 1e-4}, "2.00e+9"),
    ],
)
def test_a_reading_has_no_more_rays_than_memory_may_hold(arguments: dict[str, Any], rays: str) -> None:
    with pytest.raises(InputError, match=rf"makes {re.escape(rays)} rays, expected at most 67108864"):
        Lidar(name="top", mount=Mount(), **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rate_hz": None}, "column_period_us is for full turns at rate_hz"),
        ({"rate_hz": 10, "azimuth_deg": (0, 90)}, "column_period_us is for full turns at rate_hz"),
        ({"rate_hz": 10, "scan_time": 0.0}, "column_period_us is for full turns at rate_hz"),
        ({"rate_hz": 30_000}, "column_period_us: must be at most 1 / rate_hz, got 50 us"),
    ],
)
def test_a_column_period_needs_a_turn(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Lidar(name="top", mount=Mount(), elevation_deg=[0], column_period_us=50, **arguments)


def test_all_faults_are_told_at_once() -> None:
    with pytest.raises(InputError) as caught:
        lidar(columns=-1, rate_hz="fast", bogus=1)
    assert [line.split(":")[1].strip() for line in str(caught.value).splitlines()] == [
        "rate_hz",
        "columns",
        "bogus",
    ]
    assert "pydantic" not in str(caught.value)


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("rate_hz", [None, 10])
@pytest.mark.parametrize("columns", [1, 2, 360, 1024])
def test_a_sector_of_a_turn_is_a_turn(columns: int, rate_hz: float | None, clockwise: bool) -> None:
    """Its two ends are one direction, which must not be measured twice."""
    given: dict[str, Any] = {"columns": columns, "rate_hz": rate_hz, "clockwise": clockwise, "firing_time_us": [7]}
    turn, sector = (lidar(**given, **more).pattern(MODEL) for more in ({}, {"azimuth_deg": [0, 360]}))
    np.testing.assert_allclose(sector.directions, turn.directions, atol=1e-12)
    np.testing.assert_array_equal(sector.firing_times, turn.firing_times)
