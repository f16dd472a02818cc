"""The first Kinect has the errors of Nguyen et al. and of Barron and Malik."""

from statistics import NormalDist
from typing import Any, Literal

import numpy as np
import pytest
from confidence import assert_counts, assert_normal, assert_share
from depth_scenes import OPTICS, WALL, depth_of
from numpy.typing import NDArray

from rigcast import Stereo

Model = Literal["nguyen", "disparity"]


def kinect_depth(worldbody: str, model: Model, focal: float = OPTICS["fx"], seed: int = 0) -> NDArray[np.float64]:
    kinect = Stereo(baseline=-0.075, kinect_v1=model)
    return depth_of(worldbody, seed, stereo=kinect, fx=focal, fy=focal)


def tilted(z: float, theta_deg: float) -> str:
    """A wall at depth z ahead [m], whose normal is tilted up by theta from the camera's axis."""
    theta = np.deg2rad(theta_deg)
    return f'<geom type="plane" size="0 0 1" zaxis="{-np.cos(theta)} 0 {np.sin(theta)}" pos="{z} 0 0"/>'


@pytest.mark.parametrize("z", [0.6, 1.5, 3.5])
@pytest.mark.parametrize("theta_deg", [0, 40, 70, 85])
def test_axial_noise_is_nguyens(z: float, theta_deg: float) -> None:
    """The focal length is so long that all pixels have one depth, so that lateral noise makes no difference."""
    theta = np.deg2rad(theta_deg)
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2 + 0.0001 / np.sqrt(z) * theta**2 / (np.pi / 2 - theta) ** 2
    measured = kinect_depth(tilted(z, theta_deg), "nguyen", focal=1e8)
    assert_normal(measured, z, sigma, f"z {z}, theta {theta_deg}")


@pytest.mark.parametrize("theta_deg", [0, 60, 88])
@pytest.mark.parametrize("model", ["nguyen", "disparity"])
def test_lateral_noise_blurs_an_edge(model: Model, theta_deg: float) -> None:
    """At x pixels from the edge of a half plane, the share Phi(x / sigma) of pixels sees it.

    The edge runs up the middle of a narrow image, between a near and a far wall that are both turned by theta.
    """
    theta = np.deg2rad(theta_deg)
    sigma = 0.8 + 0.035 * theta / (np.pi / 2 - theta) if model == "nguyen" else 0.5
    turn = f"{np.cos(theta / 2)} 0 {np.sin(theta / 2)} 0"
    left_half = f'<geom type="box" size="0.001 5 9" pos="1 5 0" quat="{turn}"/>'
    width, height = 12, 8000
    kinect = Stereo(baseline=-0.075, kinect_v1=model)
    optics: dict[str, Any] = {"resolution": (width, height), "fx": 4e4, "fy": 1e8, "cx": width / 2, "cy": height / 2}
    scene = left_half + tilted(9.0, theta_deg)
    measured = np.concatenate([depth_of(scene, seed=seed, stereo=kinect, **optics) for seed in range(5)])
    for column in range(width):
        share = NormalDist(0, sigma).cdf(width / 2 - column - 0.5)
        assert_share(measured[:, column] < 4, share, f"column {column}")


@pytest.mark.parametrize("turn", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_lateral_noise_does_not_look_out_of_the_image(turn: tuple[int, int]) -> None:
    """The wall is farther beyond each edge of the image than within it."""
    wall = f'<geom type="plane" size="0 0 1" zaxis="-1 {turn[0]} {turn[1]}" pos="2 0 0"/>'
    optics: dict[str, Any] = {"resolution": (4, 4), "fx": 8, "fy": 8, "cx": 2, "cy": 2}
    ideal = depth_of(wall, **optics)
    kinect = Stereo(baseline=-0.075, kinect_v1="nguyen")
    measured = np.array([depth_of(wall, seed, stereo=kinect, **optics) for seed in range(100)])
    noise = 0.05
    assert (measured > ideal.max() - noise).any()
    assert (measured < ideal.min() + noise).any()
    assert measured.max() < ideal.max() + noise
    assert measured.min() > ideal.min() - noise


@pytest.mark.parametrize("z", [0.703, 2.0, 4.118])
def test_disparity_model_has_barron_and_maliks_distribution(z: float) -> None:
    """z' = 35130 / k / 100, k = round(35130 / round(100 z) + N(0, 1/6) + 1/2)."""
    measured = kinect_depth(WALL.format(z), "disparity")
    mean = 35130 / round(100 * z) + 0.5
    k = 351.30 / measured
    np.testing.assert_allclose(k, np.rint(k), atol=2e-3 if z > 1 else 5e-3)
    edges = np.arange(np.rint(mean) - 1, np.rint(mean) + 2) - 0.5
    below = [0.0, *(NormalDist(mean, 1 / 6).cdf(edge) for edge in edges), 1.0]
    share, counts = np.diff(below), np.histogram(np.rint(k), [-np.inf, *edges, np.inf])[0]
    is_likely = share > 1e-4
    assert counts[~is_likely].sum() < 40
    assert_counts(counts[is_likely], share[is_likely] / share[is_likely].sum())


def test_a_floor_below_a_level_camera_is_measured() -> None:
    """Its normal is perpendicular to the camera's axis, but not to the rays."""
    floor = '<geom type="plane" size="0 0 1" pos="0 0 -0.35"/>'
    ideal, measured = depth_of(floor), kinect_depth(floor, "nguyen")
    near = np.isfinite(ideal) & (ideal < 2)
    sigma = np.abs(measured[near] - ideal[near]).mean()
    assert 0.001 < sigma < 0.05


def test_what_is_not_hit_stays_so() -> None:
    measured = kinect_depth('<geom size="0.1" pos="2 0 0"/>', "nguyen")
    assert 0.95 < (measured == np.inf).mean() < 1
    assert not np.isnan(measured).any()
