"""The cast of rays in bundles, on the CPU."""

from typing import Any

import warp as wp

from rigcast.kernels.geometry import Geometry, TriangleBlock
from rigcast.kernels.hits.hit import WorldRay, no_hit
from rigcast.kernels.hits.out import write_miss
from rigcast.kernels.launching.slices import TURN, OverTiles
from rigcast.kernels.launching.turns import turn_of
from rigcast.kernels.packing.bundling import BUNDLE
from rigcast.kernels.poses.scope import scope_of
from rigcast.kernels.rays.arrays import direction_of, firing_of, origin_of, span_of
from rigcast.kernels.rays.coherent import Bundles
from rigcast.kernels.single.cast import Job, is_castable, read_ray, write_hit

from .bundle import Bundle, Member, cast_bundle, world_ray_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.struct
class InBundles:
    """The bundles to cast, the same in every world, and the scratch of each thread."""

    worlds: int
    rays: wp.array2d[int]  # (bundles, BUNDLE) numbers of rays within a world, -1 for none
    # scratch:
    copies: wp.array2d[Geometry]  # (threads, 1)
    members: wp.array[Member]  # (threads BUNDLE,)
    composed: wp.array2d[TriangleBlock]  # (threads, 1)


@wp.func
def bundle_of(
    world: int, rays: wp.array[int], g: wp.array[Geometry], job: Job, these: InBundles, thread: int
) -> Bundle:
    """The bundle of those of `rays` that can be cast; writes NaN for the others."""
    own = job.rays
    members = these.members
    first = thread * BUNDLE
    ray = WorldRay()
    begin = world * own.count
    firing = firing_of(own, begin + rays[0])
    rotation = own.rotation[firing]
    bundle = Bundle()
    bundle.members = members
    bundle.first = first
    bundle.composed = these.composed[thread]
    bundle.middle.world_direction = rotation * direction_of(own, begin + rays[0])
    bundle.middle.scope = scope_of(g, span_of(own, firing), firing)
    bundle.middle.limit = job.limit
    bundle.middle.world_cull = job.cull
    bundle.middle.cull = job.cull
    ray.direction = bundle.middle.world_direction
    for lane in range(BUNDLE):
        if rays[lane] >= 0:
            i = begin + rays[lane]
            ray.origin = own.position[firing] + rotation * origin_of(own, i)
            if is_castable(ray):
                k = first + bundle.count
                members[k].number = i
                members[k].origin = ray.origin
                members[k].best = no_hit()
                bundle.count += 1
            else:
                write_miss(job.out, i, wp.nan)
                read_ray(job, i, firing)
    return bundle


@wp.func
def write_bundle(g: wp.array[Geometry], job: Job, bundle: Bundle) -> None:
    for k in range(bundle.first, bundle.first + bundle.count):
        i = bundle.members[k].number
        write_hit(g, job.out, i, bundle.members[k].best, world_ray_of(bundle, k))
        read_ray(job, i, firing_of(job.rays, i))


@wp.func
def cast_turn(begin: int, end: int, g: wp.array[Geometry], job: Job, these: InBundles, thread: int) -> None:
    """Cast bundles begin to end - 1. The loop is in a function because Warp compiles the body of a kernel twice."""
    bundles = these.rays.shape[0]
    for at in range(begin, end):
        bundle = bundle_of(at / bundles, these.rays[at % bundles], g, job, these, thread)
        if bundle.count > 0:
            cast_bundle(g, bundle)
            write_bundle(g, job, bundle)


@wp.kernel
def cast_bundles(thread: int, turns: wp.array[int], g: Geometry, job: Job, these: InBundles) -> None:
    """Cast the bundles of all worlds, TURN per turn; each thread claims turns. turns: number claimed so far."""
    g.visible = job.visible
    these.copies[thread, 0] = g
    count = these.worlds * these.rays.shape[0]
    begin = turn_of(turns) * TURN
    while begin < count:
        cast_turn(begin, wp.min(begin + TURN, count), these.copies[thread], job, these, thread)
        begin = turn_of(turns) * TURN


def prepare_bundles(geometry: Geometry, job: Job, bundles: Bundles, worlds: int) -> OverTiles:
    """A launch that casts all bundles in each of the worlds."""

    def inputs(threads: int) -> list[Any]:
        these = InBundles()
        these.worlds, these.rays = worlds, bundles.rays
        these.copies = wp.empty((threads, 1), dtype=Geometry, device="cpu")
        these.members = wp.empty(threads * BUNDLE, dtype=Member, device="cpu")
        these.composed = wp.empty((threads, 1), dtype=TriangleBlock, device="cpu")
        return [geometry, job, these]

    return OverTiles(cast_bundles, worlds * bundles.rays.shape[0], inputs)
