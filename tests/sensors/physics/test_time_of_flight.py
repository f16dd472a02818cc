"""Time-of-flight cameras have the errors of their formulas; the infrared image is that of a lamp at the camera."""

from typing import Any

import mujoco
import numpy as np
import pytest
from confidence import assert_normal, assert_share
from depth_scenes import FOCAL, HEIGHT, WALL, WIDTH, camera, look
from numpy.typing import NDArray

from rigcast import CameraFrame, Rig, TimeOfFlight
from rigcast.sensors.errors import InputError

THINGS = (
    '<geom name="pole" type="cylinder" size="0.004 1" pos="1 0.1 0" rgba="1 1 1 1"/>'
    '<geom name="ball" size="0.3" pos="1.5 -0.3 0" rgba="0.2 0.9 0.1 1"/>'
    '<geom name="floor" type="plane" size="0 0 1" pos="0 0 -0.4" rgba="0.1 0.1 0.1 1"/>'
)
ROOM = THINGS + WALL.format(3)


def frame_of(worldbody: str, seed: int = 0, **arguments: Any) -> CameraFrame:
    return look(worldbody, camera(time_of_flight=TimeOfFlight(**arguments)), seed)


def range_of(worldbody: str, seed: int = 0, **arguments: Any) -> NDArray[np.float64]:
    return frame_of(worldbody, seed, **arguments).range.numpy().astype(np.float64)


def ideal_range(worldbody: str) -> NDArray[np.float64]:
    return look(worldbody, camera()).range.numpy().astype(np.float64)


def test_a_time_of_flight_camera_without_errors_is_the_ideal_one_bit_for_bit() -> None:
    ideal, got = look(THINGS, camera()), frame_of(THINGS)
    for name in ("range", "depth", "normal", "geom_id", "points", "intensity"):
        np.testing.assert_array_equal(getattr(ideal, name).numpy(), getattr(got, name).numpy(), err_msg=name)


@pytest.mark.parametrize("std", [0.001, 0.017])
def test_axial_noise_is_normal_along_the_ray(std: float) -> None:
    assert_normal(range_of(ROOM, range_std=std) - ideal_range(ROOM), 0.0, std)


def test_bias_is_added_to_the_range() -> None:
    ideal = ideal_range(ROOM)
    np.testing.assert_allclose(range_of(ROOM, bias=0.011, bias_per_metre=0.001), 1.001 * ideal + 0.011, rtol=1e-6)


@pytest.mark.parametrize("modulation_hz", [50e6, 100e6])
def test_ranges_wrap_at_half_a_wavelength(modulation_hz: float) -> None:
    wrap = 299792458 / (2 * modulation_hz)
    ideal, got = ideal_range(ROOM), range_of(ROOM, modulation_hz=modulation_hz)
    turns = (ideal - got) / wrap
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-6)
    assert set(np.rint(turns).astype(int).ravel()) == set(range(int(ideal.max() / wrap) + 1))
    assert (got >= 0).all()
    assert (got < wrap).all()


@pytest.mark.parametrize("subrays", [2, 3, 5])
def test_flying_pixels_are_the_mean_of_their_ranges_by_light(subrays: int) -> None:
    """Compared with a camera with `subrays` times as many pixels across and down, which are the sub-rays."""
    width, height = WIDTH // 5, HEIGHT // 5
    optics = {"fx": FOCAL / 5, "fy": FOCAL / 5, "cx": width / 2, "cy": height / 2}
    finer = {key: subrays * value for key, value in optics.items()}
    fine = look(ROOM, camera(resolution=(subrays * width, subrays * height), **finer))
    light, distance = (
        array.numpy().astype(np.float64).reshape(height, subrays, width, subrays)
        for array in (fine.intensity, fine.range)
    )
    expected = (light * distance).sum(axis=(1, 3)) / light.sum(axis=(1, 3))
    error = TimeOfFlight(subrays=subrays)
    got = look(ROOM, camera(resolution=(width, height), time_of_flight=error, **optics)).range.numpy()
    np.testing.assert_allclose(got, expected, rtol=2e-6)
    # between pole and wall there are pixels that belong to neither
    gap = (got > 1.3) & (got < 2.5) & (np.indices(got.shape)[1] < width / 2)
    assert gap.any()


def test_sub_rays_that_hit_nothing_change_no_range() -> None:
    """They return no light; ids are those of the brightest sub-ray."""
    pole = '<geom type="box" size="0.01 0.005 2" pos="1.01 0 0"/>'
    frame = frame_of(pole, subrays=4)
    distance = frame.range.numpy()
    hit = np.isfinite(distance)
    assert (frame.geom_id.numpy()[hit] == 0).all()
    assert (frame.geom_id.numpy()[~hit] == -1).all()
    assert set(hit.sum(axis=1)) == {4}
    ideal = look('<geom type="plane" size="0 0 1" zaxis="-1 0 0" pos="1 0 0"/>', camera()).range.numpy()
    np.testing.assert_allclose(distance[hit], ideal[hit], rtol=1e-4)


@pytest.mark.parametrize("name", ["range", "normal", "geom_id", "depth"])
def test_losses_leave_nothing_behind(name: str) -> None:
    frame = frame_of(ROOM, dropout=0.3, range_std=0.01)
    lost = np.isnan(frame.range.numpy())
    assert_share(lost, 0.3)
    expected = {"range": np.nan, "depth": np.nan, "normal": 0, "geom_id": -1}[name]
    np.testing.assert_array_equal(getattr(frame, name).numpy()[lost], expected)


def test_intensity_is_that_of_a_lamp_at_the_camera() -> None:
    """rho |n . d| / R^2, where rho is the luminance of the geom's colour: 1 for a white, facing surface at 1 m."""
    frame = look(ROOM, camera())
    rays = frame.points.numpy() / frame.range.numpy()[..., None]
    cosine = np.abs((rays * frame.normal.numpy()).sum(axis=-1))
    grey = {"pole": 1.0, "ball": 0.2126 * 0.2 + 0.7152 * 0.9 + 0.0722 * 0.1, "floor": 0.1, "wall": 0.5}
    reflectivity = np.array(list(grey.values()))[frame.geom_id.numpy()]
    np.testing.assert_allclose(frame.intensity.numpy(), reflectivity * cosine / frame.range.numpy() ** 2, rtol=1e-4)


def test_intensity_of_nothing_is_0_and_losses_do_not_show_in_it() -> None:
    ideal = look(THINGS, camera())
    np.testing.assert_array_equal(ideal.intensity.numpy()[np.isinf(ideal.range.numpy())], 0)
    lost = frame_of(THINGS, dropout=1.0)
    np.testing.assert_array_equal(lost.intensity.numpy(), ideal.intensity.numpy())


def test_intensity_follows_the_model() -> None:
    """The reflectivity is that of the material's present colour."""
    xml = (
        '<mujoco><asset><material name="m" rgba="1 1 1 1"/></asset>'
        '<worldbody><geom type="plane" size="0 0 1" zaxis="-1 0 0" pos="2 0 0" material="m"/></worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(xml)
    rig, data = Rig(model, [camera(resolution=(1, 1), cx=0.5, cy=0.5)], "cpu"), mujoco.MjData(model)
    for grey in (1.0, 0.25):
        model.mat_rgba[0, :3] = grey
        frame = rig.sense(data)["eye"]
        assert isinstance(frame, CameraFrame)
        assert frame.intensity.numpy()[0, 0] == pytest.approx(grey / 4, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"subrays": 0}, "subrays: must be greater than or equal to 1, got 0"),
        ({"modulation_hz": 0.0}, "modulation_hz: must be greater than 0"),
        ({"range_sd": 0.1}, "unknown key 'range_sd', .*did you mean 'range_std'"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        TimeOfFlight(**arguments)


def test_a_camera_measures_in_one_way() -> None:
    with pytest.raises(InputError, match="give stereo or time_of_flight, got both"):
        camera(stereo={"baseline": 0.1}, time_of_flight={})
