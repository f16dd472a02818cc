"""Lenses agree with OpenCV, and pixels are undistorted to 1e-9."""

import numpy as np
import pytest

from rigcast.sensors.specs.lens import BrownConrady, KannalaBrandt, Lens

PLUMB_BOB = BrownConrady(k1=-0.055, k2=0.066, p1=0.0006, p2=-0.0009, k3=-0.021)
RATIONAL = BrownConrady(k1=0.45, k2=-2.6, p1=0.0011, p2=-0.0004, k3=1.49, k4=0.33, k5=-2.43, k6=1.42)
FOUR = BrownConrady(k1=-0.28, k2=0.07, p1=0.0006, p2=-0.0009)
FISHEYE = KannalaBrandt(k1=-0.012, k2=0.041, k3=-0.035, k4=0.0077)

# Computed once with OpenCV 5.0.0: cv2.projectPoints and cv2.fisheye.projectPoints of RAYS (FISHEYE_RAYS), without
# rotation or translation, with the camera matrix below and the coefficients above.
FOCAL, CENTRE = (430.5, 428.75), (319.25, 241.5)
RAYS = [(0, 0, 1), (0.4, -0.3, 1), (-0.7, 0.5, 1), (0.05, 0.55, 1), (0.7, 0.5, 1)]
FISHEYE_RAYS = [(0, 0, 1), (0.4, -0.3, 1), (-0.7, 0.5, 1), (2.0, 1.5, 1), (-5, 8, 1)]
OPENCV = [
    (
        FOUR,
        RAYS,
        [
            (319.25, 241.5),
            (479.86653650000005, 121.519243125),
            (67.94114780000001, 420.263025),
            (338.97102741875, 458.922538921875),
            (569.2260242, 419.7228),
        ],
    ),
    (
        PLUMB_BOB,
        RAYS,
        [
            (319.25, 241.5),
            (489.453233375, 114.35844820312498),
            (20.99084914040003, 453.66262770500003),
            (340.42734595543436, 474.876922890836),
            (616.1763228596001, 453.122402705),
        ],
    ),
    (
        RATIONAL,
        RAYS,
        [
            (319.25, 241.5),
            (494.93747245195146, 110.35577819899967),
            (2.4352264268704857, 467.1347158142181),
            (341.28342666499515, 483.60168691427594),
            (635.4724055731294, 466.8946158142181),
        ],
    ),
    (
        FISHEYE,
        FISHEYE_RAYS,
        [
            (319.25, 241.5),
            (478.7679697121156, 122.34785798942586),
            (70.29020318702908, 418.6055465132923),
            (727.8681777675986, 546.7178461983588),
            (-8.521488310679729, 763.802534218644),
        ],
    ),
]


@pytest.mark.parametrize(("lens", "rays", "pixels"), OPENCV)
def test_rays_are_seen_where_opencv_sees_them(
    lens: Lens, rays: list[tuple[float, ...]], pixels: list[tuple[float, float]]
) -> None:
    seen = lens.distort(np.array(rays, np.float64)) * FOCAL + CENTRE
    np.testing.assert_allclose(seen, pixels, atol=1e-10, rtol=0)


@pytest.mark.parametrize(("lens", "rays", "pixels"), OPENCV)
def test_the_pixel_of_opencv_looks_along_the_ray(
    lens: Lens, rays: list[tuple[float, ...]], pixels: list[tuple[float, float]]
) -> None:
    wanted = np.array(rays, np.float64)
    looks = lens.undistort((np.array(pixels) - CENTRE) / FOCAL)
    np.testing.assert_allclose(looks, wanted / np.linalg.norm(wanted, axis=1, keepdims=True), atol=1e-12, rtol=0)


def random_lens(seed: int) -> tuple[Lens, float]:
    """A lens with typical coefficients, and the radius of its image on the plane z = 1."""
    random = np.random.default_rng(seed)
    if seed % 2:
        k = random.normal(0, 0.01, 4)
        theta = np.linspace(0, 2, 2001)
        image = theta * (1 + sum(k[n] * theta ** (2 * n + 2) for n in range(4)))
        has_folded = np.append(np.diff(image) <= 0, True)
        return KannalaBrandt(k1=k[0], k2=k[1], k3=k[2], k4=k[3]), 0.99 * float(image[has_folded.argmax()])
    radial = dict(zip(("k1", "k2", "k3"), random.uniform(-0.1, 0.1, 3), strict=True))
    denominator = dict(zip(("k4", "k5", "k6"), random.uniform(0.0, 0.1, 3), strict=True))
    return BrownConrady(**radial, **denominator, p1=random.normal(0, 1e-3), p2=random.normal(0, 1e-3)), 0.7


@pytest.mark.parametrize("seed", range(40))
def test_pixels_are_undistorted_to_1e9(seed: int) -> None:
    lens, reach = random_lens(seed)
    angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, 5000)
    radius = reach * np.sqrt(np.random.default_rng(seed + 1000).uniform(0, 1, 5000))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    looks = lens.undistort(points)
    assert np.isfinite(looks).all(), f"seed {seed}"
    np.testing.assert_allclose(np.linalg.norm(looks, axis=-1), 1, atol=1e-14)
    np.testing.assert_allclose(lens.distort(looks), points, atol=1e-12, rtol=0, err_msg=f"seed {seed}")


@pytest.mark.parametrize("seed", range(20))
def test_rays_come_back_to_1e9(seed: int) -> None:
    """The inverse: `undistort` of the distorted rays gives the rays."""
    lens, reach = random_lens(seed)
    rays = np.random.default_rng(seed).uniform(-1, 1, (5000, 3))
    rays[:, :2] *= 0.5 * reach
    rays[:, 2] = 1
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(lens.undistort(lens.distort(rays)), rays, atol=1e-9, rtol=0, err_msg=f"seed {seed}")


@pytest.mark.parametrize("lens", [BrownConrady(), KannalaBrandt()])
def test_the_centre_looks_ahead(lens: Lens) -> None:
    np.testing.assert_array_equal(lens.undistort(np.zeros((1, 2))), [[0, 0, 1]])
    np.testing.assert_array_equal(lens.distort(np.array([[0.0, 0.0, 1.0]])), [[0, 0]])


def test_a_fisheye_looks_backwards_too() -> None:
    looks = KannalaBrandt().undistort(np.array([[np.deg2rad(120), 0.0]]))
    np.testing.assert_allclose(looks, [[np.sin(np.deg2rad(120)), 0, np.cos(np.deg2rad(120))]], atol=1e-15)


@pytest.mark.parametrize(
    ("lens", "radius", "is_seen"),
    [
        (KannalaBrandt(), 3.14, True),
        (KannalaBrandt(), 3.15, False),
        (KannalaBrandt(k1=-0.1), 1.21716, True),  # theta (1 - theta^2 / 10) is at most 1.21716, at 1.82574
        (KannalaBrandt(k1=-0.1), 1.21717, False),
        (BrownConrady(k1=-0.1), 1.21716, True),  # the same in r, and above it a branch from beyond the fold
        (BrownConrady(k1=-0.1), 1.21717, False),
        (BrownConrady(k1=-0.1, k2=0.002), 1.6, False),  # reached again from beyond the fold
        (BrownConrady(k3=-0.1), 0.90964, True),  # r (1 - r^6 / 10) is at most 0.909641, at 1.06125
        (BrownConrady(k3=-0.1), 0.90965, False),
    ],
)
def test_pixels_beyond_the_fold_look_nowhere(lens: Lens, radius: float, is_seen: bool) -> None:
    points = radius * np.array([[1.0, 0.0], [0.0, -1.0], [0.6, 0.8]])
    assert (np.isfinite(lens.undistort(points)).all(axis=-1) == is_seen).all()


@pytest.mark.parametrize(
    ("lens", "coefficients"),
    [(PLUMB_BOB, [-0.055, 0.066, 0.0006, -0.0009, -0.021, 0, 0, 0]), (FISHEYE, [-0.012, 0.041, -0.035, 0.0077])],
)
def test_coefficients_are_in_opencvs_order(lens: Lens, coefficients: list[float]) -> None:
    assert lens.coefficients.tolist() == coefficients
