"""Conversion of users' direction vectors, of any length and precision, to float64 unit vectors."""

import warp as wp

from rigcast.kernels.launching.launch import launch
from rigcast.kernels.vectors import to_double

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const auto root = [](double x) { return ::sqrt(x); };
#else
    const auto root = [](double x) { return __builtin_elementwise_sqrt(x); };
#endif
    const double* from = vectors.data->c;
    double* __restrict__ to = unit.data->c;
    for (int k = 3 * begin; k < 3 * end; k += 3) {
        const double x = from[k], y = from[k + 1], z = from[k + 2];
        const double ax = x < 0.0 ? -x : x, ay = y < 0.0 ? -y : y, az = z < 0.0 ? -z : z;
        const double axy = ax > ay ? ax : ay;
        const double most = axy > az ? axy : az;
        const double sx = x / most, sy = y / most, sz = z / most;
        const double length = root(sx * sx + sy * sy + sz * sz);
        to[k] = sx / length;
        to[k + 1] = sy / length;
        to[k + 2] = sz / length;
    }
""")
def make_unit(begin: int, end: int, vectors: wp.array[wp.vec3d], unit: wp.array[wp.vec3d]):  # type: ignore[no-untyped-def]
    """Normalise vectors begin to end - 1 of contiguous arrays; NaN for vectors of length 0. LLVM vectorises the loop.

    The vectors are divided by their largest component first: the square of 1e-200 would vanish, that of 1e200 overflow.
    """


@wp.kernel
def widen(narrow: wp.array[wp.vec3], wide: wp.array[wp.vec3d]) -> None:
    i = wp.tid()
    wide[i] = to_double(narrow[i])


@wp.kernel
def normalize(vectors: wp.array[wp.vec3d], unit: wp.array[wp.vec3d]) -> None:
    i = wp.tid()
    make_unit(i, i + 1, vectors, unit)


def as_double(vectors: wp.array) -> wp.array:
    """The vectors (n,), vec3 or vec3d, as vec3d."""
    if vectors.dtype == wp.vec3d:
        return vectors
    wide = wp.empty(vectors.size, dtype=wp.vec3d, device=vectors.device)
    launch(widen, vectors.size, [vectors], [wide], vectors.device)
    return wide


def unit_directions(vectors: wp.array) -> wp.array:
    """Unit vectors (n,) vec3d of contiguous vectors (n,) vec3 or vec3d; NaN where the length is 0."""
    unit = wp.empty(vectors.size, dtype=wp.vec3d, device=vectors.device)
    launch(normalize, vectors.size, [as_double(vectors)], [unit], vectors.device)
    return unit
