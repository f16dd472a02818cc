"""Checks of the arrays that users give for many worlds."""

from collections.abc import Sequence
from typing import Any, TypeGuard

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from rigcast.sensors.errors import InputError


def numbers(name: str, given: ArrayLike | wp.array, dtype: type) -> NDArray[Any]:
    """The array on the host with this dtype; raises InputError if it is not an array of such numbers."""
    if isinstance(given, wp.array):
        return given.numpy().astype(dtype)
    try:
        values = np.asarray(given)
    except (TypeError, ValueError) as error:  # TypeError: a tensor of torch on a GPU
        raise InputError(f"Worlds: {name}: expected an array of numbers: {error}") from None
    if not np.can_cast(values.dtype, dtype, casting="same_kind"):
        raise InputError(f"Worlds: {name}: got an array of {values.dtype}, expected {np.dtype(dtype)}")
    return values.astype(dtype, copy=False)


def poses(name: str, given: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """The array with this shape, in float32 if it is float32, else in float64; matrices may be flat."""
    values = given if is_float32(given) else numbers(name, given, np.float64)
    if values.shape != shape and values.shape != (*shape[:2], int(np.prod(shape[2:]))):
        raise InputError(f"Worlds: {name}: got shape {values.shape}, expected {shape}")
    return values.reshape(shape)


def is_float32(given: object) -> TypeGuard[NDArray[np.float32]]:
    """Whether this is a float32 array on the host."""
    return isinstance(given, np.ndarray) and given.dtype == np.float32


def require_array(
    name: str, array: wp.array, shape: tuple[int, ...], dtypes: Sequence[type], device: wp.Device
) -> None:
    """Raise InputError for an array of another shape or dtype, or on another device."""
    if array.dtype not in dtypes or tuple(array.shape) != shape:
        got = f"{tuple(array.shape)} of {array.dtype.__name__}"
        expected = f"{shape} of {' or '.join(dtype.__name__ for dtype in dtypes)}"
        raise InputError(f"Worlds: {name}: got an array {got}, expected {expected}")
    if array.device != device:
        raise InputError(f"Worlds: {name}: got an array on {array.device}, expected {device}")


def require_no_gaps(name: str, array: wp.array) -> None:
    """Raise InputError for an array that is not contiguous."""
    if not array.is_contiguous:
        raise InputError(f"Worlds: {name}: got an array with gaps, expected one without, as its contiguous() is")
