"""Noise, detection and dropout of a lidar follow their formulas; tested on 102 400 rays each."""

import math
from statistics import NormalDist
from typing import Any

import mujoco
import numpy as np
import pytest
from confidence import assert_normal, assert_share, assert_uncorrelated
from lidar_scenes import SEED, ahead, bubble, model_of, sense, wall, wide

from rigcast import Detection, HeightScan, InputError, Lidar, Mount, Noise, Rig, Weather


@pytest.mark.parametrize(("radius", "grey", "std"), [(10, 0.5, 0.02), (80, 0.5, 0.1), (10, 0.0, 0.02)])
def test_the_range_has_a_normal_error(radius: float, grey: float, std: float) -> None:
    got = sense(model_of(bubble(radius, grey)), wide(noise=Noise(range_std=std))).range.numpy()
    assert_normal(got, radius, std)
    assert_uncorrelated(got[1:], got[:-1], "rows")
    assert_uncorrelated(got[:, 1:], got[:, :-1], "columns")


def test_two_returns_of_a_ray_err_independently() -> None:
    panes = wall("glass", 5, "0.5 0.5 0.5 0.5") + wall("behind", 10)
    model = model_of(panes)
    ideal, got = (
        sense(model, wide(max_surfaces=2, returns="dual", noise=noise)) for noise in (None, Noise(range_std=0.02))
    )
    errors = (got.range.numpy() - ideal.range.numpy()).reshape(-1, 2)
    assert errors.std(axis=0).min() > 0.01
    assert_uncorrelated(errors[:, 0], errors[:, 1], "returns")


@pytest.mark.parametrize(("radius", "grey"), [(10, 0.1), (20, 0.1), (10, 0.4), (40, 1.0)])
def test_the_error_grows_as_the_power_falls(radius: float, grey: float) -> None:
    """sigma = accuracy sqrt(P_accuracy / P), P = rho / R^2: LISA's dR / sqrt(2 SNR), whatever P_min."""
    detection = Detection(range=60, accuracy=0.03, accuracy_range=20, accuracy_reflectivity=0.1)
    std = 0.03 * math.sqrt((0.1 / 20**2) / (grey / radius**2))
    assert_normal(sense(model_of(bubble(radius, grey)), wide(detection=detection)).range.numpy(), radius, std)
    both = wide(detection=detection, noise=Noise(range_std=0.02))
    assert_normal(sense(model_of(bubble(radius, grey)), both).range.numpy(), radius, math.hypot(std, 0.02), "both")


def test_lisas_dr_of_9_cm_comes_out_where_the_snr_is_1() -> None:
    detection = Detection(range=50, accuracy=0.09 / math.sqrt(2), accuracy_range=50)
    assert_normal(sense(model_of(bubble(10, 0.1)), wide(detection=detection)).range.numpy(), 10, 0.09 / math.sqrt(50))


@pytest.mark.parametrize(("grey", "limit"), [(0.1, 40), (0.4, 80), (0.9, 120), (0.025, 20)])
@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_surface_facing_the_sensor_is_seen_up_to_its_range(grey: float, limit: float, share: float) -> None:
    """R = 40 m sqrt(rho / 10 %), by P_min."""
    frame = sense(model_of(bubble(limit * share, grey)), ahead(detection=Detection(range=40)))
    assert np.isfinite(frame.range.numpy()).all() == (share < 1)
    assert (frame.geom_id.numpy() == (0 if share < 1 else -1)).all()
    assert (frame.intensity.numpy() > 0).all() == (share < 1)


def test_slanted_surfaces_are_lost_where_their_power_is_too_small() -> None:
    model = model_of('<geom type="plane" size="0 0 1" pos="0 0 -2" rgba="0.3 0.3 0.3 1"/>')
    ideal, got = sense(model, wide()), sense(model, wide(detection=Detection(range=30)))
    distance, cosine = ideal.range.numpy(), np.abs(np.sin(np.deg2rad([0.1 * (k - 128) for k in range(256)])))[:, None]
    with np.errstate(invalid="ignore"):
        snr = 0.3 * cosine / distance**2 / (0.1 / 30**2)
    sure = np.abs(snr - 1) > 1e-4
    seen = np.isfinite(distance) & (snr > 1)
    assert 0.05 < seen.mean() < 0.95
    np.testing.assert_array_equal(np.isfinite(got.range.numpy())[sure], seen[sure])
    np.testing.assert_array_equal(got.range.numpy()[seen & sure], distance[seen & sure])


@pytest.mark.parametrize("dropout", [0.001, 0.3, 1.0])
def test_returns_drop_out_with_their_probability(dropout: float) -> None:
    frame = sense(model_of(bubble(10)), wide(noise=Noise(dropout=dropout)))
    lost = np.isposinf(frame.range.numpy())
    assert_share(lost, dropout)
    np.testing.assert_array_equal(frame.range.numpy()[~lost], np.float32(10))
    np.testing.assert_array_equal(frame.geom_id.numpy()[lost], -1)
    np.testing.assert_array_equal(frame.normal.numpy()[lost], 0)
    np.testing.assert_array_equal(frame.intensity.numpy()[lost], 0)


@pytest.mark.parametrize(("grey", "expected"), [(0.0, 0.4), (0.2, 0.3), (0.4, 0.2), (0.8, 0.0), (1.0, 0.0)])
def test_dark_returns_drop_out_more_often(grey: float, expected: float) -> None:
    """CARLA: dark_dropout (1 - intensity / dark_limit)."""
    noise = Noise(dark_dropout=0.4, dark_limit=0.8)
    assert_share(np.isposinf(sense(model_of(bubble(10, grey)), wide(noise=noise)).range.numpy()), expected)
    both = Noise(dark_dropout=0.4, dark_limit=0.8, dropout=0.1)
    lost = np.isposinf(sense(model_of(bubble(10, grey)), wide(noise=both)).range.numpy())
    assert_share(lost, 1 - 0.9 * (1 - expected), "both")


def test_a_miss_stays_a_miss() -> None:
    noise = Noise(range_std=1.0, dropout=0.5, range_resolution=0.1, angle_std_deg=1.0)
    got = sense(model_of(wall("far", 50)), wide(noise=noise, max_range=20.0))
    np.testing.assert_array_equal(got.range.numpy(), np.inf)
    assert np.isnan(got.points.numpy()).all()


@pytest.mark.parametrize("resolution", [0.002, 0.1])
def test_ranges_are_whole_multiples_of_the_resolution(resolution: float) -> None:
    model = model_of(wall("wall", 7))
    ideal = sense(model, wide()).range.numpy()
    got = sense(model, wide(noise=Noise(range_resolution=resolution))).range.numpy().astype(np.float64)
    np.testing.assert_allclose(got / resolution, np.round(got / resolution), atol=1e-2 * 0.002 / resolution + 1e-3)
    assert np.abs(got - ideal).max() <= resolution / 2 + 1e-5
    assert np.abs(got - ideal).max() > 0.49 * resolution


def test_a_lidar_at_a_surface_reads_nothing_but_0() -> None:
    detection = Detection(range=40, accuracy=0.02, accuracy_range=10)
    frame = sense(model_of(wall("wall", 0)), wide(detection=detection))
    np.testing.assert_array_equal(frame.range.numpy(), 0)


def test_the_ray_errs_and_the_point_lies_on_the_ray_that_the_sensor_believes_in() -> None:
    """At a wall at x, the range of the ray along +x is x / cos(angle); azimuth and elevation angles are normal."""
    std = math.radians(0.5)
    straight = {"elevation_deg": [0] * 256, "columns": 400, "azimuth_deg": (-1e-9, 1e-9)}
    frame = sense(model_of(wall("wall", 10)), wide(**straight, noise=Noise(angle_std_deg=0.5)))
    angle = np.arccos(10 / np.maximum(frame.range.numpy().astype(np.float64), 10))
    # the square of the angle has an exponential distribution with a mean of 2 std^2: 20 bins of equal probability
    probability = 1 - np.exp(-(angle**2) / (2 * std**2))
    assert_share(probability < 0.5, 0.5)
    assert_share(probability > 0.9, 0.1)
    np.testing.assert_allclose(frame.points.numpy()[..., 1:], 0, atol=1e-6)
    np.testing.assert_array_equal(frame.points.numpy()[..., 0], frame.range.numpy())
    np.testing.assert_allclose(frame.points_world.numpy(), frame.points.numpy(), atol=1e-6)


def test_measured_ranges_are_held_to_the_limits() -> None:
    """REP-117: +inf beyond max_range, -inf nearer than min_range, by the range that is measured."""
    std = 0.1
    frame = sense(model_of(bubble(10)), wide(noise=Noise(range_std=std), min_range=9.9))
    got = frame.range.numpy()
    assert_share(np.isneginf(got), NormalDist().cdf(-1))
    assert got[np.isfinite(got)].min() >= np.float32(9.9)
    np.testing.assert_array_equal(frame.geom_id.numpy()[np.isneginf(got)], -1)
    np.testing.assert_array_equal(frame.intensity.numpy()[np.isneginf(got)], 0)
    got = sense(model_of(bubble(10)), wide(noise=Noise(range_std=std), max_range=10.05)).range.numpy()
    assert_share(np.isposinf(got), NormalDist().cdf(-0.5))
    assert got[np.isfinite(got)].max() <= np.float32(10.05)
    whole = wide(noise=Noise(range_resolution=0.5), min_range=10.0, max_range=10.2)
    got = sense(model_of(bubble(10.1)), whole).range.numpy()
    np.testing.assert_array_equal(got, 10, err_msg="a limit itself is within")


@pytest.mark.parametrize(("rate", "radius"), [(1, 20), (30, 5)])
def test_rain_blurs_ranges_as_goodin_has_it(rate: float, radius: float) -> None:
    weather = Weather(rain_rate=rate, rain_range_noise=0.02, rain_extinction=(0.0, 1.0))
    lidar = wide(detection=Detection(range=50, reflectivity=0.5), weather=weather, returns="last")
    assert_normal(
        sense(model_of(bubble(radius)), lidar).range.numpy(), radius, 0.02 * radius * (1 - math.exp(-rate)) ** 2
    )


IDEAL: list[dict[str, Any]] = [
    {"noise": Noise()},
    {"detection": Detection(range=1e6)},
    {"max_surfaces": 4},
    {"mirrors": True},
    {"returns": "first"},
    {"weather": Weather(), "detection": Detection(range=1e6)},
]


@pytest.mark.parametrize("options", IDEAL, ids=lambda options: next(iter(options)))
def test_an_effect_of_size_nothing_changes_nothing(options: dict[str, Any]) -> None:
    model = model_of(wall("wall", 10) + '<geom name="ball" size="1" pos="5 1 0"/>')
    got, ideal = sense(model, wide(**options, max_range=13.0)), sense(model, wide(max_range=13.0))
    for field in ("range", "normal", "geom_id", "points"):
        np.testing.assert_array_equal(getattr(got, field).numpy(), getattr(ideal, field).numpy(), err_msg=field)
    np.testing.assert_allclose(got.intensity.numpy(), ideal.intensity.numpy(), rtol=1e-6)


NOISY = Noise(range_std=0.02, dropout=0.1, angle_std_deg=0.1)
LIDARS = [
    wide(name=name, elevation_deg=[-1, 0, 1], noise=NOISY, detection=Detection(range=20), weather=Weather(rain_rate=50))
    for name in ("a", "b", "c")
]


def bits(rig: Rig, model: mujoco.MjModel, name: str, readings: int = 3) -> list[bytes]:
    data = mujoco.MjData(model)
    return [rig.sense(data)[name].range.numpy().tobytes() for _ in range(readings)]


def test_noise_depends_on_seed_and_name_and_reading_only(monkeypatch: pytest.MonkeyPatch) -> None:
    model = model_of(wall("wall", 10))
    alone = bits(Rig(model, LIDARS[:1], seed=SEED), model, "a")
    assert len(set(alone)) == 3, "readings must differ"
    scan = HeightScan(name="feet", mount=Mount(), size=(1, 1), spacing=0.5)
    changed = LIDARS[1].model_copy(update={"noise": Noise(range_std=1.0)})
    rigs: list[list[Lidar | HeightScan]] = [[*LIDARS], [scan, *LIDARS[::-1]], [changed, LIDARS[0]]]
    for others in rigs:
        assert bits(Rig(model, others, seed=SEED), model, "a") == alone
    assert bits(Rig(model, LIDARS, seed=SEED), model, "b") != alone
    assert bits(Rig(model, LIDARS, seed=SEED + 1), model, "a") != alone
    for threads in ("1", "3"):
        monkeypatch.setenv("RIGCAST_THREADS", threads)
        assert bits(Rig(model, LIDARS[:1], seed=SEED), model, "a") == alone


def test_reading_one_sensor_more_often_does_not_change_another() -> None:
    model = model_of(wall("wall", 10))
    data = mujoco.MjData(model)
    rig = Rig(model, LIDARS, seed=SEED)
    rig.sense(data, ["b"])
    rig.sense(data, ["b"])
    got = [rig.sense(data)["a"].range.numpy().tobytes() for _ in range(3)]
    assert got == bits(Rig(model, LIDARS, seed=SEED), model, "a")


def test_sensors_and_readings_have_independent_noise() -> None:
    model = model_of(bubble(10))
    pair = [wide(name=name, noise=Noise(range_std=0.1)) for name in ("a", "b")]
    rig, data = Rig(model, pair, seed=SEED), mujoco.MjData(model)
    first, second = rig.sense(data), rig.sense(data)
    assert_uncorrelated(first["a"].range.numpy(), first["b"].range.numpy(), "sensors")
    assert_uncorrelated(first["a"].range.numpy(), second["a"].range.numpy(), "readings")


def test_a_pose_that_is_not_a_number_gives_a_frame_that_is_none() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom size="5"/><body name="b"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[0] = np.nan
    lidar = Lidar(
        name="l", mount=Mount(body="b", pos=(2, 0, 0)), elevation_deg=[0], columns=8, noise=NOISY, returns="dual"
    )
    with pytest.warns(RuntimeWarning, match="not finite"):
        frame = Rig(model, [lidar]).sense(data)["l"]
    assert frame.range.shape == (1, 8, 2)
    assert np.isnan(frame.range.numpy()).all()


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "7", None])
def test_a_seed_that_is_none_is_refused(seed: Any) -> None:
    with pytest.raises(InputError, match=r"Rig: seed: got .*, expected a whole number from 0 to 2\^63 - 1"):
        Rig(model_of(wall("wall", 10)), LIDARS, seed=seed)
