"""Fast access to elements of contiguous arrays by an index >= 0. Warp's own indexing checks every index for a negative
one and multiplies it by the array's stride.
"""

import warp as wp


@wp.func_native("return ints.data[i];")
def int_at(ints: wp.array[int], i: int) -> int:  # type: ignore[empty-body]
    """ints[i]."""


@wp.func_native("return floats.data[i];")
def float_at(floats: wp.array[float], i: int) -> float:  # type: ignore[empty-body]
    """floats[i]."""


@wp.func_native("return bools.data[i];")
def bool_at(bools: wp.array[wp.bool], i: int) -> bool:  # type: ignore[empty-body]
    """bools[i]."""


@wp.func_native("return vectors.data[i].c[axis];")
def component_at(vectors: wp.array[wp.vec3], i: int, axis: int) -> float:  # type: ignore[empty-body]
    """vectors[i][axis]."""


@wp.func_native("return vectors.data[i].c[axis];")
def double_component_at(vectors: wp.array[wp.vec3d], i: int, axis: int) -> wp.float64:
    """vectors[i][axis]."""


@wp.func_native("return matrices.data[i].data[row][column];")
def entry_at(matrices: wp.array[wp.mat33d], i: int, row: int, column: int) -> wp.float64:
    """matrices[i][row, column]."""


@wp.func
def vector_at(vectors: wp.array[wp.vec3], i: int) -> wp.vec3:
    """vectors[i]."""
    return wp.vec3(component_at(vectors, i, 0), component_at(vectors, i, 1), component_at(vectors, i, 2))


@wp.func
def double_vector_at(vectors: wp.array[wp.vec3d], i: int) -> wp.vec3d:
    """vectors[i]."""
    return wp.vec3d(
        double_component_at(vectors, i, 0), double_component_at(vectors, i, 1), double_component_at(vectors, i, 2)
    )


@wp.func
def matrix_at(matrices: wp.array[wp.mat33d], i: int) -> wp.mat33d:
    """matrices[i]."""
    return wp.mat33d(
        entry_at(matrices, i, 0, 0),
        entry_at(matrices, i, 0, 1),
        entry_at(matrices, i, 0, 2),
        entry_at(matrices, i, 1, 0),
        entry_at(matrices, i, 1, 1),
        entry_at(matrices, i, 1, 2),
        entry_at(matrices, i, 2, 0),
        entry_at(matrices, i, 2, 1),
        entry_at(matrices, i, 2, 2),
    )
