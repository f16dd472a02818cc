"""Directions of any length and precision, as rays have them."""

import warp as wp

from .launch import launch_over_runs
from .vectors import to_double

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

RUNS_PER_SLICE = 16
"""A run takes as long as it takes to read eight times as many rays."""


@wp.kernel
def widen(narrow: wp.array[wp.vec3], wide: wp.array[wp.vec3d]) -> None:
    i = wp.tid()
    wide[i] = to_double(narrow[i])


@wp.kernel
def normalize(first: int, run: int, vectors: wp.array[wp.vec3d], unit: wp.array[wp.vec3d]) -> None:
    begin = (first + wp.tid()) * run
    for i in range(begin, wp.min(begin + run, vectors.shape[0])):
        # scaled by the largest component first: squares of 1e-200 would vanish, those of 1e200 overflow
        scaled = vectors[i] / wp.max(wp.abs(vectors[i]))
        unit[i] = scaled / wp.length(scaled)


def as_double(vectors: wp.array) -> wp.array:
    """(n,) vec3d of (n,) vec3 or vec3d."""
    if vectors.dtype == wp.vec3d:
        return vectors
    wide = wp.empty(vectors.size, dtype=wp.vec3d, device=vectors.device)
    wp.launch(widen, vectors.size, inputs=[vectors], outputs=[wide], device=vectors.device)
    return wide


def unit_directions(vectors: wp.array) -> wp.array:
    """(n,) vec3d of length 1, NaN where (n,) vec3 or vec3d vectors have none."""
    unit = wp.empty(vectors.size, dtype=wp.vec3d, device=vectors.device)
    launch_over_runs(normalize, vectors.size, [as_double(vectors)], [unit], vectors.device, RUNS_PER_SLICE)
    return unit
