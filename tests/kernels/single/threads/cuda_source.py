"""The source that Warp generates for CUDA, compiled for the CPU, so that it runs where there is no GPU.

Blocks run one after the other, all threads of a block at the same time, and these wait for each other at barriers. This
tests the source, but not NVIDIA's compiler, separate device memory, or concurrent blocks. Products and sums are not
fused, as with the options given to NVIDIA's compiler.
"""

import ctypes
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from warp._src import build
from warp._src.types import launch_bounds_t

# Warp's own functions as on the CPU, ours with their branches for CUDA
_BEFORE = """
#include <algorithm>
#include <barrier>
#include <cmath>
#include <cstring>
#include <thread>
#include <utility>
#include <vector>
#define __CUDA_ARCH__ CUDA_ARCH
#define __global__
#define __launch_bounds__(...)
#define __ffs __builtin_ffs
#define __fdividef(x, y) ((x) / (y))
#define __ldg(address) (*(address))
#define __shared__ static
using std::max, std::min;
int __float_as_int(float x) { int bits; std::memcpy(&bits, &x, sizeof(bits)); return bits; }
float rsqrtf(float x) { return 1 / std::sqrt(x); }
int atomicAdd(int* sum, int value) { return __atomic_fetch_add(sum, value, __ATOMIC_SEQ_CST); }
struct int4 { int x, y, z, w; };
struct Indices { unsigned x, y, z; };
Indices blockIdx, gridDim = {1, 1, 1};
const Indices blockDim = {BLOCK_DIM, 1, 1};
thread_local Indices threadIdx;
const int warpSize = 32;
struct Warp { std::barrier<> all{warpSize}; unsigned values[warpSize]; } warps[BLOCK_DIM / warpSize];
std::barrier<> block(BLOCK_DIM);
void __syncthreads() { block.arrive_and_wait(); }
// What a function makes of the values that the threads of a warp have, which wait for each other.
template <class Function>
auto of_warp(unsigned value, Function function)
{
    Warp& warp = warps[threadIdx.x / warpSize];
    warp.values[threadIdx.x % warpSize] = value;
    warp.all.arrive_and_wait();
    const auto result = function(warp.values);
    warp.all.arrive_and_wait();
    return result;
}
int __shfl_sync(unsigned, int value, int lane)
{
    return of_warp(value, [=](const unsigned* values) { return int(values[lane]); });
}
unsigned __shfl_xor_sync(unsigned, unsigned value, int lanes)
{
    const int lane = threadIdx.x % warpSize ^ lanes;
    return of_warp(value, [=](const unsigned* values) { return values[lane]; });
}
unsigned __reduce_min_sync(unsigned, unsigned value)
{
    return of_warp(value, [](const unsigned* values) { return *std::min_element(values, values + warpSize); });
}
int __popc(unsigned x) { return __builtin_popcount(x); }
unsigned __ballot_sync(unsigned, bool value)
{
    return of_warp(value, [](const unsigned* values) {
        unsigned bits = 0;
        for (int i = 0; i < warpSize; ++i) bits |= values[i] << i;
        return bits;
    });
}
bool __any_sync(unsigned, bool value)
{
    return of_warp(value, [](const unsigned* values) { return std::count(values, values + warpSize, 1) > 0; });
}
bool __all_sync(unsigned, bool value)
{
    return of_warp(value, [](const unsigned* values) { return std::count(values, values + warpSize, 1) == warpSize; });
}
extern "C" int _wp_isfinite(double x) { return __builtin_isfinite(x); }
extern "C" int _wp_isnan(double x) { return __builtin_isnan(x); }

template <class... Args, size_t... Index>
void run_blocks(
    void (*kernel)(Args...), void** args, const unsigned* blocks, unsigned count, std::index_sequence<Index...>)
{
    gridDim.x = count;
    for (unsigned k = 0; k < count; ++k) {
        blockIdx.x = blocks[k];
        std::vector<std::thread> threads;
        for (unsigned i = 0; i < blockDim.x; ++i) {
            threads.emplace_back([=] { threadIdx.x = i; kernel(*static_cast<Args*>(args[Index])...); });
        }
        for (auto& thread : threads) thread.join();
    }
}

template <class... Args>
void run_blocks(void (*kernel)(Args...), void** args, const unsigned* blocks, unsigned count)
{
    run_blocks(kernel, args, blocks, count, std::index_sequence_for<Args...>());
}
"""
# memory of a thread that is allocated in PTX, which each thread allocates once in a launch
_LOCAL = re.compile(r'asm volatile\("{ .local .align 8 .b8 entries\[(\d+)\];[^}]*}" : "=l"\(address\)\);')
_AS_ON_CPU = r"thread_local wp::uint64 entries[\1 / 8]; address = reinterpret_cast<wp::uint64>(entries);"
_AFTER = """
extern "C" void run(void** args, const unsigned* blocks, unsigned count)
{{
    run_blocks({kernel}, args, blocks, count);
}}
"""


class CudaSource:
    """One kernel's source for CUDA, compiled by g++ in a folder of its own.

    block_dim: threads of a block, a multiple of the warp size. arch: as __CUDA_ARCH__, of the GPU.
    """

    def __init__(self, kernel: wp.Kernel, folder: Path, block_dim: int, arch: int = 900) -> None:
        self._block_dim = block_dim
        module = wp.get_module(f"{kernel.key}_alone")
        module.options.update(kernel.module.options)
        wp.Kernel(kernel.func, key=kernel.key, module=module)
        source = _generated(module, folder)
        (name,) = re.findall(r"__global__ void (\w+)\(", source)
        path = folder / "kernel.cpp"
        *heads, body = re.split(r'(?<=\.h")\n', source.replace("#define WP_NO_CRT\n", ""))
        path.write_text("\n".join([*heads, _BEFORE, _LOCAL.sub(_AS_ON_CPU, body), _AFTER.format(kernel=name)]))
        headers = Path(wp.__file__).parent / "native"
        flags = ["-std=c++20", "-O1", "-pthread", "-ffp-contract=off", "-w", "-shared", "-fPIC"]
        command = [
            "g++",
            *flags,
            f"-DBLOCK_DIM={block_dim}",
            f"-DCUDA_ARCH={arch}",
            f"-I{headers}",
            str(path),
            "-o",
            str(folder / "kernel.so"),
        ]
        subprocess.run(command, check=True)
        self._run = ctypes.CDLL(str(folder / "kernel.so")).run

    def launch(self, blocks: NDArray[np.integer[Any]], arguments: Sequence[Any], threads: int | None = None) -> None:
        """Run blocks with these indices of a launch of len(blocks) blocks, one after the other.

        arguments: as for `wp.launch`; threads: of the launch, if not all of the blocks.
        """
        packed = [launch_bounds_t((threads or len(blocks) * self._block_dim,)), *map(_packed, arguments)]
        pointers = (ctypes.c_void_p * len(packed))(*map(ctypes.addressof, packed))
        order = np.ascontiguousarray(blocks, np.uint32)
        self._run(pointers, order.ctypes.data_as(ctypes.c_void_p), len(order))


def _generated(module: Any, folder: Path) -> str:
    """The module's source for CUDA, which Warp writes before it compiles it; compiling is skipped."""
    compile_cuda = build.build_cuda
    build.build_cuda = lambda _source, _arch, output, **_options: Path(output).touch()
    try:
        wp.compile_aot_module(module, arch=75, module_dir=folder, use_ptx=True)
    finally:
        build.build_cuda = compile_cuda
    (source,) = folder.glob("*.cu")
    return source.read_text()


def _packed(value: Any) -> Any:
    """An argument of a kernel as a ctypes value."""
    if isinstance(value, int):
        return ctypes.c_int32(value)
    return ctypes.c_float(value) if isinstance(value, float) else value.__ctype__()
