"""Boxes over which trees are built, also those for which the surface-area heuristic needs a deep stack."""

import numpy as np
from numpy.typing import NDArray

Boxes = tuple[NDArray[np.float32], NDArray[np.float32]]


def boxes_around(centers: NDArray[np.float64], half: NDArray[np.float64] | float) -> Boxes:
    return (centers - half).astype(np.float32), (centers + half).astype(np.float32)


def scattered(count: int, seed: int = 0) -> Boxes:
    rng = np.random.default_rng(seed)
    return boxes_around(rng.uniform(-5, 5, (count, 3)), rng.uniform(0, 0.5, (count, 3)))


def clustered(count: int, seed: int = 0) -> Boxes:
    """Small boxes in a few tight clusters, in random order."""
    rng = np.random.default_rng(seed)
    clusters = rng.uniform(-50, 50, (12, 3))
    return boxes_around(clusters[rng.integers(0, 12, count)] + rng.normal(size=(count, 3)), 0.05)


def flat_grid() -> Boxes:
    x, y = np.meshgrid(np.arange(20.0), np.arange(30.0))
    return boxes_around(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), np.array([0.5, 0.5, 0.0]))


def log_scaled(count: int) -> Boxes:
    """Points that crowd towards the origin: every split leaves most of them on one side."""
    return boxes_around(np.exp(np.random.default_rng(0).uniform(-30, 30, (count, 3))), 0.0)


def nested(count: int) -> Boxes:
    corner = np.exp(np.linspace(-80, 42, count))[:, None] * np.ones(3)
    return np.zeros((count, 3), np.float32), corner.astype(np.float32)


ADVERSARIAL = {
    "log-scaled points": log_scaled(5000),
    "boxes nested at a corner": nested(1000),
    "powers of two along the diagonal": boxes_around(2.0 ** (np.arange(4800) / 20 - 120)[:, None] * np.ones(3), 0.0),
}
PLAIN = {
    **{f"{n} scattered": scattered(n) for n in (1, 2, 7, 8, 9, 16, 17, 65, 1000)},
    "clustered": clustered(3000),
    "a flat grid": flat_grid(),
    "100 in one place": boxes_around(np.ones((100, 3)), 0.5),
    "100 points at the origin": boxes_around(np.zeros((100, 3)), 0.0),
    "along a line": boxes_around(np.linspace(0, 1, 300)[:, None] * [1, 0, 0], 0.001),
    "far from the origin": boxes_around(1e6 + np.random.default_rng(0).uniform(size=(500, 3)), 0.01),
}
ALL = {**PLAIN, **ADVERSARIAL}
