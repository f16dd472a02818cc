"""The kernel that casts the rays of one sensor on CUDA: as many threads as run at once, each casting ray after ray."""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.on_cuda import on_cuda
from rigcast.kernels.rays.arrays import firing_in
from rigcast.kernels.single.cast import Job, is_castable, ray_to_cast, world_ray

from .hits import BLOCK, hold_hit
from .ray import Frame, Ray, cast_ray
from .walk import address_of_stack

BLOCKS = 4
"""Blocks per multiprocessor: 16 warps, which leaves 128 registers to each thread."""
RAY_DOUBLES = wp.types.type_size_in_bytes(Ray) // 8 | 1
FRAME_FLOATS = 2 * wp.types.type_size_in_bytes(Frame) // 4 | 1
"""Distances in shared memory between the rays, and between the frames, of neighbouring threads [8 and 4 bytes];
odd, so that threads that read the same field do not read from the same bank."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 8})


@wp.struct
class Share:
    """The rays to cast of one sensor: the first `count` of those that `which` lists, or of all if it is empty."""

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
    """Store a sensor's geometry and share in memory, so that functions need not copy them; set its rays taken to 0."""
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
    """Index of the thread within its warp."""


@wp.func_native(
    on_cuda("""
    int first = 0;
    if (threadIdx.x % warpSize == 0) first = atomicAdd(&taken.data[sensor], warpSize);
    return __shfl_sync(~0u, first, 0);
""")
)
def turn_of_warp(taken: wp.array[int], sensor: int) -> int:  # type: ignore[empty-body]
    """Claim as many rays of a sensor as a warp has threads; return the first.

    All threads of the warp must call it. They stay together and take neighbouring rays, which visit much the same
    nodes.
    """


@wp.func_native(on_cuda("return __all_sync(~0u, x == __shfl_sync(~0u, x, 0));"))
def is_one_in_warp(x: int) -> bool:  # type: ignore[empty-body]
    """Whether all threads of a warp have the same number. All of them call it."""


@wp.func_native(
    on_cuda(f"""
    __shared__ double rays[{BLOCK}][{RAY_DOUBLES}];
    return reinterpret_cast<wp::uint64>(rays[threadIdx.x]);
""")
)
def address_of_ray() -> wp.uint64:
    """Address of the thread's ray in shared memory."""


@wp.func_native(
    on_cuda(f"""
    __shared__ float frames[{BLOCK}][{FRAME_FLOATS}];
    return reinterpret_cast<wp::uint64>(frames[threadIdx.x]);
""")
)
def address_of_frames() -> wp.uint64:
    """Address of the frames of the thread's ray in shared memory."""


@wp.func
def cast_share(
    sensor: int, g: Geometry, held: wp.array[Geometry], job: Job, which: wp.array[int], count: int, taken: wp.array[int]
) -> None:
    """Cast rays of one sensor until all are taken. In a function because Warp compiles the body of a kernel twice."""
    stack = address_of_stack()
    ray = wp.array(ptr=address_of_ray(), shape=(1,), dtype=Ray)
    frames = wp.array(ptr=address_of_frames(), shape=(2,), dtype=Frame)
    first = turn_of_warp(taken, sensor)
    while first < count:
        k = first + lane()
        at = ray_to_cast(wp.min(k, count - 1), job.rays, which)
        ray[0].number = at[0] * job.rays.count + at[1]
        ray[0].world = world_ray(held, job, at[0], at[1], firing_in(job.rays, at[0], at[1]))
        is_cast = k < count and is_castable(ray[0].world)
        together = which.shape[0] > 0 and is_one_in_warp(ray[0].world.scope.span)
        cast_ray(g, held, ray, frames, stack, is_cast, together)
        if is_cast:
            hold_hit(job.out, ray[0].number, ray[0].best)
        first = turn_of_warp(taken, sensor)


@wp.kernel(launch_bounds=(BLOCK, BLOCKS))
def cast_rays(
    g: Geometry, held: wp.array2d[Geometry], job: Job, which: wp.array[int], count: int, taken: wp.array[int]
) -> None:
    """Cast the rays of one sensor: the first `count` of those that `which` lists, or of all if it is empty.

    The number of threads must be a multiple of the warp size. A kernel's arguments are read as fast as registers, so
    rigs with one sensor, which most are, do not use the kernel for several.
    """
    g.visible = job.visible
    cast_share(0, g, held[0], job, which, count, taken)
