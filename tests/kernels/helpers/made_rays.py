"""Rays of patterns of every kind, and of sensors with them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from made_worlds import Doubles, rays_of, unit

from rigcast.kernels.packing.bundling import sort_into_bundles
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.kernels.rays.arrays import Rays

DOWN = np.array([0.0, 0.0, -1.0])
START = np.array([0.1, -0.2, 0.3])


def lidar(beams: int, columns: int, elevation_deg: float = 25.0) -> Doubles:
    azimuth = np.arange(columns) * 2 * np.pi / columns
    elevation = np.radians(np.linspace(-elevation_deg, elevation_deg, beams))[:, None]
    xyz = (np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation))
    return np.stack(np.broadcast_arrays(*xyz), axis=-1).reshape(-1, 3)


def camera(width: int, height: int, half_angle_deg: float = 30.0) -> Doubles:
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    scale = np.tan(np.radians(half_angle_deg))
    return unit(np.stack([np.ones_like(x), scale * x, scale * y], axis=-1).reshape(-1, 3))


def sphere(count: int, seed: int = 0) -> Doubles:
    return unit(np.random.default_rng(seed).normal(size=(count, 3)))


def axes(count: int) -> Doubles:
    """Rays along axes, and within 1e-7 of them."""
    rng = np.random.default_rng(0)
    return unit(np.vstack([np.eye(3), -np.eye(3)])[rng.integers(0, 6, count)] + rng.choice([0, 1e-7], (count, 3)))


def raster(columns: int, rows: int, spacing: float, height: float = 0.0) -> Doubles:
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    return np.stack([spacing * x, spacing * y, np.full_like(x, height)], axis=-1).reshape(-1, 3)


PATTERNS: dict[str, Doubles] = {
    "64 beams": lidar(64, 128),
    "16 beams, far apart": lidar(16, 100, 15.0),
    "rows far apart": lidar(16, 600, 15.0),
    "rows that end within a run": lidar(9, 500, 8.0),
    "up to the poles": lidar(30, 60, 90.0),
    "one ring": lidar(1, 360, 0.0),
    "camera": camera(64, 48),
    "wide camera": camera(40, 30, 80.0),
    "camera of odd size": camera(37, 23),
    "all around": sphere(3000),
    "along axes": axes(1000),
    "few": sphere(5),
    "one": sphere(1),
    "none": np.empty((0, 3)),
}


def packed(directions: Doubles) -> Rays:
    return replace(rays_of(START, directions), packets=sort_into_packets(directions))


def bundled() -> Rays:
    origins = raster(30, 20, 0.1)
    bundles = sort_into_bundles(origins, np.zeros(len(origins), np.int32))
    return replace(rays_of(origins, DOWN), packets=bundles)


RAYS: dict[str, Callable[[], Rays]] = {
    "packets of rows": lambda: packed(PATTERNS["rows far apart"]),
    "packets of squares": lambda: packed(PATTERNS["camera of odd size"]),
    "packets without rows": lambda: packed(PATTERNS["all around"]),
    "bundles": bundled,
    "alone": lambda: rays_of(START, PATTERNS["all around"]),
}
