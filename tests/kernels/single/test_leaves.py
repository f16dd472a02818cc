"""Triangles of a block that a ray may pass inside: all that it does, and hardly any that it passes outside; none near
whose edge or outside which it passes counts as surely passed inside."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type,index"

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.single.leaves import passed_in_block
from rigcast.kernels.single.ray import box_margin
from rigcast.kernels.trees.nodes import WIDTH, struct_zeros

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

Doubles = NDArray[np.float64]
BLOCKS = 4000
TIGHT = 1e-4  # of the largest coordinate: more than 16u (|P| + |O|) where corners are farther away than an edge is long


@wp.kernel
def pass_blocks(
    blocks: wp.array[TriangleBlock],
    origins: wp.array[wp.vec3d],
    directions: wp.array[wp.vec3],
    reach: float,
    passed: wp.array[int],
) -> None:
    """Test ray i against block i."""
    i = wp.tid()
    origin = wp.vec3(origins[i])
    rest = wp.vec3(origins[i] - wp.vec3d(origin))
    passed[i] = passed_in_block(blocks, i, origin, rest, directions[i], box_margin(origin, reach))


def looked_at(corners: Doubles, origins: Doubles, directions: Doubles) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(n, 8) each: which triangles (n, 8, 3, 3), a block per ray, rays (n, 3) may pass inside, and surely do."""
    blocks = struct_zeros(TriangleBlock, len(corners))
    for vertex in range(3):
        for axis, name in enumerate("xyz"):
            blocks[f"{name}{vertex}"] = corners[:, :, vertex, axis]
    arrays = (
        wp.array(a, dtype=dtype, device="cpu")
        for a, dtype in ((blocks, TriangleBlock), (origins, wp.vec3d), (directions.astype(np.float32), wp.vec3))
    )
    passed = wp.zeros(len(corners), dtype=int, device="cpu")
    reach = float(np.nanmax(np.abs(corners)))
    wp.launch(pass_blocks, len(corners), [*arrays, reach, passed], device="cpu")
    bits = (passed.numpy()[:, None] >> np.arange(2 * int(WIDTH)) & 1).astype(bool)
    return bits[:, :WIDTH], bits[:, WIDTH:]


def random_blocks(rng: np.random.Generator, away: float) -> tuple[Doubles, Doubles]:
    """Triangles (n, 8, 3, 3) with float32 coordinates, and origins (n, 3)."""
    size = 10.0 ** rng.uniform(-3, 1, (BLOCKS, 1, 1, 1))
    center = rng.uniform(-away, away, (BLOCKS, 1, 1, 3))
    corners = (center + size * rng.normal(size=(BLOCKS, int(WIDTH), 3, 3))).astype(np.float32).astype(float)
    return corners, rng.uniform(-away, away, (BLOCKS, 3))


def aimed(rng: np.random.Generator, corners: Doubles, origins: Doubles, weights: Doubles) -> Doubles:
    """Directions (n, 3), of float32, at a point of the first triangle of each block, with these barycentric weights."""
    towards = np.einsum("nc,nca->na", rng.permuted(weights, axis=1), corners[:, 0]) - origins
    return (towards / np.linalg.norm(towards, axis=1, keepdims=True)).astype(np.float32).astype(float)


def distances(corners: Doubles, origins: Doubles, directions: Doubles) -> Doubles:
    """(n, 8) approximate distance [m] by which a ray passes outside the farthest edge of each triangle; < 0 inside."""
    a = corners - origins[:, None, None]
    b = np.roll(a, -1, axis=2)
    sides = np.einsum("na,ntea->nte", directions, np.cross(a, b)) / np.linalg.norm(a - b, axis=-1)
    return np.minimum(sides.max(axis=2), -sides.min(axis=2))


AIMS = {"at faces": (1.0, 1.0, 1.0), "at edges": (1.0, 1.0, 0.0), "at vertices": (1.0, 0.0, 0.0)}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("away", [1.0, 100.0, 1e5])
@pytest.mark.parametrize("aim", AIMS)
def test_what_a_ray_is_aimed_at_is_kept(seed: int, away: float, aim: str) -> None:
    rng = np.random.default_rng(seed)
    corners, origins = random_blocks(rng, away)
    weights = rng.dirichlet((1.0, 1.0, 1.0), BLOCKS) * AIMS[aim]
    directions = aimed(rng, corners, origins, weights / weights.sum(axis=1, keepdims=True))
    is_kept, is_sure = (a[:, 0] for a in looked_at(corners, origins, directions))
    assert is_kept.all(), f"seed {seed}: block {np.flatnonzero(~is_kept)[:1]} leaves out the triangle that was aimed at"
    if aim != "at faces":
        assert not is_sure.any(), f"seed {seed}: block {np.flatnonzero(is_sure)[:1]} is sure of a triangle at its edge"


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("away", [1.0, 100.0])
def test_what_is_passed_inside_is_kept_and_what_is_passed_well_outside_is_not(seed: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    corners, origins = random_blocks(rng, away)
    directions = aimed(rng, corners, origins, rng.dirichlet((1.0, 1.0, 1.0), BLOCKS))
    is_kept, is_sure = looked_at(corners, origins, directions)
    outside = distances(corners, origins, directions)
    lost, spare = (outside <= 0) & ~is_kept, (outside > TIGHT * np.abs(corners).max()) & is_kept
    assert not lost.any(), f"seed {seed}: {np.argwhere(lost)[:3]} are passed inside and left out"
    assert not spare.any(), f"seed {seed}: {np.argwhere(spare)[:3]} are passed {outside[spare][:3]} m outside and kept"
    wrong = is_sure & (outside >= 0)
    assert not wrong.any(), f"seed {seed}: {np.argwhere(wrong)[:3]} are surely passed inside, and are not"
    assert 2 * is_sure.sum() > (outside < 0).sum(), "most that are passed inside are surely so"


def test_what_is_not_there_is_never_passed() -> None:
    rng = np.random.default_rng(0)
    corners, origins = random_blocks(rng, 1.0)
    corners[:, 1::2] = np.nan
    for passed in looked_at(corners, origins, aimed(rng, corners, origins, np.ones((BLOCKS, 3)) / 3)):
        assert not passed[:, 1::2].any()
