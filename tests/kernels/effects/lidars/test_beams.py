"""Beams: deflected by normally distributed angles, and spread over a Gaussian cross-section."""

import math

import numpy as np
import pytest
import warp as wp
from confidence import assert_normal, assert_uncorrelated
from numpy.typing import NDArray

from rigcast.kernels.effects.lidars.beams import aim, hexagonal_rings, repeated
from rigcast.kernels.effects.random import random_source
from rigcast.kernels.rays.arrays import Rays

COUNT = 100_000
SOURCE = random_source(7, "top", frame=3)


def vectors(values: NDArray[np.float64]) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=wp.vec3d, device="cpu")


def aimed(
    direction: tuple[float, float, float], spread: NDArray[np.float32], std: float, count: int = COUNT
) -> NDArray[np.float64]:
    rays = Rays(vectors(np.tile(direction, (count, 1))), vectors(np.zeros((1, 3))), None, None)
    return aim(rays, wp.array(spread, dtype=wp.vec2, device="cpu"), SOURCE, std).numpy()


def direction(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """The unit direction at these angles [deg]."""
    a, e = math.radians(azimuth), math.radians(elevation)
    return (math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e))


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (123, -15), (-60, 70), (0, 90)])
def test_angles_are_normal_about_both_axes(azimuth: float, elevation: float) -> None:
    d = np.array(direction(azimuth, elevation))
    h = np.array(direction(azimuth + 90, 0))
    got = aimed(tuple(d), np.zeros((1, 2), np.float32), std=0.01)
    np.testing.assert_allclose(np.linalg.norm(got, axis=-1), 1, atol=1e-12)
    sides = got @ np.stack([h, np.cross(d, h)], axis=-1)
    sine = np.linalg.norm(sides, axis=-1)
    across, up = (np.arctan2(sine, got @ d) / sine * sides.T)[:2]
    assert_normal(across, 0, 0.01, "across")
    assert_normal(up, 0, 0.01, "up")
    assert_uncorrelated(across, up)


def test_without_noise_or_spread_directions_stay_bit_for_bit() -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    rays = Rays(vectors(directions), vectors(np.zeros((1, 3))), None, None)
    got = aim(rays, wp.zeros(1, dtype=wp.vec2, device="cpu"), SOURCE, 0.0)
    np.testing.assert_array_equal(got.numpy(), directions)


def test_sub_rays_lie_across_and_up_from_their_beam() -> None:
    spread = np.array([[0, 0], [0.01, 0], [0, 0.02]], np.float32)
    got = aimed((1, 0, 0), spread, std=0.0, count=2).reshape(2, 3, 3)
    np.testing.assert_allclose(got[1, 1], [math.cos(0.01), math.sin(0.01), 0], atol=1e-9)
    np.testing.assert_allclose(got[1, 2], [math.cos(0.02), 0, math.sin(0.02)], atol=1e-9)


@pytest.mark.parametrize("rings", [1, 2, 3, 6])
def test_rings_fill_the_cross_section_with_weights_of_a_gaussian(rings: int) -> None:
    angles, weights = hexagonal_rings(rings, (0.004, 0.002))
    assert len(weights) == 1 + 3 * rings * (rings + 1)
    assert weights.sum() == pytest.approx(1, abs=1e-6)
    np.testing.assert_array_equal(angles[0], 0)
    np.testing.assert_allclose(weights @ angles, 0, atol=1e-9)
    scaled = angles / [0.002, 0.001]
    radius = np.hypot(*scaled.T)
    assert radius.max() == pytest.approx(rings / (rings + 0.5), abs=1e-6)
    np.testing.assert_allclose(weights / weights[0], np.exp(-2 * radius**2), atol=1e-6)


@pytest.mark.parametrize("edge", [-0.6, -0.3, 0.0, 0.2, 0.5])
def test_an_edge_across_the_beam_takes_the_share_of_the_gaussian_beyond_it(edge: float) -> None:
    """The exact share is that of exp(-2 r^2) over r < 1. 127 sub-rays give it to 0.04, about half a row of them."""
    angles, weights = hexagonal_rings(6, (2.0, 2.0))
    x, y = np.meshgrid(np.linspace(-1, 1, 1001), np.linspace(-1, 1, 1001))
    density = np.exp(-2 * (x**2 + y**2)) * (x**2 + y**2 < 1)
    exact = density[x > edge].sum() / density.sum()
    got = weights[angles[:, 0] > edge + 1e-6].sum() + 0.5 * weights[np.abs(angles[:, 0] - edge) <= 1e-6].sum()
    assert got == pytest.approx(exact, abs=0.04)


def test_origins_are_repeated_unless_there_is_one_for_all() -> None:
    origins = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(repeated(vectors(origins), 3).numpy(), np.repeat(origins, 3, axis=0))
    assert repeated(vectors(origins[:1]), 3).size == 1
