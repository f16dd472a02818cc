"""The cast: the rays of a sensor, through the geometry, to hits."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import warp as wp

from .geometry import Geometry
from .hits.arrays import HitArrays
from .hits.out import FIELD_NAMES, Out
from .packets.cast import prepare_packets
from .poses.moving import at_firings
from .rays.arrays import Rays
from .rays.coherent import Bundles, Warps
from .shapes.triangle import CULL_NONE
from .single.cast import Job, prepare_turns


def cast(
    geometry: Geometry, visible: wp.array, rays: Rays, limit: float, cull: int, out: HitArrays | None = None
) -> HitArrays:
    """Each ray's first hit among the visible shapes, up to and including limit [m].

    Args:
        visible: bool per shape, for all worlds, or for each shape of each world.
        cull: CULL_NONE, CULL_BACK or CULL_FRONT of rigcast.kernels.shapes.triangle.
        out: where to write; None makes new arrays.

    Returns:
        One entry per ray, world after world.
    """
    hits = HitArrays.empty(rays.total, rays.directions.device) if out is None else out
    _launch(_prepare(geometry, rays, _job(visible, rays, limit, cull, hits.out())))
    return hits


class Launch(Protocol):
    """A launch for as often as it is wanted."""

    def launch_with(self, others: Sequence[Any]) -> object:
        """Launch it, and others of its type, all at once. Gives what a graph that repeats that is to hold."""
        ...


class Readings(NamedTuple):
    """A cast whose hits are readings: launches for as often as it is wanted, that hold no arrays which they write."""

    launches: Sequence[Launch]
    job: Job

    def turn_to(self, hits: HitArrays, rays: Rays, fields: Mapping[str, wp.array]) -> None:
        """From now on write these hits and, of rigcast.kernels.hits.out.FIELD_NAMES, these fields.

        rays: those that it was prepared for, wherever they are now. Whoever launches keeps the arrays.
        """
        job = self.job.__ctype__()
        hits.lend(job.out)
        for name in FIELD_NAMES:
            setattr(job.fields, name, fields[name].__ctype__() if name in fields else type(getattr(job.fields, name))())
        job.rays.position, job.rays.rotation = rays.position.__ctype__(), rays.rotation.__ctype__()


def prepare_readings(
    geometry: Geometry, visible: wp.array, rays: Rays, limits: tuple[float, float], body_of_shape: wp.array
) -> Readings:
    """A cast whose hits are readings between these limits [m], once it is turned to where they go.

    What is nearer is -inf, normals are in the rays' frame. It casts at shapes that stand still as they do by then, and
    at shapes that move as they do now.
    """
    out = Out()
    out.is_read, out.min_range = True, limits[0]
    job = _job(visible, rays, limits[1], CULL_NONE, out)
    job.fields.body_of_shape = body_of_shape
    return Readings(_prepare(geometry, rays, job), job)


def launch(readings: Iterable[Readings]) -> object:
    """Cast and read what several sensors see on one device, all at once: on CUDA in one launch of all their rays.

    They cast at one geometry, as it stands. Gives what a graph that repeats that is to hold.
    """
    return _launch([each for reading in readings for each in reading.launches])


def _launch(launches: Sequence[Launch]) -> object:
    return launches[0].launch_with(launches[1:]) if launches else None


def _job(visible: wp.array, rays: Rays, limit: float, cull: int, out: Out) -> Job:
    job = Job()
    job.rays, job.visible, job.limit, job.cull, job.out = rays.arrays, visible, limit, cull, out
    return job


def _prepare(geometry: Geometry, rays: Rays, job: Job) -> list[Launch]:
    device = rays.directions.device
    placed = geometry if geometry.instants == 1 else at_firings(geometry, rays)
    if rays.packets is None:
        return _prepare_alone(placed, job, wp.empty(0, dtype=int, device=device), rays.total)
    packets, worlds = rays.packets, rays.worlds
    if isinstance(packets, Warps):
        return _prepare_alone(placed, job, packets.order, rays.total)
    if isinstance(packets, Bundles):
        from .bundles.cast import prepare_bundles  # here, as a rig without parallel rays needs none of it

        return [prepare_bundles(placed, job, packets, worlds)]
    launches: list[Launch] = []
    if packets.tiles.size:
        launches.append(prepare_packets(placed, job, packets, worlds))
    if packets.singles.size:
        launches += _prepare_alone(placed, job, packets.singles, worlds * packets.singles.size)
    return launches


def _prepare_alone(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    """Cast so many rays one by one: all of them, or those that `which` names, in every world."""
    if which.device.is_cpu:
        return [prepare_turns(geometry, job, which, count)]
    return _in_threads(geometry, job, which, count)


def _in_threads(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    from .single.threads.launches import InThreads  # here, as nothing but CUDA needs it

    return [InThreads(geometry, job, which, count)] if count else []
