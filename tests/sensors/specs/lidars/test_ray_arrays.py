"""Rays from arrays are cast as they are given, in order, and spread over readings of one size."""

import pickle
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast import Frame, Lidar, Mount, Rig
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.lidars.ray_file import RayFile

XML = """
<mujoco>
  <worldbody>
    <geom type="sphere" size="6"/>
    <geom type="box" size="0.3 2 1" pos="3 0 0"/>
  </worldbody>
</mujoco>
"""
MODEL = mujoco.MjModel.from_xml_string(XML)
RNG = np.random.default_rng(0)
DIRECTIONS = RNG.normal(size=(40, 3))
TIMES = 7 + np.arange(40) / 100
RINGS = np.arange(40) % 5
ORIGINS = RNG.uniform(-0.5, 0.5, size=(40, 3))


def lidar(rate_hz: float | None = None, **rays: Any) -> Lidar:
    return Lidar(name="l", mount=Mount(pos=(0.1, 0.2, 0.3)), rate_hz=rate_hz, rays={"directions": DIRECTIONS, **rays})


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("origins", [None, ORIGINS], ids=["from one place", "from many"])
def test_rays_are_cast_as_mj_ray_casts_them(dtype: type, origins: np.ndarray | None) -> None:
    given: NDArray[np.float64] = DIRECTIONS.astype(dtype)
    data = mujoco.MjData(MODEL)
    frame = Rig(MODEL, [lidar(directions=given, origins=origins, rings=RINGS)]).sense(data)["l"]
    mujoco.mj_kinematics(MODEL, data)
    unit = given / np.linalg.norm(given.astype(np.float64), axis=1, keepdims=True)
    starts = np.zeros((40, 3)) + (0 if origins is None else origins) + (0.1, 0.2, 0.3)
    geom = np.zeros(1, np.int32)
    expected = [mujoco.mj_ray(MODEL, data, s, d, None, 1, -1, geom) for s, d in zip(starts, unit, strict=True)]
    np.testing.assert_allclose(frame.range.numpy(), expected, rtol=1e-5)
    np.testing.assert_array_equal(frame.ring.numpy(), RINGS)
    np.testing.assert_array_equal(frame.stamp.numpy(), 0)


@pytest.mark.parametrize("scale", [1e-200, 1e-3, 1e200])
def test_directions_may_have_any_length(scale: float) -> None:
    expected = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
    found = lidar(directions=scale * DIRECTIONS).pattern(MODEL)
    np.testing.assert_allclose(found.directions, expected, rtol=1e-14)


@pytest.mark.parametrize("rate_hz", [None, 2.0, 10.0, 33.0])
def test_arrays_are_spread_over_readings_as_a_file_is(tmp_path: Any, rate_hz: float | None) -> None:
    unit = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
    azimuth, elevation = np.arctan2(unit[:, 1], unit[:, 0]), np.arcsin(unit[:, 2])
    np.save(tmp_path / "rays.npy", np.stack([TIMES, np.rad2deg(azimuth), np.rad2deg(elevation), RINGS], axis=1))
    file = Lidar(name="l", mount=Mount(), rate_hz=rate_hz, ray_file=RayFile(path=tmp_path / "rays.npy"))
    expected, found = file.pattern(MODEL), lidar(rate_hz, times=TIMES, rings=RINGS).pattern(MODEL)
    for k in range(12):
        of_file, of_arrays = (each.at(k / (rate_hz or 1)) for each in (expected, found))
        np.testing.assert_allclose(of_arrays.directions, of_file.directions, atol=1e-12)
        np.testing.assert_array_equal(of_arrays.firing_times, of_file.firing_times)
        np.testing.assert_array_equal(of_arrays.ring, of_file.ring)
        np.testing.assert_array_equal(of_arrays.column, of_file.column)


def test_rays_with_origins_may_move() -> None:
    moving = Lidar(
        name="l",
        mount=Mount(),
        rate_hz=2,
        motion=True,
        rays={"directions": DIRECTIONS, "times": TIMES, "origins": ORIGINS},
    )
    data, rig = mujoco.MjData(MODEL), Rig(MODEL, [moving])
    frames: list[Frame] = []
    while not frames:
        mujoco.mj_step(MODEL, data)
        frames = rig.step(data)
    still = Rig(MODEL, [moving]).sense(data)["l"]
    np.testing.assert_allclose(frames[0].range.numpy(), still.range.numpy(), rtol=1e-6)
    np.testing.assert_allclose(np.ptp(frames[0].stamp.numpy()), 0.39)


def test_rays_survive_a_copy_a_pickle_and_json() -> None:
    spec = lidar(times=TIMES, rings=RINGS, origins=ORIGINS)
    for again in (
        spec.model_copy(update={"max_range": 3.0}).model_copy(update={"max_range": np.inf}),
        pickle.loads(pickle.dumps(spec)),
        Lidar.model_validate_json(spec.model_dump_json(exclude_defaults=True)),
    ):
        assert again.rays == spec.rays
        np.testing.assert_array_equal(again.pattern(MODEL).directions, spec.pattern(MODEL).directions)
    assert repr(spec.rays) == "RayArrays()"


NAN = np.full((10**5, 3), np.nan)


@pytest.mark.parametrize(
    ("rays", "rate_hz", "message"),
    [
        ({"directions": NAN}, None, r"rays.directions\[0\]\[0\]: must be a finite number, got nan"),
        ({"directions": [[1, 0, 0], [0, 0, 0]]}, None, r"rays.directions: must be .* but 0, got \[0, 0, 0\] in row 1"),
        ({"directions": []}, None, "rays.directions: must have 1 to 67108864 rows, got 0"),
        ({"directions": [1, 0, 0]}, None, r"rays.directions\[0\]: must be a list, got 1"),
        ({"directions": [[1, 0]]}, None, r"rays.directions\[0\]: must have 3 values, got 2"),
        ({"directions": np.ones((2, 4))}, None, r"rays.directions\[0\]: must have at most 3 values, got 4"),
        ({"times": TIMES[1:]}, None, "rays.times: must have one row per row of directions, 40, got 39"),
        ({"times": -TIMES}, None, "rays.times: must be ascending, got a time before that of the row above in row 1"),
        ({"rings": RINGS[1:]}, None, "rays.rings: must have one row per row of directions, 40, got 39"),
        ({"rings": RINGS + 0.5}, None, r"rays.rings\[0\]: must be an integer, got 0.5"),
        ({"rings": RINGS - 1}, None, r"rays.rings\[0\]: must be greater than or equal to 0, got -1"),
        ({"rings": [2**31] * 40}, None, r"rays.rings\[0\]: must be less than 2147483648, got 2147483648"),
        ({"origins": ORIGINS[1:]}, None, "rays.origins: must have one row per row of directions, 40, got 39"),
        ({"times": 100 * TIMES}, 10.0, "rays: 40 rows over 40 s are less than one per reading at 10 Hz; expected more"),
        ({"times": TIMES, "origins": ORIGINS}, 10.0, "rays: 0.4 s are 4 readings at 10 Hz; with origins they must be"),
    ],
)
def test_faults_say_where_they_are(rays: dict[str, Any], rate_hz: float | None, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        lidar(rate_hz, **rays)
    assert len(str(caught.value).splitlines()) <= 3  # of one row, however many there are


def test_rays_stand_alone() -> None:
    with pytest.raises(InputError, match=r"give a table of beams, or one of .*, got columns, rays"):
        Lidar(name="l", mount=Mount(), columns=3, rays={"directions": DIRECTIONS})
