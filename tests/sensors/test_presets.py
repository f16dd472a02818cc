"""Presets carry the devices' figures, say where they are from, and give way to what a user writes."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.presets import load_preset, preset_names
from rigcast.sensors.specs.sensor_spec import SensorSpec

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
CLASSES: dict[str, type[SensorSpec]] = {"lidar": Lidar, "depth_camera": DepthCamera}


def make(preset: str, **arguments: Any) -> SensorSpec:
    sensor_class = CLASSES[load_preset(preset).type]
    return sensor_class(**{"name": "top", "mount": Mount(), "preset": preset, **arguments})


@pytest.mark.parametrize(
    ("preset", "shape"),
    [("velodyne_vlp16", (16, 1808)), ("ouster_os1_64", (64, 1024)), ("realsense_d435", (480, 848))],
)
def test_preset_makes_the_device(preset: str, shape: tuple[int, int]) -> None:
    assert make(preset).pattern(MODEL).shape == shape


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_complete(name: str) -> None:
    preset = load_preset(name)
    assert make(name).preset == name
    assert preset.description
    assert preset.source
    assert preset.assumed
    assert not {"name", "mount", "type", "preset"} & preset.sensor.keys()


def test_vlp16_is_the_makers_table() -> None:
    """The manual lists lasers in the order they fire (p. 54) and 55.296 us per firing of all (p. 62)."""
    firing_order = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
    sensor = load_preset("velodyne_vlp16").sensor
    assert sensor["elevation_deg"] == sorted(firing_order)
    assert abs(sensor["columns"] - 1 / sensor["rate_hz"] / 55.296e-6) < 0.5


def test_os1_is_the_makers_table() -> None:
    sensor = load_preset("ouster_os1_64").sensor
    np.testing.assert_allclose(sensor["elevation_deg"], np.linspace(16.6, -16.6, 64), atol=5.1e-5)
    assert (sensor["min_range"], sensor["max_range"]) == (0.8, 120)


@pytest.mark.parametrize(
    ("preset", "arguments"),
    [
        ("velodyne_vlp16", {"rate_hz": 20.0, "columns": 900, "max_range": 50.0}),
        ("velodyne_vlp16", {"elevation_deg": (0.0,)}),
        ("realsense_d435", {"fov_y_deg": 60.0, "resolution": (424, 240)}),
        ("realsense_d435", {"fx": 430.0, "fy": 430.0, "cx": 424.0, "cy": 240.0, "fov_y_deg": None}),
    ],
)
def test_given_keys_win(preset: str, arguments: dict[str, Any]) -> None:
    spec = make(preset, **arguments)
    assert {key: getattr(spec, key) for key in arguments} == arguments


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
        (Lidar, "vlp16", "unknown preset 'vlp16', .*did you mean 'velodyne_vlp16'?"),
        (Lidar, "../secrets", "unknown preset '../secrets'"),
        (
            Lidar,
            "realsense_d435",
            "'realsense_d435' is a depth_camera, expected a lidar: ouster_os1_64, velo",
        ),
        (
            DepthCamera,
            "velodyne_vlp16",
            "'velodyne_vlp16' is a lidar, expected a depth_camera: realsense_d435",
        ),
        (Lidar, 3, "preset: must be a string, got 3"),
        (Lidar, ["velodyne_vlp16"], "preset: must be a string, got"),
    ],
)
def test_unfit_presets_are_refused(sensor_class: type[Lidar] | type[DepthCamera], preset: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        sensor_class(name="top", mount=Mount(), preset=preset)
    assert len(str(caught.value).splitlines()) == 1


def test_load_preset_names_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'ouster_os1_64'"):
        load_preset("ouster_os1")
