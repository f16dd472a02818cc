"""Presets have the errors of their devices: measured errors agree with the makers' figures."""

from typing import Any

import mujoco
import numpy as np
import pytest
from confidence import SIGMAS, assert_mean, assert_normal, assert_share
from depth_scenes import WALL
from numpy.typing import NDArray
from small_scenes import model_of

from rigcast import DepthCamera, Lidar, Mount, Rig, Surface
from rigcast.sensors.specs.presets import load_preset, preset_names

CLASSES: dict[str, type[Lidar] | type[DepthCamera]] = {"lidar": Lidar, "depth_camera": DepthCamera}
BALL = '<geom name="ball" type="sphere" size="{}"/>'


def preset(name: str, **arguments: Any) -> Lidar | DepthCamera:
    return CLASSES[load_preset(name).type](name="eye", mount=Mount(), preset=name, **arguments)


def ranges(worldbody: str, spec: Lidar | DepthCamera, reflectivity: float = 0.8) -> NDArray[np.float64]:
    """The ranges [m] that a preset reads in a world of one reflectivity."""
    model = model_of(worldbody)
    rig = Rig(model, [spec], "cpu", surfaces=[Surface(body="world", reflectivity=reflectivity)])
    return rig.sense(mujoco.MjData(model))["eye"].range.numpy().astype(np.float64)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_errs_unless_told_otherwise(name: str) -> None:
    spec = preset(name)
    assert spec.has_effects
    assert spec.moves == (isinstance(spec, Lidar) or name == "zed2"), (
        "lidars sweep, and one camera has a rolling shutter"
    )
    off = ["noise", "detection"] if isinstance(spec, Lidar) else ["stereo", "time_of_flight"]
    assert not preset(name, **dict.fromkeys(off)).has_effects


# the share of the depth that the maker allows, at a depth [m]
@pytest.mark.parametrize(
    ("name", "figure", "z"),
    [("realsense_d435", "depth_error_share_at_2_m", 2.0), ("realsense_d455", "depth_error_share_at_4_m", 4.0)],
)
def test_stereo_presets_err_by_less_than_the_maker_allows(name: str, figure: str, z: float) -> None:
    spec, share = preset(name), load_preset(name).figures[figure]
    assert isinstance(spec, DepthCamera)
    assert spec.stereo is not None
    model = model_of(WALL.format(z))
    frame = Rig(model, [spec], "cpu").sense(mujoco.MjData(model))["eye"]
    depth = frame.depth.numpy().astype(np.float64)
    error = depth[np.isfinite(depth)] - z
    assert error.size >= 1e5
    focal = 240 / np.tan(np.radians(29))
    expected = z**2 * spec.stereo.disparity_std / (focal * spec.stereo.baseline)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(expected, rel=0.05)
    assert np.sqrt(np.mean(error**2)) < share * z


def test_azure_kinects_have_the_makers_noise_and_bias() -> None:
    """sigma 17 mm, bias 11 mm + 0.1 %, on the inside of a ball, which all rays meet at the same range."""
    radius = 1.5
    error = ranges(BALL.format(radius), preset("azure_kinect_nfov", resolution=(360, 288))) - radius
    assert error.size >= 1e5
    assert_normal(error, 0.011 + 0.001 * radius, 0.017, "azure_kinect_nfov")


# standard deviation at a radius [m] on a reflectivity, of the makers' figures named in the files
@pytest.mark.parametrize(
    ("name", "radius", "reflectivity", "std"),
    [
        ("livox_mid70", 20.0, 0.8, 0.02),
        ("livox_mid360", 10.0, 0.8, 0.02),
        ("ouster_os1_64", 39.0, 0.1, 0.1 * 39 / 40),
        ("robotis_lds01", 2.0, 0.8, np.hypot(0.01, 0.035 * 2)),
    ],
)
def test_lidar_presets_have_the_makers_accuracy(name: str, radius: float, reflectivity: float, std: float) -> None:
    spec = preset(name, rate_hz=1.0) if name.startswith("livox") else preset(name)
    error = ranges(BALL.format(radius), spec, reflectivity) - radius
    resolution = spec.noise.range_resolution if isinstance(spec, Lidar) and spec.noise else 0.0
    assert np.isfinite(error).all()
    assert_mean(error, 0.0, std, name)
    allowed = SIGMAS * std * np.sqrt(0.5 / error.size)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.hypot(std, resolution / np.sqrt(12)), abs=allowed)


# how far a reflectivity is seen [m], of the makers' figures named in the files
@pytest.mark.parametrize(("name", "limit", "reflectivity"), [("ouster_os1_64", 40.0, 0.1), ("livox_mid360", 40.0, 0.1)])
def test_lidar_presets_see_as_far_as_the_maker_says(name: str, limit: float, reflectivity: float) -> None:
    for radius, share in ((limit * 0.999, 1.0), (limit * 1.001, 0.0)):
        assert_share(np.isfinite(ranges(BALL.format(radius), preset(name), reflectivity)), share, f"{name} {radius}")
