"""Small functions on vectors that all kernels share."""

import warp as wp

from .elements import double_vector_at

Interval = wp.types.vector(length=5, dtype=wp.float32)
"""Interval [near, far] of a distance [m] in the first two entries; the rest is padding. LLVM returns up to four floats
in a vector register, and does not vectorise loops over rays or triangles that call such functions."""


@wp.func
def to_float(a: wp.vec3d) -> wp.vec3:
    return wp.vec3(float(a[0]), float(a[1]), float(a[2]))


@wp.func
def to_double(a: wp.vec3) -> wp.vec3d:
    return wp.vec3d(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]))


@wp.func
def modulo(k: int, size: int) -> int:
    """The remainder k % size, without a division where none is needed."""
    if k < size:
        return k
    if size == 1:
        return 0
    return k % size


@wp.func
def of_ray(vectors: wp.array[wp.vec3d], i: int) -> wp.vec3d:
    """The vector of ray i, counted over all worlds. The array has one entry, one per ray of a world, or one per ray."""
    return double_vector_at(vectors, modulo(i, vectors.shape[0]))


@wp.func
def norm1(a: wp.vec3) -> float:
    return wp.abs(a[0]) + wp.abs(a[1]) + wp.abs(a[2])


@wp.func
def larger(a: float, b: float) -> float:
    """The larger of two; b if either is NaN. wp.max propagates NaN, and LLVM does not vectorise loops with it."""
    return wp.where(a > b, a, b)


@wp.func
def smaller(a: float, b: float) -> float:
    return wp.where(a < b, a, b)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float inverse = __fdividef(1.0f, y), q = x * inverse;
    return ::fmaf(::fmaf(-q, y, x), inverse, q);
#else
    return x / y;
#endif
""")
def quotient(x: float, y: float) -> float:  # type: ignore[empty-body]
    """The quotient x / y with a relative error of at most u = eps / 2. On CUDA it may be NaN for numbers near the ends
    of float32's range, whose special handling is left out."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffs(mask) - 1;
#else
    return __builtin_ctz(mask);
#endif
""")
def lowest_bit(mask: int) -> int:  # type: ignore[empty-body]
    """Index of the lowest set bit; at least one must be set."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(mask);
#else
    return __builtin_popcount(mask);
#endif
""")
def count_bits(mask: int) -> int:  # type: ignore[empty-body]
    """Number of set bits."""


@wp.func
def interval(low: float, high: float) -> Interval:
    made = Interval()
    made[0] = low
    made[1] = high
    return made
