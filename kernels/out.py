"""Hits on their way out of a kernel."""

import warp as wp


@wp.struct
class Out:
    """HitArrays, where a kernel writes."""

    distance: wp.array[float]
    shape: wp.array[int]
    face: wp.array[int]
    normal: wp.array[wp.vec3]


@wp.func
def write_miss(out: Out, i: int, distance: float) -> None:
    out.distance[i] = distance
    out.shape[i] = -1
    out.face[i] = -1
    out.normal[i] = wp.vec3(0.0, 0.0, 0.0)


@wp.func
def write_place(out: Out, i: int, shape: int, distance: float, face: int, normal: wp.vec3, limit: float) -> None:
    """Write where ray i hits: nothing if that is beyond the limit."""
    if distance <= limit and distance < wp.inf:
        out.distance[i] = distance
        out.shape[i] = shape
        out.face[i] = face
        out.normal[i] = normal
    else:
        write_miss(out, i, wp.inf)
