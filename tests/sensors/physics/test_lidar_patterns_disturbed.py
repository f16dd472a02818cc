"""Effects of lidars whose rays fire one after the other, change between readings, or have many origins."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from lidar_scenes import SEED, model_of, wall

from rigcast import Lidar, LidarFrame, Mount, Rig
from rigcast.sensors.specs.lidars.effects import Beam, Detection, Noise, Weather
from rigcast.sensors.specs.lidars.ray_file import RayFile
from rigcast.sensors.specs.lidars.rosette import Rosette, Wedge

WEDGE = Wedge(rpm=7294, tilt_deg=-18, index=1.5, tilted_first=False)
PATTERNS: dict[str, dict[str, Any]] = {
    "table": {"elevation_deg": [-3, 0, 3], "columns": 20, "firing_time_us": [0, 5, 10], "azimuth_deg": (-40, 40)},
    "origins": {"elevation_deg": [-3, 0, 3], "columns": 20, "azimuth_deg": (-40, 40), "origin_radius": 0.3},
    "rosette": {"rosette": Rosette(wedges=[WEDGE], sample_rate_hz=1000)},
}


@pytest.fixture(params=[*PATTERNS, "ray_file"])
def pattern(request: pytest.FixtureRequest, tmp_path: Path) -> dict[str, Any]:
    if request.param != "ray_file":
        return PATTERNS[request.param]
    turned = np.arange(300.0)
    table = np.stack([1e-3 * turned, 40 * np.sin(turned), 5 * np.cos(turned), turned // 50], axis=1)
    np.save(tmp_path / "rays.npy", table)
    return {"ray_file": RayFile(path=tmp_path / "rays.npy")}


def later_readings(pattern: dict[str, Any], **effects: Any) -> tuple[Lidar, list[LidarFrame]]:
    """A lidar, and its readings of a wall 5 m ahead at the times 0.1 s and 0.3 s."""
    spec = Lidar(**{"name": "top", "mount": Mount(), "rate_hz": 10, **pattern, **effects})
    model = model_of(wall("ahead", 5))
    rig, frames = Rig(model, [spec], seed=SEED), []
    for time in (0.1, 0.3):
        data = mujoco.MjData(model)
        data.time = time
        frame = rig.sense(data)["top"]
        assert isinstance(frame, LidarFrame)
        frames.append(frame)
    return spec, frames


@pytest.mark.parametrize(
    "effects",
    [
        {"max_surfaces": 2},
        {"returns": "dual"},
        {"noise": Noise(range_std=1e-9)},
        {"beam": Beam(divergence_deg=(1e-6, 1e-6), rings=2)},
        {"detection": Detection(range=1e5), "weather": Weather(visibility=1e7)},
    ],
    ids=lambda effects: next(iter(effects)),
)
def test_effects_too_small_to_see_change_nothing(pattern: dict[str, Any], effects: dict[str, Any]) -> None:
    _, plain = later_readings(pattern)
    _, disturbed = later_readings(pattern, **effects)
    for ideal, frame in zip(plain, disturbed, strict=True):
        distance, points = frame.range.numpy(), frame.points.numpy()
        if effects.get("returns") == "dual":
            distance, points = distance[..., 0], points[..., 0, :]
        assert np.isfinite(distance).any()
        np.testing.assert_allclose(distance, ideal.range.numpy(), rtol=1e-5)
        np.testing.assert_allclose(points, ideal.points.numpy(), rtol=1e-5, atol=1e-4)


def test_angular_noise_is_about_the_rays_of_the_reading(pattern: dict[str, Any]) -> None:
    """A ray deflected by a small angle a meets the wall R a tan(incidence) farther or nearer, to first order."""
    _, plain = later_readings(pattern)
    _, noisy = later_readings(pattern, noise=Noise(angle_std_deg=0.01))
    for ideal, frame in zip(plain, noisy, strict=True):
        error = frame.range.numpy() - ideal.range.numpy()
        error = error[np.isfinite(error)]
        assert error.size >= 60
        assert 0 < np.std(error) < 0.01
        assert np.abs(error).max() < 0.02


def test_both_returns_of_a_ray_have_its_ring_column_and_stamp(pattern: dict[str, Any]) -> None:
    spec, frames = later_readings(pattern, returns="dual")
    made = spec.pattern(mujoco.MjModel.from_xml_string("<mujoco/>"))
    for frame in frames:
        fired = made.at(frame.time)
        assert frame.range.shape == (*made.shape, 2)
        assert fired.firing_times is not None
        assert fired.ring is not None
        assert fired.column is not None
        for field, expected in (
            (frame.stamp, frame.time + fired.firing_times),
            (frame.ring, fired.ring),
            (frame.column, fired.column),
        ):
            np.testing.assert_array_equal(field.numpy(), np.repeat(expected[..., None], 2, axis=-1))
