"""Functions of rigcast.kernels applied to rows of numpy arrays; a single row is repeated.

All these test kernels are in one Warp module, which compiles once.
"""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type"

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.kernels.shapes.solid_normals import closed_form_normal
from rigcast.kernels.shapes.solids import decide_closed_form, triage_closed_form
from rigcast.kernels.shapes.triangle import (
    CULL_NONE,
    decide_triangle,
    intersect_triangle_reference,
    is_inside_triangle,
    plane_distance,
    triage_triangle,
    triangle_normal,
)
from rigcast.kernels.vectors import to_double

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float32]
UNDECIDED = -1.0


@wp.kernel
def _normal(v0: wp.array[wp.vec3], v1: wp.array[wp.vec3], v2: wp.array[wp.vec3], out: wp.array[wp.vec3]) -> None:
    i = wp.tid()
    out[i] = triangle_normal(v0[i], v1[i], v2[i])


@wp.kernel
def _plane_distance(
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    v0: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    parallel: float,
    out: wp.array[float],
) -> None:
    i = wp.tid()
    out[i] = plane_distance(origin[i], direction[i], v0[i], normal[i], parallel)


@wp.kernel
def _is_inside(
    p: wp.array[wp.vec3],
    v0: wp.array[wp.vec3],
    v1: wp.array[wp.vec3],
    v2: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    out: wp.array[wp.bool],
) -> None:
    i = wp.tid()
    out[i] = is_inside_triangle(p[i], v0[i], v1[i], v2[i], normal[i])


@wp.kernel
def _reference(
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    v0: wp.array[wp.vec3],
    v1: wp.array[wp.vec3],
    v2: wp.array[wp.vec3],
    cull: int,
    parallel: float,
    out: wp.array[float],
) -> None:
    i = wp.tid()
    out[i] = intersect_triangle_reference(origin[i], direction[i], v0[i], v1[i], v2[i], cull, parallel)


@wp.kernel
def _triage(
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    v0: wp.array[wp.vec3],
    v1: wp.array[wp.vec3],
    v2: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    cull: int,
    out: wp.array[wp.vec2],
) -> None:
    i = wp.tid()
    a = v0[i]
    b = v1[i]
    c = v2[i]
    o = origin[i]
    found = triage_triangle(direction[i], a - b, b - c, c - a, a - o, b - o, c - o, normal[i], cull)
    out[i] = wp.vec2(found[0], found[1])


@wp.kernel
def _decide(
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    v0: wp.array[wp.vec3],
    v1: wp.array[wp.vec3],
    v2: wp.array[wp.vec3],
    cull: int,
    out: wp.array[wp.float64],
) -> None:
    i = wp.tid()
    o = to_double(origin[i])
    out[i] = decide_triangle(
        to_double(direction[i]), to_double(v0[i]) - o, to_double(v1[i]) - o, to_double(v2[i]) - o, cull
    )


@wp.kernel
def _closed_form(
    size: wp.array[wp.vec3],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    kind: int,
    cull: int,
    out: wp.array[wp.vec3d],
) -> None:
    i = wp.tid()
    t = decide_closed_form(kind, size[i], to_double(origin[i]), to_double(direction[i]), cull)
    span = triage_closed_form(kind, size[i], origin[i], direction[i], cull)
    out[i] = wp.vec3d(t, wp.float64(span[0]), wp.float64(span[1]))


@wp.kernel
def _closed_form_normal(
    size: wp.array[wp.vec3],
    point: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    kind: int,
    distance: float,
    out: wp.array[wp.vec3],
) -> None:
    i = wp.tid()
    out[i] = closed_form_normal(kind, size[i], point[i], direction[i], distance)


def _over_rows(kernel: wp.Kernel, dtype: Any, vectors: Sequence[ArrayLike], scalars: Sequence[float] = ()) -> Any:
    columns = np.broadcast_arrays(*(np.atleast_2d(np.asarray(v, np.float32)) for v in vectors))
    rows = len(columns[0])
    out = wp.empty(rows, dtype=dtype, device="cpu")
    arrays = [wp.array(np.ascontiguousarray(c), dtype=wp.vec3, device="cpu") for c in columns]
    wp.launch(kernel, rows, inputs=[*arrays, *scalars], outputs=[out], device="cpu")
    return out.numpy()


def normal(v0: ArrayLike, v1: ArrayLike, v2: ArrayLike) -> Floats:
    return _over_rows(_normal, wp.vec3, [v0, v1, v2])


def distance_to_plane(
    origin: ArrayLike, direction: ArrayLike, v0: ArrayLike, unit_normal: ArrayLike, parallel: float = 0.0
) -> Floats:
    return _over_rows(_plane_distance, wp.float32, [origin, direction, v0, unit_normal], [parallel])


def is_inside(p: ArrayLike, v0: ArrayLike, v1: ArrayLike, v2: ArrayLike, unit_normal: ArrayLike) -> NDArray[np.bool_]:
    return _over_rows(_is_inside, wp.bool, [p, v0, v1, v2, unit_normal])


def reference(
    origin: ArrayLike,
    direction: ArrayLike,
    v0: ArrayLike,
    v1: ArrayLike,
    v2: ArrayLike,
    cull: int = CULL_NONE,
    parallel: float = 0.0,
) -> Floats:
    return _over_rows(_reference, wp.float32, [origin, direction, v0, v1, v2], [cull, parallel])


def span(
    origin: ArrayLike, direction: ArrayLike, v0: ArrayLike, v1: ArrayLike, v2: ArrayLike, cull: int = CULL_NONE
) -> Floats:
    """Interval (n, 2) of the distance from triage_triangle, in float32, with the normal that a triangle block has."""
    a, b, c = (np.asarray(v, np.float32).astype(np.float64) for v in (v0, v1, v2))
    n = np.cross(b - a, c - a)
    with np.errstate(invalid="ignore"):
        unit_normal = n / np.linalg.norm(n, axis=-1, keepdims=True)
    return _over_rows(_triage, wp.vec2, [origin, direction, v0, v1, v2, unit_normal], [cull])


def triage(
    origin: ArrayLike, direction: ArrayLike, v0: ArrayLike, v1: ArrayLike, v2: ArrayLike, cull: int = CULL_NONE
) -> NDArray[np.float64]:
    """The middle of triage_triangle's interval, +inf on a miss, or UNDECIDED."""
    near, far = span(origin, direction, v0, v1, v2, cull).T.astype(np.float64)
    return np.where(np.isfinite(far), 0.5 * (near + far), np.where(np.isfinite(near), UNDECIDED, np.inf))


def decide(
    origin: ArrayLike, direction: ArrayLike, v0: ArrayLike, v1: ArrayLike, v2: ArrayLike, cull: int = CULL_NONE
) -> NDArray[np.float64]:
    """The distance from decide_triangle, in float64; +inf on a miss."""
    return _over_rows(_decide, wp.float64, [origin, direction, v0, v1, v2], [cull])


def intersect(
    origin: ArrayLike, direction: ArrayLike, v0: ArrayLike, v1: ArrayLike, v2: ArrayLike, cull: int = CULL_NONE
) -> NDArray[np.float64]:
    """The distance from `triage`, or from `decide` where that is undecided, as in the cast; +inf on a miss."""
    first = triage(origin, direction, v0, v1, v2, cull)
    return np.where(first == UNDECIDED, decide(origin, direction, v0, v1, v2, cull), first)


def closed_form_looks(
    kind: int, size: ArrayLike, origin: ArrayLike, direction: ArrayLike, cull: int = CULL_NONE
) -> NDArray[np.float64]:
    """(n, 3) distance from decide_closed_form, and interval from triage_closed_form."""
    return _over_rows(_closed_form, wp.vec3d, [size, origin, direction], [kind, cull])


def closed_form(kind: int, size: ArrayLike, origin: ArrayLike, direction: ArrayLike, cull: int = CULL_NONE) -> Floats:
    """The distance from decide_closed_form, rounded to float32; +inf on a miss."""
    return closed_form_looks(kind, size, origin, direction, cull)[:, 0].astype(np.float32)


def normal_at(kind: int, size: ArrayLike, point: ArrayLike, direction: ArrayLike, distance: float = 1.0) -> Floats:
    return _over_rows(_closed_form_normal, wp.vec3, [size, point, direction], [kind, distance])
