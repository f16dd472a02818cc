"""The kernel that casts the rays of one sensor on CUDA: each thread of as many as run at once takes ray after ray."""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.hits.out import write_miss
from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.rays.arrays import firing_of
from rigcast.kernels.single.cast import Job, is_castable, ray_number, read_ray, world_ray, write_hit

from .ray import Frame, Ray, cast_ray
from .walk import ENTRIES, address_of_stack

BLOCK = 128
"""Threads of a block."""
BLOCKS = 4
"""Of a multiprocessor: 16 warps, for each of whose threads there are 128 registers."""
RAY_DOUBLES = wp.types.type_size_in_bytes(Ray) // 8 | 1
FRAME_FLOATS = 2 * wp.types.type_size_in_bytes(Frame) // 4 | 1
"""How far apart threads' rays are, in 8 bytes, and their frames, in 4: odd, so that threads which read the same of
theirs do not read from one bank."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.struct
class Share:
    """What is cast of one sensor: the first `count` rays of those that `which` names, or of all if it is empty."""

    job: Job
    which: wp.array[int]
    count: int


@wp.kernel
def hold(
    sensor: int,
    g: Geometry,
    job: Job,
    which: wp.array[int],
    count: int,
    held: wp.array2d[Geometry],
    shares: wp.array2d[Share],
    taken: wp.array[int],
) -> None:
    """What a sensor casts at and its share, where functions need not copy them; and none of its rays is taken."""
    g.visible = job.visible
    held[sensor, 0] = g
    share = Share()
    share.job = job
    share.which = which
    share.count = count
    shares[sensor, 0] = share
    taken[sensor] = 0


@wp.func_native(on_cuda("return threadIdx.x % warpSize;"))
def lane() -> int:  # type: ignore[empty-body]
    """The number of a thread in its warp."""


@wp.func_native(
    on_cuda("""
    int first = 0;
    if (threadIdx.x % warpSize == 0) first = atomicAdd(&taken.data[sensor], warpSize);
    return __shfl_sync(~0u, first, 0);
""")
)
def turn_of_warp(taken: wp.array[int], sensor: int) -> int:  # type: ignore[empty-body]
    """The first of as many rays of this sensor as a warp has threads, which no other warp takes.

    All threads of the warp call it: they go on together, and with neighbours, that go much the same way.
    """


@wp.func_native(
    on_cuda(f"""
    __shared__ double rays[{BLOCK}][{RAY_DOUBLES}];
    return reinterpret_cast<wp::uint64>(rays[threadIdx.x]);
""")
)
def place_of_ray() -> wp.uint64:
    """Where in the memory of its block a thread has its ray."""


@wp.func_native(
    on_cuda(f"""
    __shared__ float frames[{BLOCK}][{FRAME_FLOATS}];
    return reinterpret_cast<wp::uint64>(frames[threadIdx.x]);
""")
)
def place_of_frames() -> wp.uint64:
    """Where in the memory of its block a thread has a ray's frames."""


@wp.func
def cast_share(
    sensor: int, g: Geometry, held: wp.array[Geometry], job: Job, which: wp.array[int], count: int, taken: wp.array[int]
) -> None:
    """Rays of one sensor that no other warp takes. A function, for Warp compiles the body of a kernel twice."""
    entries = wp.zeros(shape=ENTRIES, dtype=wp.uint64)
    stack = address_of_stack(entries)
    ray = wp.array(ptr=place_of_ray(), shape=(1,), dtype=Ray)
    frames = wp.array(ptr=place_of_frames(), shape=(2,), dtype=Frame)
    first = turn_of_warp(taken, sensor)
    while first < count:
        k = first + lane()
        if k < count:
            ray[0].number = ray_number(k, job.rays, which)
            ray[0].world = world_ray(held, job, ray[0].number, firing_of(job.rays, ray[0].number))
            if is_castable(ray[0].world):
                cast_ray(g, held, ray, frames, stack)
                write_hit(held, job.out, ray[0].number, ray[0].best, ray[0].world)
            else:
                write_miss(job.out, ray[0].number, wp.nan)
            read_ray(job, ray[0].number, firing_of(job.rays, ray[0].number))
        first = turn_of_warp(taken, sensor)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays(
    g: Geometry, held: wp.array2d[Geometry], job: Job, which: wp.array[int], count: int, taken: wp.array[int]
) -> None:
    """A sensor's rays: the first `count` of those that `which` names, or of all if it is empty.

    As many threads as fill warps. Arguments of a kernel are read as fast as what is in registers, so one sensor, which
    most rigs have, does not go the way of several.
    """
    g.visible = job.visible
    cast_share(0, g, held[0], job, which, count, taken)
