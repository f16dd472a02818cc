"""Peak rates of a device: bytes read from memory and from cache, float32 operations."""

from collections.abc import Iterator
from functools import partial

import warp as wp

from rigcast.bench.casters import Floats
from rigcast.bench.figure import Figure, Spread
from rigcast.bench.race import in_turns

STEP = wp.constant(1296096)
"""Stride between reads of a thread: larger than the number of threads, and irregular for the cache."""
CHAINS = 4
TIMES = 256

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def read(values: wp.array[float], times: int, sums: wp.array[float]) -> None:
    """Each thread reads next to its neighbours, at another place each time. The number of values is a power of two."""
    i = wp.tid()
    total = float(0.0)
    for k in range(times):
        total += values[(i + k * STEP) & (values.shape[0] - 1)]
    sums[i] = total


@wp.kernel
def compute(times: int, results: wp.array[float]) -> None:
    """Repeated multiply-adds in CHAINS independent chains."""
    x = 1.0e-3 * float(wp.tid() & 1023)
    a = x
    b = x + 1.0
    c = x + 2.0
    d = x + 3.0
    for _ in range(times):
        a = a * 0.5 + x
        b = b * 0.5 + x
        c = c * 0.5 + x
        d = d * 0.5 + x
    results[wp.tid()] = a + b + c + d


def limits(rounds: int, device: wp.Device) -> Iterator[Figure]:
    """Measure the peak rates: memory with more data than caches hold (2 GB on CUDA), cache with 16 MB."""
    threads = 1 << (20 if device.is_cuda else 10)
    sizes = {"memory": 1 << (29 if device.is_cuda else 26), "cache": 1 << (22 if device.is_cuda else 16)}
    out, settle = wp.empty(threads, dtype=float, device=device), partial(wp.synchronize_device, device)

    def seconds(kernel: wp.Kernel, *inputs: object) -> Floats:
        launch = partial(wp.launch, kernel, threads, inputs, [out], device=device)
        return in_turns({"": launch}, rounds, settle)[""][0]

    for key, size in sizes.items():
        values = wp.zeros(size, dtype=float, device=device)
        speed = 4 * threads * TIMES / seconds(read, values, TIMES) / 1e9
        yield Figure(key, f"read from {4 * size >> 10} KB, over and over", "GB/s", Spread.of(speed))
    speed = 2 * CHAINS * threads * TIMES / seconds(compute, TIMES) / 1e9
    yield Figure("operations", "products and sums of float32", "G/s", Spread.of(speed))
