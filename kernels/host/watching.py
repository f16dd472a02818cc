"""Detection of changes to arrays on the host that users may write to, by digests of their bytes.

A digest reads half as much as a comparison with a copy. It prefetches with a hint not to evict what casts need from the
cache (a field of 10 M triangles has 20 MB of heights).

Of every 128 bytes, each 32-bit number w is mixed into two of the digest's 64 numbers a: a' = b ^ (b >> s),
b = (a ^ w) m, m odd. With fewer numbers, a step would wait longer for the previous one than for memory. A step is
invertible, so a single changed number always changes the digest. Several changes that go into the same two numbers
would have to cancel in both: a probability of 2^-64.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.slices import TURN, OverTiles
from rigcast.kernels.launching.turns import turn_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PIECE = 2**15
"""Bytes per digest."""

digest64 = wp.types.vector(length=64, dtype=wp.uint32)


@wp.struct
class Watch:
    """Pieces of arrays (address, size [bytes]), their digests now and before, and a flag whether any differs."""

    address: wp.array[wp.uint64]
    size: wp.array[wp.int64]
    now: wp.array[digest64]
    before: wp.array[digest64]
    differ: wp.array[wp.bool]


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return false;
#else
    typedef unsigned words __attribute__((ext_vector_type(16)));
    const unsigned factor[2] = {0x9E3779B1u, 0x85EBCA77u};  // odd, of xxHash
    const int shift[2] = {15, 13};
    words own[4] = {1, 2, 3, 4};
    const char* bytes = (const char*)address;
    while (size > 0) {
        words w[2] = {0, 0};
        if (size >= (wp::int64)sizeof(w)) {
            __builtin_memcpy(w, bytes, sizeof(w));
            // not to stay in the cache
            __builtin_prefetch(bytes + 2048, 0, 0);
            __builtin_prefetch(bytes + 2112, 0, 0);
        } else {
            __builtin_memcpy(w, bytes, size);
        }
        for (int k = 0; k < 4; ++k) {
            own[k] = (own[k] ^ w[k / 2]) * factor[k % 2];
            own[k] ^= own[k] >> shift[k % 2];
        }
        bytes += sizeof(w);
        size -= sizeof(w);
    }
    __builtin_memcpy(wp::address(now, i), own, sizeof(own));
    return __builtin_memcmp(wp::address(before, i), own, sizeof(own)) != 0;
#endif
""")
def digest_differs(  # type: ignore[empty-body]
    address: wp.uint64, size: wp.int64, now: wp.array[digest64], before: wp.array[digest64], i: int
) -> bool:
    """Compute digest i of `size` bytes at an address; return whether it differs from the one before."""


@wp.kernel
def compare_pieces(_thread: int, turns: wp.array[int], watch: Watch) -> None:
    """Compare pieces, TURN per turn; each thread claims turns. turns: number claimed so far."""
    count = watch.address.shape[0]
    first = turn_of(turns) * TURN
    while first < count:
        for i in range(first, wp.min(first + TURN, count)):
            if digest_differs(watch.address[i], watch.size[i], watch.now, watch.before, i):
                watch.differ[0] = True
        first = turn_of(turns) * TURN


class Watched:
    """Contiguous arrays on the host, watched for changes."""

    def __init__(self, arrays: Sequence[npt.NDArray[Any]]) -> None:
        self._arrays = arrays  # keeps their memory alive
        starts = [np.arange(0, array.nbytes, PIECE) for array in arrays]
        address = [array.ctypes.data + start for array, start in zip(arrays, starts, strict=True)]
        size = [np.minimum(array.nbytes - start, PIECE) for array, start in zip(arrays, starts, strict=True)]
        watch = Watch()
        watch.address = wp.array(np.concatenate(address), dtype=wp.uint64, device="cpu")
        watch.size = wp.array(np.concatenate(size), dtype=wp.int64, device="cpu")
        watch.now, watch.before = (wp.zeros(watch.size.size, dtype=digest64, device="cpu") for _ in range(2))
        watch.differ = wp.zeros(1, dtype=wp.bool, device="cpu")
        self._now, self._before, self._differ = watch.now.numpy(), watch.before.numpy(), watch.differ.numpy()
        self._compare = OverTiles(compare_pieces, watch.size.size, lambda _: [watch])
        self.taken()

    def have_changed(self) -> bool:
        """Whether any array's bytes differ from those at construction, or at the last `taken`."""
        self._differ[0] = False
        self._compare()
        return bool(self._differ[0])

    def taken(self) -> None:
        """Compare with the present bytes from now on."""
        self._compare()
        self._before[...] = self._now
