"""Gathering of vectors and matrices of many worlds, each in its own memory on the host, into one array."""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.recorded import recorded

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def copy_rows(addresses: wp.array[wp.uint64], which: wp.array[int], out: wp.array2d[wp.vec3d]) -> None:
    """Copy a row of `out` per world: its first entries, or entry which[world] if `which` is not empty."""
    world = wp.tid()
    count = out.shape[1]
    first = int(0)
    if which.shape[0] > 0:
        first = which[world % which.shape[0]] * count
    row = wp.array(ptr=addresses[world], shape=(first + count,), dtype=wp.vec3d)
    for k in range(count):
        out[world, k] = row[first + k]


class Gathered:
    """A repeatable copy into `values`, (n, m, 3) or (n, m, 3, 3), of m entries of each of n worlds."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.values = np.empty(shape)
        self._vectors = wp.array(self.values.reshape(shape[0], -1, 3), dtype=wp.vec3d, device="cpu", copy=False)
        self._from: tuple[wp.array | None, npt.NDArray[np.int32] | None] = (None, None)

    def take(self, addresses: wp.array, which: npt.NDArray[np.int32] | None) -> None:
        """Copy from these addresses, (n,) uint64, one per world, on the host.

        which: index of the entry to copy in each world (n,), or in all (1,), if m is 1; None to copy the first m.
        """
        if addresses is not self._from[0] or which is not self._from[1]:
            things = wp.array([] if which is None else which, dtype=int, device="cpu")
            self._copy = recorded(copy_rows, len(self.values), [addresses, things], [self._vectors], "cpu")
            self._from = addresses, which
        self._copy()
