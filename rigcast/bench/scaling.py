"""How rays per second change with the size of one thing, all else alike."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np

from rigcast.kernels.launch import thread_count

from .casters import Answer
from .casters.with_rigcast import RigcastCaster
from .figure import Spread
from .race import in_turns, triangles_of
from .workloads import Workload, hills, room, warehouse


@dataclass(frozen=True)
class Series:
    """M rays/s of a depth camera at each size of what varies."""

    varies: str
    sizes: tuple[int, ...]
    mrays: tuple[Spread, ...]


@dataclass(frozen=True, eq=False)
class _Point:
    size: int
    rays: int
    frame: Callable[[], Answer]


def scaling(rounds: int, most_triangles: int = 1_000_000, most_geoms: int = 1600) -> Iterator[Series]:
    """Yield the speed by rays (of one view), triangles (of one landscape), geoms (of one hall) and threads."""
    house = warehouse()
    images = [_camera(house, every=k) for k in (8, 4, 2, 1)]
    yield _series("rays", [_Point(rays, rays, frame) for rays, frame in images], rounds)
    fields = [hills(10**k) for k in range(4, 8) if 10**k <= most_triangles]
    yield _series("triangles", [_Point(triangles_of(field.model), *_camera(field)) for field in fields], rounds)
    halls = [room(geoms) for geoms in (10, 50, 200, 800, 1600) if geoms <= most_geoms]
    yield _series("geoms", [_Point(hall.model.ngeom, *_camera(hall)) for hall in halls], rounds)
    rays, frame = images[-1]
    threads = sorted({2**k for k in range(8) if 2**k < thread_count()} | {thread_count()})
    yield _series("threads", [_Point(n, rays, _on_threads(n, frame)) for n in threads], rounds)


def _camera(workload: Workload, every: int = 1) -> tuple[int, Callable[[], Answer]]:
    """Return how many rays the workload's camera has, of every so many pixels, and what casts them."""
    view = next(view for view in workload.views if view.sensor == "depth")
    directions = np.ascontiguousarray(view.directions[::every, ::every].reshape(-1, 3))
    caster = RigcastCaster(workload.model, workload.data, workload.groups)
    return len(directions), caster.aim(view.origin, directions)


def _on_threads(count: int, frame: Callable[[], Answer]) -> Callable[[], Answer]:
    def run() -> Answer:
        with patch.dict(os.environ, RIGCAST_THREADS=str(count)):
            return frame()

    return run


def _series(varies: str, points: Sequence[_Point], rounds: int) -> Series:
    times = in_turns({str(point.size): point.frame for point in points}, rounds)
    mrays = [Spread.of(point.rays / times[str(point.size)][0] / 1e6) for point in points]
    return Series(varies, tuple(point.size for point in points), tuple(mrays))
