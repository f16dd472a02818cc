"""Hits on their way out of a kernel."""

import warp as wp

from rigcast.kernels.vectors import to_double, to_float


@wp.struct
class Out:
    """HitArrays, where a kernel writes.

    is_read: whether they are readings: what is nearer than min_range [m] is -inf, normals are in the rays' frame.
    """

    distance: wp.array[float]
    shape: wp.array[int]
    face: wp.array[int]
    normal: wp.array[wp.vec3]
    is_read: bool
    min_range: float


@wp.struct
class Fields:
    """Where a cast writes what follows from its hits, one entry per ray; an array that is empty is not written.

    points: where rays end [m], in their frame; NaN where the distance is not finite. depth: along the frame's z [m];
    +-inf and NaN where the distance is. body_id: that of the shape in body_of_shape, -1 where nothing is hit.
    """

    points: wp.array[wp.vec3]
    depth: wp.array[float]
    body_id: wp.array[int]
    body_of_shape: wp.array[int]


FIELD_NAMES = ("points", "depth", "body_id")
"""Of the arrays that a cast writes."""


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
    out.distance.data[i] = distance;
    out.shape.data[i] = shape;
    out.face.data[i] = face;
    out.normal.data[i] = normal;
""")
def write(out: Out, i: int, distance: float, shape: int, face: int, normal: wp.vec3):  # type: ignore[no-untyped-def]
    """Native: Warp asks of every index where it begins to count."""


@wp.func
def write_miss(out: Out, i: int, distance: float) -> None:
    write(out, i, distance, -1, -1, wp.vec3(0.0, 0.0, 0.0))


@wp.func
def write_place(out: Out, i: int, shape: int, distance: float, face: int, normal: wp.vec3, limit: float) -> None:
    """Write where ray i hits: nothing if that is beyond the limit."""
    if distance <= limit and distance < wp.inf:
        write(out, i, distance, shape, face, normal)
    else:
        write_miss(out, i, wp.inf)


@wp.func
def read_hit(out: Out, i: int, rotation: wp.mat33d) -> None:
    """Turn what ray i hits into what it reads, in a frame whose axes are the columns of the rotation."""
    if out.distance[i] < out.min_range:
        out.distance[i] = -wp.inf
        out.shape[i] = -1
        out.normal[i] = wp.vec3(0.0, 0.0, 0.0)
    elif out.shape[i] >= 0:
        out.normal[i] = to_float(wp.transpose(rotation) * to_double(out.normal[i]))
