"""A file of rays is read whole, in order, and spread over readings of one size."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.lidars.ray_file import RayFile
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.pattern import Pattern, azimuth_elevation

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
PLAIN = "0,10,-5\n0.25,20,0\n0.5,-30,5\n"


def pattern(path: Path, rate_hz: float | None = None, **given: Any) -> Pattern:
    rays = RayFile(path=path, **{key: given.pop(key) for key in ("sample_rate_hz",) if key in given})
    return Lidar(name="l", mount=Mount(), ray_file=rays, rate_hz=rate_hz, **given).pattern(MODEL)


def write(folder: Path, text: str) -> Path:
    (folder / "rays.csv").write_text(text)
    return folder / "rays.csv"


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(PLAIN, id="plain"),
        pytest.param("time,azimuth,elevation\n" + PLAIN, id="header"),
        pytest.param("\ufeffTime/s,Azimuth/deg,Zenith/deg\n0,10,95\n.25,20,90\n.5,-30,85\n", id="Livox's header"),
        pytest.param("elevation_deg, time_s, azimuth_deg\n-5,0,10\n0,.25,20\n5,.5,-30\n", id="other order"),
        pytest.param("\ntime,azimuth,elevation\n# a comment\n" + PLAIN.replace("\n", "\n\n"), id="gaps"),
        pytest.param("7,10,-5\r\n7.25,20,0\r\n7.5,-30,5\r\n", id="time from 7, CRLF"),
    ],
)
def test_csv_says_where_and_when(tmp_path: Path, text: str) -> None:
    found = pattern(write(tmp_path, text))
    azimuth, elevation = azimuth_elevation(found.directions)
    np.testing.assert_allclose(np.rad2deg(azimuth), [10, 20, -30], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(elevation), [-5, 0, 5], atol=1e-12)
    np.testing.assert_array_equal(found.firing_times, [0, 0.25, 0.5])
    np.testing.assert_array_equal(found.ring, 0)
    np.testing.assert_array_equal(found.column, [0, 1, 2])


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64])
def test_npy_is_the_same(tmp_path: Path, kind: type) -> None:
    np.save(tmp_path / "rays.npy", np.array([[0, 10, -5, 3], [1, 20, 0, 2], [2, -30, 5, 3]], dtype=kind))
    found = pattern(tmp_path / "rays.npy")
    azimuth, elevation = azimuth_elevation(found.directions)
    np.testing.assert_allclose(np.rad2deg([azimuth, elevation]), [[10, 20, -30], [-5, 0, 5]], atol=1e-12)
    np.testing.assert_array_equal(found.ring, [3, 2, 3])


def test_rays_may_point_straight_up_and_down(tmp_path: Path) -> None:
    found = pattern(write(tmp_path, "0,0,90\n1,0,-90\n"))
    np.testing.assert_allclose(found.directions, [[0, 0, 1], [0, 0, -1]], atol=1e-15)


# rows at 100 Hz: how many, rate of the readings -> readings in the file, rays in each
@pytest.mark.parametrize(
    ("rows", "rate_hz", "readings", "rays"),
    [(40, 10.0, 4, 10), (43, 10.0, 5, 8), (10, 10.0, 1, 10), (7, 10.0, 1, 7), (40, None, 1, 40), (30, 33.0, 10, 3)],
)
def test_a_long_file_is_spread_over_readings(
    tmp_path: Path, rows: int, rate_hz: float | None, readings: int, rays: int
) -> None:
    times, azimuth = np.arange(rows) / 100, np.arange(rows) * 2.0
    np.save(tmp_path / "rays.npy", np.stack([times, azimuth, 0 * times], axis=1))
    found = pattern(tmp_path / "rays.npy", rate_hz)
    for k in range(2 * readings + 1):
        part = found.at(k / (rate_hz or 1))
        own = slice(k % readings * rays, (k % readings + 1) * rays)
        np.testing.assert_allclose(np.rad2deg(azimuth_elevation(part.directions)[0]), azimuth[own], atol=1e-9)
        assert part.firing_times is not None
        np.testing.assert_allclose(part.firing_times, np.arange(rays) / 100, atol=1e-12)


def test_phase_and_jitter_do_not_change_which_rows_are_next(tmp_path: Path) -> None:
    np.save(tmp_path / "rays.npy", np.stack([np.arange(40) / 100, np.arange(40.0), np.zeros(40)], axis=1))
    found = pattern(tmp_path / "rays.npy", 10.0, phase=0.07, jitter=0.04)
    for k, off in ((0, -0.04), (1, 0.04), (2, 0.0), (6, 0.03)):
        first = np.rad2deg(azimuth_elevation(found.at(0.07 + k / 10 + off).directions)[0][0])
        assert first == pytest.approx(10 * (k % 4)), k


def test_times_that_only_count_are_given_a_rate(tmp_path: Path) -> None:
    path = write(tmp_path, "Time/s,Azimuth/deg,Zenith/deg\n" + "".join(f"{i + 1},{i},90\n" for i in range(60)))
    with pytest.raises(InputError, match=r"60 rows over 60 s are less than one per reading at 10 Hz.*sample_rate_hz"):
        pattern(path, 10.0)
    found = pattern(path, 10.0, sample_rate_hz=200.0)
    assert found.shape == (20,)
    assert found.firing_times is not None
    np.testing.assert_allclose(found.firing_times, np.arange(20) / 200)


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    path = write(tmp_path, PLAIN)
    assert pattern(path).shape == (3,)
    write(tmp_path, PLAIN + "1,2,3\n")
    assert pattern(path).shape == (4,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"rays.csv:1: column '' is unknown"),
        ("time,azimuth,elevation\n", "rays.csv: got no row"),
        (PLAIN + "0.6,x,1\n", r"rays.csv:4: got '0.6,x,1', expected 3 numbers"),
        (PLAIN + "0.6,1\n", r"rays.csv:4: got '0.6,1', expected 3 numbers"),
        (PLAIN + "0.6,1,nan\n", r"rays.csv:4: got a number that is not finite"),
        (PLAIN + "0.3,1,2\n", r"rays.csv:4: got a time before that of the row above"),
        ("time,azimuth,elevation\n" + PLAIN + "0.7,1,91\n", r"rays.csv:5: got an elevation beyond 90 deg"),
        ("time,azimut,elevation\n" + PLAIN, r"rays.csv:1: column 'azimut' is unknown.*did you mean 'azimuth'"),
        ("time,time,elevation\n" + PLAIN, r"rays.csv:1: column 'time' is unknown or named twice"),
        ("\n\n" + PLAIN + "\n0.6,1,nan\n", r"rays.csv:7: got a number that is not finite"),
        ("time,azimuth,elevation\n\n# first\n0,1,2 # here\n\n1,2,91\n", r"rays.csv:6: got an elevation beyond 90 deg"),
        (PLAIN + "\n# last\n0.6,x,1\n", r"rays.csv:6: got '0.6,x,1', expected 3 numbers"),
        ("\ntime,azimut,elevation\n" + PLAIN, r"rays.csv:2: column 'azimut' is unknown"),
        ("time,azimuth\n0,1\n", r"rays.csv:1: got columns time, azimuth, expected time, azimuth, and elevation or"),
        ("0,1\n", r"rays.csv:1: got '0,1', expected 3 numbers"),
        ("0,1,2,3,4\n", r"rays.csv:1: got '0,1,2,3,4', expected 4 numbers"),
    ],
)
def test_faults_of_a_csv_file_have_their_line(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=message):
        pattern(path)
    (fault,) = Lidar(name="l", mount=Mount(), ray_file=RayFile(path=path)).faults(MODEL)
    assert fault.where == ("ray_file", "path")


def test_other_files_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.zeros(5))
    (tmp_path / "text.npy").write_text("no numbers")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe,1,2")
    for name, message in {
        "flat.npy": r"got float64 of shape \(5,\), expected numbers \(n, 3\)",
        "text.npy": "not an NPY file",
        "bytes.csv": "cannot be read",
        "none.csv": "cannot be read: No such file",
    }.items():
        with pytest.raises(InputError, match=message):
            pattern(tmp_path / name)
    with pytest.raises(InputError, match=r"path: must be a file of type .csv or .npy, got 'rays.txt'"):
        RayFile(path=Path("rays.txt"))
    with pytest.raises(InputError, match="path: must be the path of a file, got 3"):
        RayFile(path=3)  # type: ignore[arg-type]
