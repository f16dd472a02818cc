"""No input of the kernels crashes the process, and good input beside bad gives correct hits."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from numpy.typing import ArrayLike

from rigcast.kernels.rays.unit import unit_directions
from rigcast.kernels.world.triangle_tree import build_triangle_tree

SQUARE = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
NAN, INF = np.nan, np.inf


def test_hostile_worlds_neither_crash_nor_hang() -> None:
    script = Path(__file__).with_name("helpers") / "hostile_worlds.py"
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", str(script)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.endswith("survived\n")


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE, [[0, 1, 2], [0, 2, 4]], "face 1: got vertex 4, expected 0 to 3"),
        (SQUARE, [[0, 1, -1]], "face 0: got vertex -1, expected 0 to 3"),
        (SQUARE, [[0, 1, 2**31]], "face 0: got vertex 2147483648, expected 0 to 3"),
        (np.zeros((0, 3)), [[0, 0, 0]], "face 0: got vertex 0, expected 0 to -1"),
        (
            [*SQUARE[:3], [0, NAN, 0]],
            [[0, 1, 2], [0, 2, 3]],
            r"face 1: vertex 3: got \[0.0, nan, 0.0\], expected finite",
        ),
        ([*SQUARE[:3], [0, 0, -INF]], [[3, 1, 2]], r"face 0: vertex 3: got \[0.0, 0.0, -inf\], expected finite"),
        ([*SQUARE[:3], [0, 0, 1e30]], [[3, 1, 2]], r"face 0: vertex 3: got .* finite numbers up to 1e\+18 m"),
    ],
)
def test_faces_that_cannot_be_are_refused(vertices: ArrayLike, faces: ArrayLike, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_triangle_tree(vertices, faces)


def test_a_bad_vertex_that_no_face_uses_does_not_matter() -> None:
    assert len(build_triangle_tree(np.array([*SQUARE, [NAN, INF, 1e30]]), [[0, 1, 2], [0, 2, 3]]).blocks) == 1


@pytest.mark.parametrize("length", [5e-324, 1e-300, 1e-20, 1e20, 1e300])
def test_directions_of_any_length_have_a_direction(length: float) -> None:
    vectors = wp.array([(length, 0, 0), (0, -length, length)], dtype=wp.vec3d, device="cpu")
    s = np.sqrt(0.5)
    np.testing.assert_allclose(unit_directions(vectors).numpy(), [(1, 0, 0), (0, -s, s)], rtol=1e-15)
