"""Casts of a sensor's rays against the geometry, in packets, in bundles or singly."""

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
from .single.cast import Job, prepare_singles


def cast(
    geometry: Geometry, visible: wp.array, rays: Rays, limit: float, cull: int, out: HitArrays | None = None
) -> HitArrays:
    """Find each ray's first hit among the visible shapes, up to and including limit [m].

    Args:
        visible: (n,) of bool per shape for all worlds, or (W n,) for each shape of each world.
        cull: CULL_NONE, CULL_BACK or CULL_FRONT of rigcast.kernels.shapes.triangle.
        out: arrays to write to; None makes new ones.

    Returns:
        One entry per ray, world after world.
    """
    hits = HitArrays.empty(rays.total, rays.directions.device) if out is None else out
    _launch(_prepare(geometry, rays, _job(visible, rays, limit, cull, hits.out())))
    return hits


class Launch(Protocol):
    """A repeatable launch."""

    def launch_with(self, others: Sequence[Any]) -> object:
        """Launch it together with others of its type. Returns objects that a CUDA graph of these launches must hold."""
        ...


class Readings(NamedTuple):
    """A repeatable cast whose hits are sensor readings. It holds no reference to the arrays that it writes."""

    launches: Sequence[Launch]
    job: Job

    def turn_to(self, hits: HitArrays, rays: Rays, fields: Mapping[str, wp.array]) -> None:
        """Direct the cast's output to these hits and fields; the caller must keep all arrays alive.

        Args:
            rays: those that the cast was prepared for, at their current poses.
            fields: arrays by name, of rigcast.kernels.hits.out.FIELD_NAMES; those left out are not written.
        """
        job = self.job.__ctype__()
        hits.lend(job.out)
        for name in FIELD_NAMES:
            setattr(job.fields, name, fields[name].__ctype__() if name in fields else type(getattr(job.fields, name))())
        self.aim(rays)

    def aim(self, rays: Rays) -> None:
        """Take the present poses of the rays that the cast was prepared for; the caller must keep them alive."""
        job = self.job.__ctype__()
        job.rays.position, job.rays.rotation = rays.position.__ctype__(), rays.rotation.__ctype__()


def prepare_readings(
    geometry: Geometry, visible: wp.array, rays: Rays, limits: tuple[float, float], body_of_shape: wp.array
) -> Readings:
    """Prepare a cast whose hits are readings within these limits [m]; call `turn_to` before the first launch.

    Hits nearer than the lower limit become -inf; normals are in the rays' frame. With one instant, shapes have their
    poses at the time of the launch; with several, their motion at the time of this call.

    Args:
        visible: as for `cast`.
        body_of_shape: (n,) int32, the body of each shape, for the field `body_id`.
    """
    out = Out()
    out.is_read, out.min_range = True, limits[0]
    job = _job(visible, rays, limits[1], CULL_NONE, out)
    job.fields.body_of_shape = body_of_shape
    return Readings(_prepare(geometry, rays, job), job)


def prepare_hits(geometry: Geometry, visible: wp.array, rays: Rays, limit: float, out: HitArrays) -> Readings:
    """Prepare a `cast` that writes to these arrays. Shapes are cast as for `prepare_readings`; `turn_to` other poses of
    the rays."""
    job = _job(visible, rays, limit, CULL_NONE, out.out())
    return Readings(_prepare(geometry, rays, job), job)


def launch(readings: Iterable[Readings]) -> object:
    """Cast the rays of several sensors on one device at once, on CUDA by one kernel; all must share one geometry.

    Returns objects that a CUDA graph of this launch must hold.
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
        return _prepare_singles(placed, job, wp.empty(0, dtype=int, device=device), rays.total)
    packets, worlds = rays.packets, rays.worlds
    if isinstance(packets, Warps):
        return _prepare_singles(placed, job, packets.order, rays.total)
    if isinstance(packets, Bundles):
        from .bundles.cast import prepare_bundles  # here, as a rig without parallel rays needs none of it

        return [prepare_bundles(placed, job, packets, worlds)]
    launches: list[Launch] = []
    if packets.tiles.size:
        launches.append(prepare_packets(placed, job, packets, worlds))
    if packets.singles.size:
        launches += _prepare_singles(placed, job, packets.singles, worlds * packets.singles.size)
    return launches


def _prepare_singles(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    """Cast `count` rays one by one: all rays, or those that `which` lists in every world."""
    if which.device.is_cpu:
        return [prepare_singles(geometry, job, which, count)]
    return _in_threads(geometry, job, which, count)


def _in_threads(geometry: Geometry, job: Job, which: wp.array, count: int) -> list[Launch]:
    from .single.threads.launches import InThreads  # here, as nothing but CUDA needs it

    return [InThreads(geometry, job, which, count)] if count else []
