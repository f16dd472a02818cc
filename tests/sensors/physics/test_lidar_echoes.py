"""Beams, returns, glass, mirrors and weather of a lidar: echoes have the ranges and powers of their formulas."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from confidence import assert_share
from lidar_scenes import ahead, bubble, model_of, sense, wall, wide
from numpy.typing import NDArray

from rigcast import Beam, Detection, Surface, Weather
from rigcast.kernels.effects.lidars.beams import hexagonal_rings
from rigcast.kernels.effects.lidars.weather import fog_extinction, rain_extinction

TWO_THIRDS_GLASS = "0.5 0.5 0.5 0.3333333333333333"
PANES = "".join(wall(f"pane{k}", 2.0 * k, TWO_THIRDS_GLASS) for k in range(1, 7))
T = 2 / 3


def only(frame: Any) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    """Range, intensity and geom of all returns of the only ray."""
    return tuple(getattr(frame, field).numpy().reshape(-1) for field in ("range", "intensity", "geom_id"))


@pytest.mark.parametrize("surfaces", [1, 2, 3, 4])
def test_light_goes_on_through_glass_up_to_so_many_surfaces(surfaces: int) -> None:
    """Echo k has (1 - T) T^(2 k) of the power: the last return is the surface at which the light ends."""
    frame = sense(model_of(PANES), ahead(max_surfaces=surfaces, returns="last"))
    share = (1 - T) * T ** (2 * (surfaces - 1)) if surfaces > 1 else 1.0
    distance, intensity, geom = only(frame)
    np.testing.assert_allclose(distance, 2.0 * surfaces, rtol=1e-5)
    np.testing.assert_allclose(intensity, 0.5 * share, rtol=1e-5)
    np.testing.assert_array_equal(geom, surfaces - 1)


@pytest.mark.parametrize(
    ("returns", "expected"),
    # power (1 - T) T^(2 k) rho / R^2: 0.0417, 0.0046, ... of the panes; of a bright wall behind two of them 0.0494
    [("first", [0]), ("last", [2]), ("strongest", [2]), ("dual", [2, 0])],
)
def test_returns_are_chosen_by_place_and_power(returns: str, expected: list[int]) -> None:
    room = wall("near", 2, TWO_THIRDS_GLASS) + wall("next", 4, TWO_THIRDS_GLASS) + wall("sign", 6)
    bright = [Surface(geom="sign", reflectivity=9.0)]
    distance, intensity, geom = only(sense(model_of(room), ahead(max_surfaces=4, returns=returns), surfaces=bright))
    shares = np.array([0.5 * (1 - T), 0.5 * (1 - T) * T**2, 9.0 * T**4])
    np.testing.assert_array_equal(geom, expected)
    np.testing.assert_allclose(distance, 2.0 + 2.0 * np.array(expected), rtol=1e-5)
    np.testing.assert_allclose(intensity, shares[expected], rtol=1e-5)


def test_the_last_of_two_is_another_than_the_strongest() -> None:
    room = wall("near", 2, TWO_THIRDS_GLASS) + wall("far", 6)
    distance, _, geom = only(sense(model_of(room), ahead(max_surfaces=4, returns="dual")))
    np.testing.assert_array_equal(geom, [0, 1])
    np.testing.assert_allclose(distance, [2, 6], rtol=1e-5)
    distance, _, geom = only(sense(model_of(wall("far", 6)), ahead(max_surfaces=4, returns="dual")))
    np.testing.assert_array_equal(geom, [0, -1])
    np.testing.assert_array_equal(distance, [np.float32(6), np.inf])


def test_a_sheet_of_glass_has_two_surfaces_and_its_faces_are_one_echo_to_a_long_pulse() -> None:
    room = f'<geom name="sheet" type="box" size="0.01 2 2" pos="3 0 0" rgba="{TWO_THIRDS_GLASS}"/>' + wall("wall", 5)
    short = only(sense(model_of(room), ahead(max_surfaces=3, returns="first", pulse_length=1e-11)))
    long = only(sense(model_of(room), ahead(max_surfaces=3, returns="first", pulse_length=5e-9)))
    behind = only(sense(model_of(room), ahead(max_surfaces=3, returns="last")))
    np.testing.assert_allclose(short[0], 2.99, rtol=1e-5)
    powers = 0.5 * (1 - T) / np.array([2.99, 3.01]) ** 2 * [1, T**2]
    mean = np.average([2.99, 3.01], weights=powers)
    np.testing.assert_allclose(long[0], mean, rtol=1e-5)
    np.testing.assert_allclose(long[1], powers.sum() * mean**2, rtol=1e-4)
    np.testing.assert_allclose(behind[0], 5, rtol=1e-5)
    np.testing.assert_allclose(behind[1], 0.5 * T**4, rtol=1e-4)


@pytest.mark.parametrize("grey", [0.2, 0.9])
def test_light_at_a_slant_goes_on_through_glass_at_the_same_slant(grey: float) -> None:
    room = wall("pane", 3, TWO_THIRDS_GLASS) + wall("wall", 9, f"{grey} {grey} {grey} 1")
    options = {"max_surfaces": 2, "returns": "last"}
    got, ideal = sense(model_of(room), wide(**options)), sense(model_of(wall("wall", 9)), wide())
    np.testing.assert_allclose(got.range.numpy(), ideal.range.numpy(), rtol=1e-5)
    np.testing.assert_allclose(got.intensity.numpy(), ideal.intensity.numpy() * grey / 0.5 * T**2, rtol=1e-4)
    np.testing.assert_array_equal(got.geom_id.numpy(), 1)


MIRROR = '<geom name="mirror" type="box" size="0.01 2 2" pos="3 0 0" euler="0 0 45"/>'
SHINY = [Surface(geom="mirror", mirror=0.8)]


def test_a_mirror_shows_a_ghost_straight_on_behind_it() -> None:
    """A mirror at 45 degrees turns +x to -y or +y: what is there appears at R1 + R2 along +x, s^2 as bright."""
    room = MIRROR + '<geom name="left" type="box" size="5 0.1 5" pos="0 6.1 0"/>'
    room += '<geom name="right" type="box" size="5 0.1 5" pos="0 -6.1 0"/>'
    face = 3 - 0.01 * math.sqrt(2)
    distance, intensity, geom = only(sense(model_of(room), ahead(mirrors=True, returns="dual"), surfaces=SHINY))
    np.testing.assert_allclose(distance, [face, face + 6], rtol=1e-5)
    np.testing.assert_allclose(intensity, [0.2 * 0.5 * math.sqrt(0.5), 0.8**2 * 0.5], rtol=1e-4)
    assert geom[0] == 0
    assert geom[1] in (1, 2)


def test_without_mirrors_a_mirror_is_a_surface_like_any_other() -> None:
    distance, intensity, _ = only(sense(model_of(MIRROR), ahead(max_surfaces=2, returns="dual"), surfaces=SHINY))
    np.testing.assert_allclose(distance, [3 - 0.01 * math.sqrt(2), np.inf], rtol=1e-5)
    np.testing.assert_allclose(intensity, [0.5 * math.sqrt(0.5), 0], rtol=1e-5)


@pytest.mark.parametrize(("tilt", "share"), [(0.0, 0.2 * 0.5 + 0.8), (0.9, 0.2 * 0.5 + 0.8), (1.1, 0.2 * 0.5)])
def test_a_mirror_sends_light_back_within_its_lobe_only(tilt: float, share: float) -> None:
    room = f'<geom name="mirror" type="box" size="0.01 2 2" pos="3 0 0" euler="0 0 {tilt}"/>'
    lidar = ahead(mirrors=True, mirror_lobe_deg=1.0, returns="first")
    _, intensity, _ = only(sense(model_of(room), lidar, surfaces=SHINY))
    np.testing.assert_allclose(intensity, share, rtol=1e-3)


def test_the_mirror_of_a_material_is_its_reflectance() -> None:
    asset = '<material name="steel" rgba="0.5 0.5 0.5 1" reflectance="0.8"/>'
    room = MIRROR.replace("/>", ' material="steel"/>') + '<geom type="box" size="5 0.1 5" pos="0 6.1 0"/>'
    room += '<geom type="box" size="5 0.1 5" pos="0 -6.1 0"/>'
    distance, _, _ = only(sense(model_of(room, asset), ahead(mirrors=True, returns="last")))
    np.testing.assert_allclose(distance, 9 - 0.01 * math.sqrt(2), rtol=1e-5)


BEAM = Beam(divergence_deg=(0.4, 0.2), rings=3)


def edge_scene(y: float, near: float, far: float) -> mujoco.MjModel:
    """A box whose face at x = near covers everything to the left of y, in front of a wall at x = far."""
    box = f'<geom name="box" type="box" size="0.05 5 5" pos="{near + 0.05} {y + 5} 0" rgba="0.8 0.8 0.8 1"/>'
    return model_of(box + wall("wall", far))


@pytest.mark.parametrize("y", [-0.021, -0.006, 0.0011, 0.013])
def test_a_beam_across_an_edge_mixes_the_surfaces_within_a_pulse(y: float) -> None:
    """The range is the mean of the sub-rays' ranges, weighted by rho cos w / R^2."""
    angles, weights = hexagonal_rings(3, tuple(np.deg2rad(BEAM.divergence_deg)))
    turn = np.hypot(*angles.T.astype(np.float64))
    slope = np.where(turn > 0, np.tan(turn) / np.where(turn > 0, turn, 1), 1)
    is_box = 10 * slope * angles[:, 0] > y
    distance = np.where(is_box, 10, 10.5) / np.cos(turn)
    power = weights * np.where(is_box, 0.8, 0.5) * np.cos(turn) / distance**2
    mean = np.average(distance, weights=power)
    got = only(sense(edge_scene(y, 10, 10.5), ahead(beam=BEAM)))
    assert 10.001 < mean < 10.499
    np.testing.assert_allclose(got[0], mean, rtol=1e-5)
    np.testing.assert_allclose(got[1], power.sum() * mean**2, rtol=1e-4)


def test_a_beam_across_an_edge_has_two_returns_where_they_are_farther_apart() -> None:
    distance, _, geom = only(sense(edge_scene(0.0, 10, 12), ahead(beam=BEAM, returns="dual")))
    np.testing.assert_allclose(distance, [10, 12], rtol=1e-4)
    np.testing.assert_array_equal(geom, [0, 1])


def test_a_thin_pole_is_seen_by_a_wide_beam_that_misses_it_with_its_middle() -> None:
    room = '<geom name="pole" type="cylinder" size="0.005 1" pos="10 0.02 0" rgba="1 1 1 1"/>' + wall("wall", 15)
    _, _, geom = only(sense(model_of(room), ahead(returns="first")))
    assert geom == [1]
    distance, intensity, geom = only(sense(model_of(room), ahead(beam=BEAM, returns="first")))
    assert geom == [0]
    np.testing.assert_allclose(distance, 10, atol=0.01)
    assert 0 < intensity[0] < 0.3


def test_several_beams_each_have_their_own_sub_rays() -> None:
    model = model_of(wall("wall", 10))
    got, ideal = sense(model, wide(beam=Beam(divergence_deg=(0.05, 0.05), rings=1))), sense(model, wide())
    np.testing.assert_allclose(got.range.numpy(), ideal.range.numpy(), rtol=2e-4)
    np.testing.assert_allclose(got.points.numpy(), ideal.points.numpy(), rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize(
    ("weather", "extinction"),
    [
        (Weather(rain_rate=20), rain_extinction(20)),
        (Weather(rain_rate=20, rain_extinction=(0.01, 0.6)), 0.01 * 20**0.6),
        (Weather(visibility=100), fog_extinction(100)),
        (Weather(visibility=300, rain_rate=5), fog_extinction(300) + rain_extinction(5)),
    ],
)
def test_weather_dims_what_is_seen_through_it(weather: Weather, extinction: float) -> None:
    """The intensity is rho exp(-2 a R), where no drop or fog has a stronger echo."""
    frame = sense(model_of(bubble(12, 0.9)), wide(detection=Detection(range=100), weather=weather))
    at_wall = frame.geom_id.numpy() == 0
    assert at_wall.mean() > 0.99
    np.testing.assert_allclose(frame.intensity.numpy()[at_wall], 0.9 * math.exp(-2 * extinction * 12), rtol=2e-3)


@pytest.mark.parametrize("visibility", [40.0, 150.0])
def test_fog_shortens_the_range_to_where_the_power_falls_below_the_least(visibility: float) -> None:
    """rho exp(-2 a R) / R^2 = P_min, by bisection; the fog's own echo, of no geom, is nearer than 5 m."""
    near, far = 1.0, 100.0
    for _ in range(60):
        middle = 0.5 * (near + far)
        power = 0.5 * math.exp(-2 * fog_extinction(visibility) * middle) / middle**2
        near, far = (middle, far) if power > 0.1 / 50**2 else (near, middle)
    lidar = ahead(detection=Detection(range=50), weather=Weather(visibility=visibility), returns="last")
    for share, geom in ((0.999, 0), (1.001, -1)):
        got = only(sense(model_of(bubble(share * near)), lidar))
        assert got[2] == [geom], f"{share} of {near} m"


def test_dense_fog_is_what_is_seen_first() -> None:
    lidar = ahead(detection=Detection(range=150), weather=Weather(visibility=15), returns="first")
    distance, intensity, geom = only(sense(model_of(wall("wall", 30)), lidar))
    assert 0.9 < distance[0] < 3
    assert intensity[0] > 0
    assert geom == [-1]


def test_drops_are_seen_as_often_as_there_are_bright_enough_ones() -> None:
    """The receiver detects every drop: the probability is that of a drop in the cone from 1.5 m to the wall."""
    lidar = wide(
        detection=Detection(range=1000, reflectivity=1e-9),
        weather=Weather(rain_rate=50),
        beam=Beam(divergence_deg=(0.15, 0.15), rings=1),
        returns="first",
        pulse_length=1e-12,
        max_range=6.0,
    )
    got = sense(model_of(bubble(6)), lidar)
    drops = got.geom_id.numpy() < 0
    slope = 4.1 * 50**-0.21
    mean = 8000 / slope * math.exp(-0.05 * slope) * math.pi / 12 * math.radians(0.15) ** 2 * (6**3 - 1.5**3)
    assert_share(drops, 1 - math.exp(-mean))
    assert (got.range.numpy()[drops] > 1.5).all()
    np.testing.assert_array_equal(got.body_id.numpy()[drops], -1)
    np.testing.assert_array_equal(got.normal.numpy()[drops], 0)
