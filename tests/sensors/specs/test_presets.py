"""Presets have the devices' figures with their sources, and users' keys take precedence over them."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.pattern import Pattern, azimuth_elevation
from rigcast.sensors.specs.presets import load_preset, preset_names
from rigcast.sensors.specs.sensor_spec import SensorSpec

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
CLASSES: dict[str, type[SensorSpec]] = {"lidar": Lidar, "depth_camera": DepthCamera}


def make(preset: str, **arguments: Any) -> SensorSpec:
    sensor_class = CLASSES[load_preset(preset).type]
    return sensor_class(**{"name": "top", "mount": Mount(), "preset": preset, **arguments})


def pattern_of(preset: str) -> Pattern:
    return make(preset).pattern(MODEL)


class Table(NamedTuple):
    """The rays of a lidar: shape, least and largest elevation [deg], time of the last ray [ms], points per second.

    first: the row that fires first. clockwise: whether the head turns clockwise.
    """

    shape: tuple[int, ...]
    elevation: tuple[float, float]
    offset: float
    duration: float
    rate: float
    clockwise: bool
    first: int


# From the makers' publications named in the files: beams, extremes and timing; the offset is the largest of a row.
TABLES = {
    "velodyne_vlp16": Table((16, 1808), (-15, 15), 0, 1807 * 0.055296 + 15 * 0.002304, 289_280, True, 0),
    "velodyne_vlp16_hires": Table((16, 1808), (-10, 10), 0, 1807 * 0.055296 + 15 * 0.002304, 289_280, True, 0),
    "velodyne_hdl32e": Table((32, 2170), (-30.67, 10.67), 0, 2169 * 0.04608 + 31 * 0.001152, 694_400, True, 0),
    "velodyne_vlp32c": Table((32, 1808), (-25, 15), 4.2, 1807 * 0.055296 + 15 * 0.002304, 578_560, True, 0),
    "velodyne_vls128": Table((128, 1875), (-25, 15), 6.354, 1874 * 0.0533333 + 17 * 0.0026667, 2_400_000, True, 4),
    "ouster_os0_128": Table((128, 1024), (-46.26, 45.75), 11.35, 102.3 / 1.024, 1_310_720, True, 0),
    "ouster_os1_128": Table((128, 1024), (-21.82, 20.95), 4.21, 102.3 / 1.024, 1_310_720, True, 0),
    "ouster_os2_128": Table((128, 1024), (-11.09, 10.76), 2.08, 102.3 / 1.024, 1_310_720, True, 0),
    "ouster_os1_64": Table((64, 1024), (-16.611, 16.611), 3.164, 102.3 / 1.024, 655_360, True, 0),
    "hesai_pandar40p": Table((40, 1800), (-24.985, 14.794), 5.208, 1799 / 18 + 0.05105, 720_000, True, 7),
    "hesai_xt32": Table((32, 2000), (-16, 15), 0, 99.95 + 31 * 0.001512, 640_000, True, 0),
    "hesai_xt32m": Table((32, 2000), (-20.8, 19.5), 0, 99.95 + 15 * 0.002888, 640_000, True, 0),
    "hesai_qt64": Table((64, 600), (-52.121, 52.133), 8.736, 599 / 6 + 0.13414, 384_000, True, 0),
    "hesai_128e4x": Table((128, 1800), (-24.71, 15.139), 4.677, 1799 / 18, 2_304_000, True, 0),
    "hesai_at128": Table((128, 1200), (-12.47, 12.93), 2.4, 99.9, 1_536_000, True, 0),
    "robosense_helios5515": Table((32, 1800), (-54.6, 14.94), 5.32, 1799 / 18 + 0.04515, 576_000, True, 0),
    "robosense_bpearl": Table((32, 1800), (2.31, 89.5), 53.4, 1799 / 18, 576_000, True, 0),
    "hokuyo_utm30lx": Table((1, 1081), (0, 0), 0, 270 / 360 * 25, 43_240, False, 0),
    "robotis_lds01": Table((1, 360), (0, 0), 0, 359 / 360 * 200, 1800, False, 0),
    "rplidar_a1": Table((1, 800), (0, 0), 0, 799 / 800 * 100, 8000, True, 0),
    "rplidar_s2": Table((1, 3200), (0, 0), 0, 3199 / 3200 * 100, 32_000, True, 0),
    "sick_lms111": Table((1, 541), (0, 0), 0, 270 / 360 * 20, 27_050, False, 0),
    "sick_tim571": Table((1, 811), (0, 0), 0, 50, 12_165, False, 0),
    "livox_mid40": Table((10_000,), (-19.2, 19.2), 0, 99.99, 100_000, False, 0),
    "livox_mid70": Table((10_000,), (-35.2, 35.2), 0, 99.99, 100_000, False, 0),
    "livox_avia": Table((24_000,), (-38.6, 38.6), 0, 99.975, 240_000, False, 0),
    "livox_tele15": Table((24_000,), (-8.1, 8.1), 0, 99.975, 240_000, False, 0),
    "livox_horizon": Table((24_000,), (-14.1, 14.1), 0, 99.975, 240_000, False, 0),
    "livox_mid360": Table((20_000,), (-7, 52), 0, 99.98, 200_000, False, 0),
}
SECTORS = {"hokuyo_utm30lx": 270, "sick_lms111": 270, "sick_tim571": 270, "hesai_at128": 120}

# Stated fields of view [deg] across and up, of the images' edges, and pixels.
CAMERAS = {
    "azure_kinect_nfov": (640, 576, 75, 65),
    "azure_kinect_nfov_binned": (320, 288, 75, 65),
    "azure_kinect_wfov": (1024, 1024, 120, 120),
    "azure_kinect_wfov_binned": (512, 512, 120, 120),
    "kinect_v1": (640, 480, 57, 43),
    "kinect_v2": (512, 424, 70.6, 60),
    "oak_d": (1280, 800, 71.9, 48.8),
    "orbbec_gemini2": (1280, 800, 91, 66),
    "orbbec_gemini305": (1280, 800, 88, 65),
    "realsense_d435": (848, 480, 88.8, 58),
    "realsense_d455": (848, 480, 88.8, 58),
    "realsense_l515": (1024, 768, 70, 55),
    "zed2": (1280, 720, 102.4, 70),
}


def test_every_preset_has_its_test() -> None:
    assert set(preset_names()) == TABLES.keys() | CAMERAS.keys()
    assert len(preset_names()) >= 25


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_says_what_it_knows_and_what_it_assumes(name: str) -> None:
    preset = load_preset(name)
    assert make(name).preset == name
    assert preset.description
    assert len(preset.source) > 30
    assert preset.file is None
    assert not {"name", "mount", "type", "preset"} & preset.sensor.keys()
    assert not preset.sensor.keys() & preset.figures.keys()
    assert "memory" not in " ".join([preset.source, *preset.assumed.values()]), "a source is one that can be read"
    not_found = {key for key, why in preset.assumed.items() if why.startswith("not found in a public source")}
    assert not_found <= preset.stated(), "what was not found must be among the figures"
    assert preset.cited(), "no device is without any source"


def test_figures_are_cited_or_assumed() -> None:
    preset = load_preset("sick_lms111")
    assert preset.stated() - preset.cited() == {"rate_hz"}
    cited = {"elevation_deg", "columns", "azimuth_deg", "min_range", "max_range", "noise", "detection"}
    assert preset.cited() == cited


@pytest.mark.parametrize("name", TABLES)
def test_a_lidars_rays_are_those_of_the_device(name: str) -> None:
    pattern, table = pattern_of(name), TABLES[name]
    spec = make(name)
    assert pattern.shape == table.shape
    steered = len(table.shape) == 1  # and covers its field of view in seconds
    _, elevation = azimuth_elevation((make(name, rate_hz=0.5).pattern(MODEL) if steered else pattern).directions)
    extremes = np.rad2deg([elevation.min(), elevation.max()])
    np.testing.assert_allclose(extremes, table.elevation, atol=0.1 if steered else 1e-9)
    assert pattern.duration * 1e3 == pytest.approx(table.duration, abs=1e-3)
    assert spec.rate_hz is not None
    assert np.prod(pattern.shape) * spec.rate_hz == table.rate
    assert pattern.duration < 1 / spec.rate_hz


@pytest.mark.parametrize("name", [name for name in TABLES if len(TABLES[name].shape) == 2])
def test_a_tables_rows_turn_as_the_device_does(name: str) -> None:
    pattern, table = pattern_of(name), TABLES[name]
    times = pattern.firing_times
    assert times is not None
    assert times.argmin() == table.first * table.shape[1]
    assert (np.diff(times, axis=1) > 0).all()
    azimuth = np.rad2deg(np.unwrap(azimuth_elevation(pattern.directions)[0], axis=1))
    steps = np.diff(azimuth, axis=1)
    assert (steps < 0).all() if table.clockwise else (steps > 0).all()
    swept = SECTORS.get(name, 360 * (1 - 1 / table.shape[1]))
    if name.startswith("velodyne"):
        swept = 3600 * np.ptp(times[0])
    np.testing.assert_allclose(np.abs(azimuth[:, -1] - azimuth[:, 0]), swept, rtol=1e-9)
    # the head's own turn between rows taken off, rows are off by their offset, which is not that of the first one
    turn = np.sign(steps[0, 0]) * swept * (times[:, 0] - times[table.first, 0]) / np.ptp(times[0])
    zero = SECTORS[name] / 2 * (1 if table.clockwise else -1) if name in SECTORS else 0
    offset = (azimuth[:, 0] - turn - zero + 180) % 360 - 180
    assert np.abs(offset).max() == pytest.approx(table.offset, abs=1e-9)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_cameras_image_is_that_of_the_device(name: str) -> None:
    width, height, across, up = CAMERAS[name]
    pattern = pattern_of(name)
    assert pattern.shape == (height, width)
    assert pattern.intrinsics is not None
    (fx, _, cx), (_, fy, cy), _ = pattern.intrinsics
    seen = [np.arctan(cx / fx) + np.arctan((width - cx) / fx), np.arctan(cy / fy) + np.arctan((height - cy) / fy)]
    np.testing.assert_allclose(np.rad2deg(seen), [across, up], atol=0.06)


def test_vlp16_is_the_makers_table() -> None:
    """The manual lists lasers in the order they fire, with their heights (p. 54); t = 55.296 k + 2.304 i us (p. 62)."""
    firing_order = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
    height = [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2]
    pattern = pattern_of("velodyne_vlp16")
    assert pattern.firing_times is not None
    assert pattern.origins is not None
    _, elevation = azimuth_elevation(pattern.directions)
    for i, (degrees, millimetres) in enumerate(zip(firing_order, height, strict=True)):
        row = sorted(firing_order).index(degrees)
        np.testing.assert_allclose(np.rad2deg(elevation[row]), degrees, atol=1e-12)
        np.testing.assert_allclose(pattern.origins[row, :, 2], millimetres / 1000)
        times = (55.296 * np.arange(1808) + 2.304 * i) * 1e-6
        np.testing.assert_allclose(pattern.firing_times[row], times, rtol=1e-12)
        turned = -2 * np.pi * 10 * times
        np.testing.assert_allclose(pattern.directions[row, :, 1], np.cos(elevation[row]) * np.sin(turned), atol=1e-9)


def test_hdl32e_fires_its_two_banks_in_turn() -> None:
    pattern = pattern_of("velodyne_hdl32e")
    assert pattern.firing_times is not None
    order = np.argsort(pattern.firing_times[:, 0])
    lower, upper = np.arange(16), np.arange(16, 32)
    np.testing.assert_array_equal(order, np.stack([lower, upper], axis=1).ravel())
    _, elevation = azimuth_elevation(pattern.directions[:, 0])
    np.testing.assert_allclose(np.diff(np.rad2deg(elevation)), 4 / 3, atol=0.01)


def test_vls128_fires_groups_of_eight() -> None:
    pattern = pattern_of("velodyne_vls128")
    assert pattern.firing_times is not None
    slots, count = np.unique(np.rint(pattern.firing_times[:, 0] / (8e-6 / 3)).astype(int), return_counts=True)
    np.testing.assert_array_equal(slots, [*range(8), *range(10, 18)])
    assert set(count.tolist()) == {8}
    # eight lasers at once are on eight different azimuths
    for slot in slots[:3]:
        rows = np.rint(pattern.firing_times[:, 0] / (8e-6 / 3)).astype(int) == slot
        assert np.unique(azimuth_elevation(pattern.directions[rows, 0])[0].round(6)).size == 8


def test_puck_hi_res_has_the_makers_heights() -> None:
    """The manual's heights [mm] of lasers 7 to 15 (p. 54); the others are symmetric to them."""
    height = {4.667: -3.7, -4.667: 3.7, 6: -4.6, -3.333: 2.7, 7.333: -5.5, -2: 1.8, 8.667: -6.5, -0.667: 0.9, 10: -7.4}
    sensor = load_preset("velodyne_vlp16_hires").sensor
    rows = dict(zip(sensor["elevation_deg"], sensor["origin_height"], strict=True))
    for degrees, millimetres in height.items():
        assert rows[degrees] == pytest.approx(millimetres / 1000)
        assert rows[-degrees] == pytest.approx(-millimetres / 1000)


def test_os1_is_the_makers_table() -> None:
    """The design values of generation 1, 0.5273 deg apart and given to 0.001 deg."""
    sensor = load_preset("ouster_os1_64").sensor
    np.testing.assert_allclose(sensor["elevation_deg"], np.linspace(16.611, -16.611, 64), atol=7e-4)
    assert sensor["azimuth_offset_deg"] == [-3.164, -1.055, 1.055, 3.164] * 16
    assert (sensor["min_range"], sensor["max_range"]) == (0.8, 120)


# distance of the beams' origins from the axis [mm], as the units' files have it
@pytest.mark.parametrize(
    ("name", "radius"), [("ouster_os0_128", 27.67), ("ouster_os1_128", 15.806), ("ouster_os2_128", 13.762)]
)
def test_ouster_beams_leave_off_the_axis(name: str, radius: float) -> None:
    pattern = pattern_of(name)
    assert pattern.origins is not None
    np.testing.assert_allclose(np.linalg.norm(pattern.origins, axis=-1), radius / 1000, rtol=1e-12)
    np.testing.assert_allclose(pattern.origins[:, 0], np.tile([radius / 1000, 0, 0], (128, 1)), atol=1e-15)


@pytest.mark.parametrize(
    ("preset", "arguments"),
    [
        ("velodyne_vlp16", {"rate_hz": 20.0, "columns": 900, "max_range": 50.0}),
        ("velodyne_vlp16", {"elevation_deg": (0.0,)}),
        ("velodyne_vlp16", {"elevation_deg": (0.0, 1.0), "firing_time_us": (0.0, 1.0)}),
        ("livox_avia", {"elevation_deg": (0.0,), "columns": 7}),
        ("realsense_d435", {"fov_y_deg": 60.0, "resolution": (424, 240)}),
        ("realsense_d435", {"fx": 430.0, "fy": 430.0, "cx": 424.0, "cy": 240.0, "fov_y_deg": None}),
    ],
)
def test_given_keys_win(preset: str, arguments: dict[str, Any]) -> None:
    spec = make(preset, **arguments)
    assert {key: getattr(spec, key) for key in arguments} == arguments


def test_a_faster_head_measures_fewer_columns() -> None:
    assert [make("velodyne_vlp16", rate_hz=rate).pattern(MODEL).shape for rate in (5, 10, 20)] == [
        (16, 3616),
        (16, 1808),
        (16, 904),
    ]


def test_other_rows_leave_the_presets_own_behind() -> None:
    spec = make("velodyne_vlp16", elevation_deg=(-1, 0, 1))
    assert isinstance(spec, Lidar)
    assert (spec.firing_time_us, spec.origin_height, spec.azimuth_offset_deg) == (None, None, None)
    assert spec.column_period_us == 55.296


def test_focal_lengths_replace_a_presets_field_of_view() -> None:
    spec = make("realsense_d435", fx=430.0, fy=430.0, cx=424.0, cy=240.0)
    assert isinstance(spec, DepthCamera)
    assert spec.fov_y_deg is None
    assert spec.resolution == (848, 480)


@pytest.mark.parametrize(
    ("sensor_class", "preset", "message"),
    [
        (
            Lidar,
            "velodyne_vlp61",
            "preset: unknown preset 'velodyne_vlp61', .*did you mean 'velodyne_vlp16'?",
        ),
        (Lidar, "vlp16", "unknown preset 'vlp16', .*did you mean 'velodyne_vlp16"),
        (Lidar, "../secrets", "unknown preset '../secrets'"),
        (Lidar, "realsense_d435", r"'realsense_d435' is a depth_camera, expected a lidar: hesai_.*\(29 in all\)"),
        (DepthCamera, "velodyne_vlp16", "'velodyne_vlp16' is a lidar, expected a depth_camera: azure_kinect_nfov"),
        (Lidar, 3, "preset: must be a string, got 3"),
        (Lidar, ["velodyne_vlp16"], "preset: must be a string, got"),
    ],
)
def test_unfit_presets_are_refused(sensor_class: type[Lidar] | type[DepthCamera], preset: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        sensor_class(name="top", mount=Mount(), preset=preset)
    assert len(str(caught.value).splitlines()) == 1


def test_load_preset_names_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'ouster_os1_"):
        load_preset("ouster_os1")
