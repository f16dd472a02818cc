"""Wedges refract light by Snell's law, and their patterns continue from reading to reading."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from rigcast.kernels.packets.packet import TILE
from rigcast.kernels.packing.in_order import pack_in_order
from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.lidars.rosette import Nodding, Rosette, Wedge, refract
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.pattern import azimuth_elevation

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
LIVOX = ("livox_mid40", "livox_mid70", "livox_avia", "livox_tele15", "livox_horizon", "livox_mid360")


def wedge(**given: Any) -> Wedge:
    return Wedge(**{"rpm": 60, "tilt_deg": 10, "index": 1.5, "tilted_first": False, **given})


def livox(preset: str, **given: Any) -> Lidar:
    return Lidar(name="l", mount=Mount(), preset=preset, **given)


@pytest.mark.parametrize("ratio", [1 / 1.5, 1.0, 1.5, 1 / 1.8144])
def test_refraction_keeps_sines_planes_and_lengths(ratio: float) -> None:
    rng = np.random.default_rng(3)
    normal = rng.normal(size=(2000, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    beam = normal + 0.4 * rng.normal(size=normal.shape)
    beam /= np.linalg.norm(beam, axis=-1, keepdims=True)
    sine = np.linalg.norm(np.cross(beam, normal), axis=-1)
    k = ratio * beam.T
    refract(k, tuple(normal.T), ratio, 1.0)
    behind = k.T
    passes = ratio * sine < 1
    assert passes.sum() > 1000
    np.testing.assert_array_equal(np.isnan(behind[:, 0]), ~passes)
    beam, normal, behind, sine = (each[passes] for each in (beam, normal, behind, sine))
    np.testing.assert_allclose(np.linalg.norm(behind, axis=-1), 1, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(np.cross(behind, normal), axis=-1), ratio * sine, atol=1e-7)
    np.testing.assert_allclose(np.linalg.det(np.stack([beam, normal, behind], axis=1)), 0, atol=1e-12)
    assert (np.sum(behind * normal, axis=-1) > 0).all()


@pytest.mark.parametrize(("tilt", "index"), [(18.0, 1.5089), (-18.0, 1.5089), (7.1, 1.8144), (-20.0, 1.6106)])
def test_one_wedge_deviates_as_a_prism_does(tilt: float, index: float) -> None:
    """Light square to the first face meets the second at the tilt: it leaves asin(n sin a) - a away from the axis."""
    expected = np.arcsin(index * np.sin(np.deg2rad(tilt))) - np.deg2rad(tilt)
    rays = Rosette(wedges=[wedge(tilt_deg=tilt, index=index)], sample_rate_hz=4).directions(np.arange(4) / 4)
    angle = np.arctan2(rays[:, 0, 1:], rays[:, 0, :1])
    # a quarter of a turn per sample: the thick side, away from which light bends, is at +y, +z, -y, -z of the tilt
    np.testing.assert_allclose(np.arccos(rays[:, 0, 0]), abs(expected), atol=1e-12)
    np.testing.assert_allclose(angle[0], [-expected, 0], atol=1e-12)
    np.testing.assert_allclose(angle[1], [0, -expected], atol=1e-12)


@pytest.mark.parametrize("samples", [1, 15, 16, 17, 1000])
@pytest.mark.parametrize("preset", [name for name in LIVOX if name != "livox_mid360"])
def test_later_readings_are_those_of_the_formula(preset: str, samples: int) -> None:
    """To within rounding, which grows with the angle [rad] by which the wedges have turned."""
    rosette = livox(preset, rate_hz=10).rosette
    assert rosette is not None
    aim, sampled = rosette.aim(samples), np.arange(samples) / rosette.sample_rate_hz
    readings = {time: aim(time, False)[0] for time in (0.0, 0.1, 1e4)}
    for time, directions in readings.items():  # a reading does not change those before it
        turned = sum(abs(wedge.speed) for wedge in rosette.wedges) * (time + sampled[-1])
        bound = 2 * np.finfo(np.float64).eps * (2 + turned)
        np.testing.assert_allclose(
            directions, rosette.directions(time + sampled), rtol=0, atol=bound, err_msg=f"at {time} s"
        )


@pytest.mark.parametrize("lines", [1, 4, 5, 6, 9])
@pytest.mark.parametrize("samples", [1, 17, 1000])
def test_later_readings_come_in_packets_of_neighbouring_lines(
    lines: int, samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are the same for any number of threads, and those of rays packed in this order."""
    elevation = np.linspace(-2, 2, lines).tolist()
    wedges = [wedge(rpm=7000), wedge(rpm=-3000)]
    aim = Rosette(wedges=wedges, sample_rate_hz=40_000, line_elevation_deg=elevation).aim(samples)
    readings = []
    for threads in ("1", "3"):
        monkeypatch.setenv("RIGCAST_THREADS", threads)
        readings.append((threads, *aim(0.1, True)))
        directions, packets = aim(0.1, False)  # as a GPU casts them
        assert packets is None
        np.testing.assert_array_equal(directions, readings[-1][1])
    for threads, directions, packets in readings:
        assert packets is not None
        rays = wp.array(directions.reshape(-1, 3), dtype=wp.vec3d, device="cpu")
        expected = pack_in_order(rays, order=packets.order)
        for got, want in (
            (packets.tiles.numpy(), expected.tiles.numpy()),
            (packets.packets.numpy(), expected.packets.numpy()),
        ):
            for name in got.dtype.names:
                np.testing.assert_array_equal(got[name], want[name], err_msg=f"{name}, {threads} threads")
        np.testing.assert_array_equal(np.sort(packets.order), np.arange(samples * lines))
        tiles = packets.order[: samples * lines // TILE * TILE].reshape(-1, TILE)
        np.testing.assert_array_equal(np.sort(tiles, axis=1).ravel(), np.arange(tiles.size), err_msg="rays of a tile")
        some = tiles % lines * -(-lines // 4) // lines  # lines at once, 4 at most, in the order of their numbers
        assert (np.diff(some, axis=1) >= 0).all()


def test_a_thin_wedge_bends_the_other_way_when_its_tilted_face_is_met_first() -> None:
    first, last = (
        Rosette(wedges=[wedge(tilt_deg=0.01, tilted_first=order)], sample_rate_hz=1).directions(np.zeros(1))
        for order in (True, False)
    )
    np.testing.assert_allclose(first[0, 0, 1:], -last[0, 0, 1:], atol=1e-9)
    assert np.arccos(first[0, 0, 0]) == pytest.approx(0.5 * np.deg2rad(0.01), rel=1e-4)


def test_wedges_that_undo_each_other_leave_the_lines() -> None:
    lines = (3.0, 0.0, -7.5)
    pair = [wedge(index=1.0, rpm=500), wedge(index=1.0, tilt_deg=80, rpm=-30)]
    rays = Rosette(wedges=pair, sample_rate_hz=10, line_elevation_deg=lines).directions(np.arange(50) / 10)
    azimuth, elevation = azimuth_elevation(rays)
    np.testing.assert_allclose(azimuth, 0, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(elevation), np.tile(lines, (50, 1)), atol=1e-12)


# data sheets: field of view across and up [deg]
@pytest.mark.parametrize(
    ("preset", "across", "up"),
    [
        ("livox_mid40", 38.4, 38.4),
        ("livox_mid70", 70.4, 70.4),
        ("livox_avia", 70.4, 77.2),
        ("livox_tele15", 14.5, 16.2),
    ],
)
def test_the_field_of_view_is_the_data_sheets(preset: str, across: float, up: float) -> None:
    azimuth, elevation = azimuth_elevation(livox(preset, rate_hz=0.2).pattern(MODEL).directions)
    np.testing.assert_allclose(np.rad2deg([np.ptp(azimuth), np.ptp(elevation)]), [across, up], atol=0.3)


@pytest.mark.parametrize("preset", LIVOX)
def test_readings_follow_each_other_without_a_break(preset: str) -> None:
    whole, tenth = (livox(preset, rate_hz=rate).pattern(MODEL) for rate in (1.0, 10.0))
    rays = tenth.shape[0]
    for k in (0, 1, 7):
        part = tenth.at(k / 10)
        assert part.shape == (rays,)
        np.testing.assert_allclose(part.directions, whole.directions[k * rays : (k + 1) * rays], atol=1e-9)
        np.testing.assert_array_equal(part.firing_times, tenth.firing_times)
    assert np.abs(tenth.at(0.1).directions - tenth.directions).max() > 0.05


def test_a_reading_is_in_the_order_of_its_times() -> None:
    pattern = livox("livox_avia").pattern(MODEL)
    assert pattern.ring is not None
    assert pattern.column is not None
    assert pattern.firing_times is not None
    np.testing.assert_array_equal(pattern.ring, np.tile(np.arange(6), 4000))
    np.testing.assert_array_equal(pattern.column, np.repeat(np.arange(4000), 6))
    np.testing.assert_allclose(pattern.firing_times, pattern.column / 40_000, rtol=1e-15)


def test_a_nodding_beam_is_its_series() -> None:
    beam = Nodding(
        spin_rpm=90,
        nod_hz=2,
        elevation_deg=[5, 20, 3],
        azimuth_deg=[10, 4],
        sample_rate_hz=8,
        line_elevation_deg=[0, 1],
    )
    azimuth, elevation = azimuth_elevation(beam.directions(np.array([0.0, 0.125, 0.25])))
    # a quarter and half of a nod; the spin makes 67.5 deg in 0.125 s
    np.testing.assert_allclose(np.rad2deg(elevation[:, 0]), [28, 2, -12], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(elevation[:, 1]), [29, 3, -11], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(azimuth[:, 0]), [10, 81.5, 145], atol=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rate_hz": None}, "rosette and nodding need rate_hz, got none"),
        ({"rate_hz": 1e6}, "sample_rate_hz: must be at least rate_hz"),
        ({"columns": 3, "rosette": Rosette(wedges=[wedge()], sample_rate_hz=10)}, "give a table of beams, or one of"),
    ],
)
def test_bad_rosettes_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        livox("livox_mid40", **given)


@pytest.mark.parametrize(
    "wedges",
    [
        [wedge(tilt_deg=45)],
        [wedge(tilt_deg=30), wedge(tilt_deg=-30, rpm=-60)],  # only where both bend it to one side: half a turn later
    ],
)
def test_wedges_that_reflect_are_refused(wedges: list[Wedge]) -> None:
    with pytest.raises(InputError, match="the wedges reflect the beam"):
        Rosette(wedges=wedges, sample_rate_hz=10)


def test_a_fault_in_a_wedge_has_its_place() -> None:
    given: Any = {"wedges": [{"rpm": 1, "tilt_deg": 2, "index": 0.5, "tilted_first": True}], "sample_rate_hz": 10}
    with pytest.raises(InputError, match=r"rosette.wedges\[0\].index: must be greater than or equal to 1, got 0.5"):
        Lidar(name="l", mount=Mount(), rate_hz=1.0, rosette=given)
