"""Vectors and matrices of many worlds, copied together from where each world has its own on the host."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.recorded import recorded

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def copy_rows(addresses: wp.array[wp.uint64], which: wp.array[int], out: wp.array2d[wp.vec3d]) -> None:
    """A row of `out` of each world; of one thing, which[world], where `which` is not empty."""
    world = wp.tid()
    count = out.shape[1]
    first = int(0)
    if which.shape[0] > 0:
        first = which[world % which.shape[0]] * count
    row = wp.array(ptr=addresses[world], shape=(first + count,), dtype=wp.vec3d)
    for k in range(count):
        out[world, k] = row[first + k]


class Gathered:
    """What is copied together, again and again: `values`, (n, m, 3) or (n, m, 3, 3) of n worlds."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.values = np.empty(shape)
        self._vectors = wp.array(self.values.reshape(shape[0], -1, 3), dtype=wp.vec3d, device="cpu", copy=False)
        self._from: tuple[wp.array | None, npt.NDArray[np.int32] | None] = (None, None)

    def take(self, addresses: wp.array, which: npt.NDArray[np.int32] | None) -> None:
        """Copy what is at these addresses, (n,) uint64 on the host.

        which: of each world (n,), or of all (1,), the thing that is copied, where m is 1; None for all things.
        """
        if addresses is not self._from[0] or which is not self._from[1]:
            things = wp.array([] if which is None else which, dtype=int, device="cpu")
            self._copy = recorded(copy_rows, len(self.values), [addresses, things], [self._vectors], "cpu")
            self._from = addresses, which
        self._copy()
