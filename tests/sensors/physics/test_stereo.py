"""Stereo cameras have the errors of their formulas, in statistics of 1.2e5 pixels."""

from statistics import NormalDist
from typing import Any

import mujoco
import numpy as np
import pytest
from confidence import assert_counts, assert_normal, assert_share
from depth_scenes import FOCAL, HEIGHT, WALL, WIDTH, camera, columns, depth_of, look, rig
from numpy.typing import NDArray

from rigcast import CameraFrame, Mount, Rig, Stereo
from rigcast.sensors.errors import InputError

BASELINE = 0.05
FB = FOCAL * BASELINE
SLANTED = '<geom name="wall" type="plane" size="0 0 1" zaxis="-1 0.7 0.2" pos="2 0 0"/>'
PLATE = '<geom name="plate" type="box" size="0.01 {} 9" pos="1.01 0 0"/>'  # its face at x = 1
BALL = '<geom name="ball" size="0.3" pos="1.5 0.1 0"/><geom type="capsule" size="0.1 0.4" pos="1.2 -0.4 0.1"/>'


def stereo_depth(worldbody: str, seed: int = 0, **arguments: Any) -> NDArray[np.float64]:
    return depth_of(worldbody, seed, stereo=Stereo(**{"baseline": BASELINE, **arguments}))


@pytest.mark.parametrize("worldbody", [WALL.format(2), SLANTED, WALL.format(3) + BALL])
def test_a_stereo_camera_without_errors_is_the_ideal_one_bit_for_bit(worldbody: str) -> None:
    ideal, stereo = look(worldbody, camera()), look(worldbody, camera(stereo=Stereo(baseline=BASELINE)))
    for name in ("range", "depth", "normal", "geom_id", "points", "intensity"):
        np.testing.assert_array_equal(getattr(ideal, name).numpy(), getattr(stereo, name).numpy(), err_msg=name)


@pytest.mark.parametrize(("z", "std", "baseline"), [(0.5, 0.05, 0.05), (2.0, 0.1, 0.05), (4.0, 0.08, -0.12)])
def test_disparity_noise_is_normal(z: float, std: float, baseline: float) -> None:
    measured = stereo_depth(WALL.format(z), baseline=baseline, disparity_std=std)
    disparity = FOCAL * abs(baseline) / measured
    assert_normal(disparity, FOCAL * abs(baseline) / z, std, f"z {z}")


@pytest.mark.parametrize(("z", "std"), [(0.5, 0.02), (1.0, 0.02), (2.0, 0.02)])
def test_the_error_of_depth_grows_with_its_square(z: float, std: float) -> None:
    """sigma_z = z^2 s / (f B) to first order in s; the second order is less than 1 / 500 of it."""
    measured = stereo_depth(WALL.format(z), disparity_std=std)
    expected = z * z * std / FB
    allowed = expected * (4.89 / np.sqrt(2 * measured.size) + 4e-3)
    assert abs(measured.std() - expected) < allowed


@pytest.mark.parametrize("step", [1 / 8, 1 / 32])
def test_disparity_is_a_multiple_of_its_step(step: float) -> None:
    ideal, measured = depth_of(SLANTED), stereo_depth(SLANTED, disparity_step=step)
    steps = FB / measured / step
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-4)
    error = (FB / measured - FB / ideal) / step
    assert np.abs(error).max() <= 0.5 + 1e-4
    counts, _ = np.histogram(error, 10, (-0.5, 0.5))
    np.testing.assert_allclose(counts / error.size, 0.1, atol=0.01)


def test_noise_comes_before_the_step() -> None:
    """P(k steps) is the normal distribution's probability between k - 1/2 and k + 1/2 steps."""
    std, step, z = 0.1, 1 / 8, 2.03
    measured = stereo_depth(WALL.format(z), disparity_std=std, disparity_step=step)
    steps = np.rint(FB / measured / step)
    edges = (np.arange(-3, 5) + np.rint(FB / z / step) - 0.5) * step
    below = np.array([0.0, *(NormalDist(FB / z, std).cdf(edge) for edge in edges), 1.0])
    assert_counts(np.histogram(steps * step, [-np.inf, *edges, np.inf])[0], np.diff(below))


@pytest.mark.parametrize(("offset", "reads"), [(-0.001, -np.inf), (0.001, None)])
def test_the_nearest_depth_is_that_of_the_greatest_disparity(offset: float, reads: float | None) -> None:
    """For a RealSense D455 with fx = 447 pixels, a baseline of 95 mm and 126 pixels of disparity it is 0.337 m."""
    z = 447 * 0.095 / 126 + offset
    assert z - offset == pytest.approx(0.337, abs=5e-4)
    spec = camera(
        fx=447.0, fy=447.0, cx=20.0, cy=10.0, resolution=(40, 20), stereo=Stereo(baseline=0.095, max_disparity=126)
    )
    frame = look(WALL.format(z), spec)
    expected = z if reads is None else reads
    np.testing.assert_allclose(frame.depth.numpy(), expected, rtol=1e-6)
    assert (frame.geom_id.numpy() == (0 if reads is None else -1)).all()


def test_a_disparity_below_half_a_step_is_no_return() -> None:
    far = WALL.format(FB / (0.49 / 8))
    assert (stereo_depth(far, disparity_step=1 / 8) == np.inf).all()
    assert np.isfinite(stereo_depth(WALL.format(FB / (0.51 / 8)), disparity_step=1 / 8)).all()


@pytest.mark.parametrize("baseline", [0.05, -0.08])
def test_shadow_beside_a_plate(baseline: float) -> None:
    """It is f |B| (1 / z1 - 1 / z2) wide, on the side away from the second imager; f |B| / z is outside its image."""
    half_width, near, far, centre = 0.1, 1.0, 3.0, 150.0
    stereo = Stereo(baseline=baseline, shadow=True)
    seen = depth_of(PLATE.format(half_width) + WALL.format(far), cx=centre, stereo=stereo)
    left, right = centre - FOCAL * half_width / near, centre + FOCAL * half_width / near
    u, shift = columns(), FOCAL * baseline * (1 / near - 1 / far)
    on_plate = (u > left) & (u < right)
    # the second imager at B sees a point at depth z moved by -f B / z
    in_shadow = ~on_plate & (u - FOCAL * baseline / far > left - FOCAL * baseline / near)
    in_shadow &= u - FOCAL * baseline / far < right - FOCAL * baseline / near
    assert abs(in_shadow.sum() - abs(shift)) <= 1
    beyond = (u - FOCAL * baseline / far < 0) | (u - FOCAL * baseline / far > WIDTH)
    assert abs(beyond.sum() - abs(FOCAL * baseline / far)) <= 1
    expected = np.where(on_plate, near, np.where(in_shadow | beyond, np.nan, far))
    np.testing.assert_allclose(seen, np.tile(expected, (HEIGHT, 1)), rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_shadow_is_what_mj_ray_says_that_the_second_imager_does_not_see(seed: int) -> None:
    """Every pixel at round and slanted geoms; none is in the shadow of its own surface."""
    random = np.random.default_rng(seed)
    geoms = "".join(
        f'<geom type="{kind}" size="{" ".join(map(str, random.uniform(0.1, 0.4, 3)))}" '
        f'pos="{random.uniform(1, 3)} {random.uniform(-1, 1)} {random.uniform(-0.7, 0.7)}" '
        f'euler="{" ".join(map(str, random.uniform(0, 180, 3)))}"/>'
        for kind in ("ellipsoid", "box", "capsule", "cylinder", "sphere", "box")
    )
    world = geoms + WALL.format(4) + '<geom type="plane" size="0 0 1" pos="0 0 -0.8"/>'
    ideal, got = look(world, camera()), stereo_depth(world, shadow=True)
    watching = rig(world, camera())
    data = mujoco.MjData(watching.model)
    mujoco.mj_forward(watching.model, data)
    second, points = np.array([0.0, -BASELINE, 0.0]), ideal.points_world.numpy()  # right is -y
    wrong = 0
    for v, u in np.argwhere(np.isfinite(ideal.depth.numpy()))[:: 7 + seed]:
        offset = points[v, u] - second
        length = np.linalg.norm(offset)
        normal = ideal.normal.numpy()[v, u] @ ideal.pose[:3, :3].T
        # mj_ray has no answer to whether a ray that grazes ends on the surface or just before
        if abs(normal @ offset) / length < 0.02:
            continue
        met = mujoco.mj_ray(watching.model, data, second, offset / length, None, 1, -1, np.zeros(1, np.int32))
        is_hidden = met < length - 1e-3
        column = WIDTH / 2 - FOCAL * (points[v, u, 1] + BASELINE) / points[v, u, 0]
        wrong += np.isnan(got[v, u]) != (is_hidden or not 0 <= column <= WIDTH)
    assert wrong == 0, f"seed {seed}"
    assert 0.02 < np.isnan(got).mean() < 0.5


@pytest.mark.parametrize("window", [3, 7, 9])
def test_edges_grow_by_half_a_window(window: int) -> None:
    frame = look(PLATE.format(0.1) + WALL.format(3), camera(stereo=Stereo(baseline=BASELINE, matching_window=window)))
    near = np.abs(columns() - WIDTH / 2) < FOCAL * 0.1 + window // 2
    np.testing.assert_allclose(frame.depth.numpy(), np.tile(np.where(near, 1.0, 3.0), (HEIGHT, 1)), rtol=1e-6)
    # ids are those of the surface whose depth is measured
    np.testing.assert_array_equal(frame.geom_id.numpy(), np.tile(np.where(near, 0, 1), (HEIGHT, 1)))


@pytest.mark.parametrize("worldbody", [SLANTED, '<geom type="plane" size="0 0 1" pos="0 0 -0.5"/>'])
def test_a_slanted_surface_has_no_edges(worldbody: str) -> None:
    np.testing.assert_array_equal(stereo_depth(worldbody, matching_window=9), depth_of(worldbody))


def test_an_edge_against_nothing_grows_too() -> None:
    near = np.abs(columns() - WIDTH / 2) < FOCAL * 0.1 + 3
    measured = stereo_depth(PLATE.format(0.1), matching_window=7)
    np.testing.assert_allclose(measured, np.tile(np.where(near, 1.0, np.inf), (HEIGHT, 1)), rtol=1e-6)


@pytest.mark.parametrize("share", [0.001, 0.2, 1.0])
def test_dropout_is_the_share_of_pixels_lost(share: float) -> None:
    lost = np.isnan(stereo_depth(WALL.format(2), dropout=share))
    assert_share(lost, share)


def test_untextured_dropout_spares_textured_materials() -> None:
    assets = '<texture name="t" type="2d" builtin="checker" width="8" height="8"/><material name="m" texture="t"/>'
    world = WALL.format(2) + PLATE.format(0.1).replace("<geom", '<geom material="m"')
    model = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>")
    frame = Rig(model, [camera(stereo=Stereo(baseline=0.1, untextured_dropout=0.3))], "cpu").sense(
        mujoco.MjData(model)
    )["eye"]
    lost = np.isnan(frame.range.numpy())
    on_plate = np.abs(columns() - WIDTH / 2) < FOCAL * 0.1
    assert not lost[:, on_plate].any()
    assert_share(lost[:, ~on_plate], 0.3)


@pytest.mark.parametrize("limit", [30.0, 60.0])
def test_grazing_surfaces_are_lost(limit: float) -> None:
    frame = look(SLANTED, camera())
    rays = frame.points.numpy() / frame.range.numpy()[..., None]
    incidence = np.degrees(np.arccos(np.abs((rays * frame.normal.numpy()).sum(axis=-1))))
    lost = np.isnan(stereo_depth(SLANTED, max_incidence_deg=limit))
    clear = np.abs(incidence - limit) > 1e-3
    np.testing.assert_array_equal(lost[clear], incidence[clear] > limit)
    assert 0.05 < lost.mean() < 0.95


def test_dark_surfaces_are_lost() -> None:
    intensity = look(SLANTED, camera()).intensity.numpy()
    limit = float(np.median(intensity)) * 1.0001
    lost = np.isnan(stereo_depth(SLANTED, min_intensity=limit))
    np.testing.assert_array_equal(lost, intensity < np.float32(limit))


def test_the_measured_range_is_what_limits_bound() -> None:
    """Limits apply after the errors: of a wall exactly at the limit, half of the readings are beyond it."""
    narrow: dict[str, Any] = {"fx": 1e6, "fy": 1e6}  # so that range and depth are the same
    error = Stereo(baseline=0.05 * FOCAL / 1e6, disparity_std=0.01)
    measured = depth_of(WALL.format(2), max_range=2.0, stereo=error, **narrow)
    assert_share(measured == np.inf, 0.5)
    measured = depth_of(WALL.format(2), min_range=2.0, stereo=error, **narrow)
    assert_share(measured == -np.inf, 0.5)


def test_an_effect_does_not_change_the_numbers_of_another() -> None:
    world = WALL.format(2) + BALL
    noisy = stereo_depth(world, disparity_std=0.1)
    lossy = stereo_depth(world, disparity_std=0.1, dropout=0.3)
    np.testing.assert_array_equal(lossy[~np.isnan(lossy)], noisy[~np.isnan(lossy)])


def test_noise_is_of_the_seed_the_name_and_the_frame() -> None:
    stereo = Stereo(baseline=BASELINE, disparity_std=0.1)
    other = camera(name="other", mount=Mount(pos=(0, 0, 0)), stereo=stereo)

    def depths(seed: int, *cameras: Any) -> list[NDArray[np.float32]]:
        watching = rig(WALL.format(2), *cameras, seed=seed)
        frames = [watching.sense(mujoco.MjData(watching.model))["eye"] for _ in range(2)]
        return [frame.depth.numpy() for frame in frames if isinstance(frame, CameraFrame)]

    eye = camera(stereo=stereo)
    first, second = depths(1, eye)
    again, again_second = depths(1, other, eye)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(second, again_second)
    for another in (second, depths(2, eye)[0], rig_first(other)):
        assert abs(np.corrcoef(first.ravel() - 2, another.ravel() - 2)[0, 1]) < 4.89 / np.sqrt(first.size)


def rig_first(spec: Any) -> NDArray[np.float32]:
    return look(WALL.format(2), spec, 1).depth.numpy()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "baseline: required, but not given"),
        ({"baseline": 0.0}, "baseline: must not be 0"),
        ({"baseline": 0.1, "matching_window": 4}, "matching_window: must be odd, got 4"),
        ({"baseline": 0.1, "disparity_std": -1}, "disparity_std: must be greater than or equal to 0, got -1"),
        (
            {"baseline": 0.1, "disparity_std": 0.1, "kinect_v1": "nguyen"},
            "kinect_v1: replaces disparity_std, expected one or the other",
        ),
        ({"baseline": 0.1, "dropout": 1.1}, "dropout: must be less than or equal to 1, got 1.1"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Stereo(**arguments)
