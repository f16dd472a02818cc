from typing import Any

import made_frames
import numpy as np
import pytest
from made_frames import make_frame, random_range
from PIL import Image

from rigcast.sensors.preview.colour import (
    INVALID,
    NO_RETURN,
    TOO_NEAR,
    Scale,
    id_colours,
    normal_colours,
    turbo,
)
from rigcast.sensors.preview.lidar import picture_order
from rigcast.sensors.preview.page import WIDTH, ticks
from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.pattern import Pattern

MODEL = made_frames.model()
SPECIAL = {"no return": np.inf, "too near": -np.inf, "invalid": np.nan}
COLOURS = {"no return": NO_RETURN, "too near": TOO_NEAR, "invalid": INVALID}


def lidar(elevation_deg: tuple[float, ...], columns: int, sector: tuple[float, float] | None = None) -> Pattern:
    spec = Lidar(name="s", mount=Mount(), elevation_deg=elevation_deg, columns=columns, azimuth_deg=sector)
    return spec.pattern(MODEL)


def camera(width: int, height: int) -> Pattern:
    return DepthCamera(name="s", mount=Mount(), resolution=(width, height), fov_y_deg=60).pattern(MODEL)


def scan(x: float, y: float) -> Pattern:
    return HeightScan(name="s", mount=Mount(), size=(x, y), spacing=0.1).pattern(MODEL)


def draw(kind: type[Frame], pattern: Pattern, distance: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The preview (H, W, 3) of a frame with these ranges and their points."""
    distance = distance.astype(np.float32).reshape(pattern.shape)
    origins = 0.0 if pattern.origins is None else pattern.origins
    reached = np.where(np.isfinite(distance), distance, np.nan)[..., None]
    points = (origins + pattern.directions * reached).astype(np.float32)
    page = make_frame(kind, distance, points=points, depth=distance, pattern=pattern).picture()
    assert page.mode == "RGB"
    return np.asarray(page)


def share(page: np.ndarray[Any, Any], colour: tuple[int, int, int]) -> float:
    return float(np.mean(np.all(page == colour, axis=-1)))


def centre_of(page: np.ndarray[Any, Any], colour: np.ndarray[Any, Any], box: tuple[slice, slice]) -> tuple[int, int]:
    """Mean row and column of the pixels of one colour within part of a page."""
    rows, columns = np.nonzero(np.all(page[box] == colour, axis=-1))
    assert rows.size, f"no pixel of colour {colour}"
    return int(rows.mean()) + (box[0].start or 0), int(columns.mean()) + (box[1].start or 0)


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (16, (0.25107, 0.25237, 0.63374)),
        (64, (0.15844, 0.73551, 0.92305)),
        (128, (0.64362, 0.98999, 0.23356)),
        (192, (0.98360, 0.49291, 0.12849)),
        (240, (0.66449, 0.08436, 0.00424)),
    ],
)
def test_turbo_follows_its_published_table_of_256(row: int, expected: tuple[float, float, float]) -> None:
    # https://gist.github.com/mikhailov-work/ee72ba4191942acecc03fe6da94fc73f; of these rows the polynomial is
    # farthest from row 128, by 19 of 255. Of the table's 0..1 the colours are those from 0.06 to 0.94.
    t = (row / 255 - 0.06) / 0.88
    np.testing.assert_allclose(turbo(np.array(t)).astype(int), 255 * np.array(expected), atol=20)


@pytest.mark.parametrize(("outside", "inside"), [(-3.0, 0.0), (7.0, 1.0), (np.nan, 0.0)])
def test_colours_outside_the_scale_are_those_of_its_ends(outside: float, inside: float) -> None:
    np.testing.assert_array_equal(turbo(np.array(outside)), turbo(np.array(inside)))


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [
        ([1.0, 2.0, 3.0], 1.02, 2.92),
        ([5.0, 5.0], 4.5, 5.5),
        ([np.inf, 2.0, np.nan, 4.0, -np.inf], 2.02, 3.92),
        ([np.inf, np.nan], np.nan, np.nan),
        ([], np.nan, np.nan),
    ],
)
def test_a_scale_spans_the_finite_values(values: list[float], low: float, high: float) -> None:
    scale = Scale.of(np.array(values))
    np.testing.assert_allclose((scale.low, scale.high), (low, high))


@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize("reverse", [False, True])
def test_rays_without_range_have_their_own_colours(kind: str, reverse: bool) -> None:
    colours = Scale(1.0, 9.0, reverse).colours(np.array([1.0, SPECIAL[kind], 9.0]))
    assert tuple(colours[1]) == COLOURS[kind]
    ramp = turbo(np.linspace(0.0, 1.0, 1000)).astype(int)
    assert np.linalg.norm(ramp - COLOURS[kind], axis=-1).min() > 60.0
    np.testing.assert_array_equal(colours[0], turbo(np.array(1.0 if reverse else 0.0)))


@pytest.mark.parametrize(
    ("low", "high", "most", "labels"),
    [
        (0.0, 10.0, 5, ["0", "2", "4", "6", "8", "10"]),
        (0.3, 1.1, 4, ["0.4", "0.6", "0.8", "1.0"]),
        (-1.0, 0.0, 2, ["-1.0", "-0.5", "0.0"]),
        (0.1171, 0.1199, 4, ["0.118", "0.119"]),
        (120.0, 1180.0, 5, ["500", "1000"]),
    ],
)
def test_ticks_are_round_and_within(low: float, high: float, most: int, labels: list[str]) -> None:
    assert [label for _, label in ticks(low, high, most)] == labels
    assert all(low <= value <= high and float(label) == pytest.approx(value) for value, label in ticks(low, high, most))


def test_neighbouring_ids_differ_and_a_miss_is_grey() -> None:
    colours = id_colours(np.arange(-1, 200)).astype(int)
    assert tuple(colours[0]) == NO_RETURN
    for step in (1, 2, 3):
        assert np.abs(colours[1 + step :] - colours[1:-step]).sum(axis=-1).min() > 40, f"ids {step} apart"


def test_normals_are_red_to_the_right_green_up_blue_towards_the_camera() -> None:
    right, up, towards, miss = normal_colours(np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1], [0, 0, 0]])).astype(int)
    assert [right.argmax(), up.argmax(), towards.argmax()] == [0, 1, 2]
    assert tuple(miss) == NO_RETURN


@pytest.mark.parametrize(
    ("kind", "pattern"),
    [
        (CameraFrame, camera(64, 48)),
        (CameraFrame, camera(1280, 720)),
        (CameraFrame, camera(1, 1)),
        (CameraFrame, camera(3, 200)),
        (CameraFrame, camera(200, 3)),
        (LidarFrame, lidar((-15.0, 0.0, 15.0), 360)),
        (LidarFrame, lidar((0.0,), 1)),
        (LidarFrame, lidar(tuple(np.linspace(-22, 22, 128)), 2048)),
        (LidarFrame, lidar((-5.0, 5.0), 7, (100.0, 200.0))),
        (Frame, scan(1.6, 1.0)),
        (Frame, scan(0.05, 0.05)),
        (Frame, scan(0.1, 4.0)),
    ],
)
def test_every_sensor_and_every_miss_gives_a_page(kind: type[Frame], pattern: Pattern) -> None:
    for seed in range(2):
        assert draw(kind, pattern, random_range(pattern.shape, seed)).shape[1] == WIDTH, f"seed {seed}"
    for name, miss in SPECIAL.items():
        page = draw(kind, pattern, np.full(pattern.shape, miss))
        assert page.shape[1] == WIDTH, name
        assert share(page, COLOURS[name]) > 5e-4, name


@pytest.mark.parametrize(("row", "column"), [(0, 0), (0, 39), (29, 0), (29, 39), (10, 30)])
def test_a_camera_pixel_is_where_the_image_has_it(row: int, column: int) -> None:
    distance = np.full((30, 40), np.inf)
    distance[row, column] = 2.0
    page = draw(CameraFrame, camera(40, 30), distance)
    shown = centre_of(page, turbo(np.array(0.5)), (slice(112, None), slice(0, 744)))
    assert shown == pytest.approx((112 + (row + 0.5) * 18, 24 + (column + 0.5) * 18), abs=2)


def test_of_a_lens_that_sees_behind_the_ranges_are_drawn() -> None:
    """Its z-depths are negative behind the camera, and would get the warmest colour."""
    depth, distance = np.full((30, 40), -3.0, np.float32), np.full((30, 40), 4.0, np.float32)
    depth[0], distance[0] = 1.0, 1.0
    page = np.asarray(make_frame(CameraFrame, distance, depth=depth).picture())
    near, far = (page[112 + row * 18, 24 + 20 * 18] for row in (0, 20))
    np.testing.assert_array_equal(near, turbo(np.array(1.0)))
    np.testing.assert_array_equal(far, turbo(np.array(0.0)))


@pytest.mark.parametrize("azimuth", [-170, -90, -45, 0, 30, 90, 175])
@pytest.mark.parametrize("beam", [0, 1, 2])
def test_a_range_is_drawn_at_its_azimuth_left_to_the_left_and_its_elevation(azimuth: int, beam: int) -> None:
    elevations = (0.0, 20.0, -10.0)
    distance = np.full((3, 360), np.inf)
    distance[beam, azimuth % 360] = 5.0
    page = draw(LidarFrame, lidar(elevations, 360), distance)
    row, column = centre_of(page, turbo(np.array(0.5)), (slice(112, 232), slice(24, 1084)))
    from_top = sorted(elevations, reverse=True).index(elevations[beam])
    assert (row - 112) // 40 == from_top
    assert column - 24 == pytest.approx(1060 * (180 - azimuth) / 360, abs=6)


@pytest.mark.parametrize(
    ("azimuth", "up", "left"),
    [(0, 1, 0), (90, 0, 1), (180, -1, 0), (270, 0, -1), (45, 1, 1)],
)
def test_from_above_forward_is_up_and_left_is_left(azimuth: int, up: int, left: int) -> None:
    distance = np.full((1, 360), 4.0)
    distance[0, azimuth] = 2.0
    pattern = lidar((0.0,), 360)
    page = draw(LidarFrame, pattern, distance)
    below = page[336:976, 24:1084]
    # All points have one height, so all have the colour of the middle of the scale.
    rows, columns = np.nonzero(np.all(below == turbo(np.array(0.5)), axis=-1))
    away = np.hypot(rows - 320, columns - 530)
    nearest = away.argmin()
    assert away.max() == pytest.approx(2 * away.min(), rel=0.05)
    assert np.sign(np.round((320 - rows[nearest]) / 20)) == up
    assert np.sign(np.round((530 - columns[nearest]) / 20)) == left


@pytest.mark.parametrize("order", ["x first", "y first"])
@pytest.mark.parametrize(("x", "y"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_a_height_is_drawn_where_its_ray_starts_whatever_the_order_of_rays(order: str, x: int, y: int) -> None:
    pattern = scan(0.3, 0.2)
    assert pattern.origins is not None
    picked = np.lexsort(pattern.origins[:, :2].T if order == "x first" else pattern.origins[:, 1::-1].T)
    pattern = Pattern(pattern.directions[picked], origins=pattern.origins[picked])
    assert pattern.origins is not None
    corner = np.argmax(pattern.origins[:, 0] * x + pattern.origins[:, 1] * y)
    distance = np.full(pattern.shape, np.inf)
    distance[corner] = 1.0
    page = draw(Frame, pattern, distance)
    row, column = centre_of(page, turbo(np.array(0.5)), (slice(112, 112 + 640), slice(24, 24 + 480)))
    assert (row - 112) // 160 == (0 if x > 0 else 3)
    assert (column - 24) // 160 == (0 if y > 0 else 2)


def test_a_preview_is_a_png_that_is_read_back(tmp_path: Any) -> None:
    page = make_frame(CameraFrame, random_range((6, 8), 0)).picture()
    page.save(tmp_path / "preview.png")
    with Image.open(tmp_path / "preview.png") as image:
        np.testing.assert_array_equal(np.asarray(image), np.asarray(page))


def test_beams_that_are_turned_against_each_other_make_a_straight_picture() -> None:
    """Upright things are upright in the picture: each column has one azimuth, to within a step."""
    offsets = [3.2, 1.1, -1.1, -3.2]
    spec = Lidar(name="top", mount=Mount(), elevation_deg=[-3, 0, 3, 6], azimuth_offset_deg=offsets, columns=360)
    directions = spec.pattern(MODEL).directions
    order, azimuth = picture_order(directions)
    shown = np.rad2deg(np.arctan2(directions[..., 1], directions[..., 0]))[order]
    assert (np.diff(np.rad2deg(azimuth)) < 0).all()
    assert np.ptp(shown, axis=0).max() < 1.001
    np.testing.assert_allclose(np.arcsin(directions[..., 2])[order][:, 0], np.deg2rad([6, 3, 0, -3]))
