"""Output of hits and readings by kernels."""

import warp as wp

from rigcast.kernels.vectors import to_double, to_float


@wp.struct
class Out:
    """HitArrays as a struct for kernels.

    is_read: whether to write readings: where the distance is below min_range [m] it becomes -inf, the shape -1 and the
    normal 0; normals are in the rays' frame.
    """

    distance: wp.array[float]
    shape: wp.array[int]
    face: wp.array[int]
    normal: wp.array[wp.vec3]
    is_read: bool
    min_range: float


@wp.struct
class Fields:
    """Arrays for the fields that a cast derives from its hits, one entry per ray; empty arrays are not written.

    points: ends of the rays [m] in their frame, NaN where the distance is not finite. depth: z coordinate of the end
    [m], +-inf or NaN where the distance is. body_id: body_of_shape[shape], -1 on a miss.
    """

    points: wp.array[wp.vec3]
    depth: wp.array[float]
    body_id: wp.array[int]
    body_of_shape: wp.array[int]


FIELD_NAMES = ("points", "depth", "body_id")
"""Names of the arrays of Fields that a cast writes."""


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
    out.distance.data[i] = distance;
    out.shape.data[i] = shape;
    out.face.data[i] = face;
    out.normal.data[i] = normal;
""")
def write(out: Out, i: int, distance: float, shape: int, face: int, normal: wp.vec3):  # type: ignore[no-untyped-def]
    """Write the hit of ray i. Native: Warp checks every index for < 0."""


@wp.func
def write_miss(out: Out, i: int, distance: float) -> None:
    write(out, i, distance, -1, -1, wp.vec3(0.0, 0.0, 0.0))


@wp.func
def write_place(out: Out, i: int, shape: int, distance: float, face: int, normal: wp.vec3, limit: float) -> None:
    """Write the hit of ray i, or a miss if it is beyond the limit [m]."""
    if distance <= limit and distance < wp.inf:
        write(out, i, distance, shape, face, normal)
    else:
        write_miss(out, i, wp.inf)


@wp.func
def read_hit(out: Out, i: int, rotation: wp.mat33d) -> None:
    """Turn the hit of ray i into a reading. rotation: its columns are the axes of the rays' frame in the world."""
    if out.distance[i] < out.min_range:
        out.distance[i] = -wp.inf
        out.shape[i] = -1
        out.normal[i] = wp.vec3(0.0, 0.0, 0.0)
    elif out.shape[i] >= 0:
        out.normal[i] = to_float(wp.transpose(rotation) * to_double(out.normal[i]))
