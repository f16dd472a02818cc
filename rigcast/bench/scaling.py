"""Rays per second as one size varies and all else stays the same."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
import warp as wp

from rigcast.kernels.launching.slices import thread_count
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.sensors.scene.rays.placed import rays_in_frame
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.filter import Filter

from .casters import Floats
from .casters.with_rigcast import RigcastCaster
from .figure import Spread
from .race import in_turns, triangles_of
from .workloads import Workload, hills, room, warehouse


@dataclass(frozen=True)
class Series:
    """M rays/s at each value of the varied size."""

    varies: str
    sizes: tuple[int, ...]
    mrays: tuple[Spread, ...]


@dataclass(frozen=True, eq=False)
class _Point:
    size: int
    rays: int
    frame: Callable[[], object]


def scaling(
    rounds: int, most_triangles: int = 1_000_000, most_geoms: int = 1600, most_worlds: int = 256
) -> Iterator[Series]:
    """Yield the speed by rays (of one view), triangles (of one landscape), geoms (of one hall), threads and worlds."""
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
    counts = [4**k for k in range(6) if 4**k <= most_worlds]
    yield _series("worlds", [_Point(n, *_camera_in_worlds(house, n)) for n in counts], rounds)


def _camera(workload: Workload, every: int = 1) -> tuple[int, Callable[[], object]]:
    """Return the number of rays of every `every`-th pixel of the workload's camera, and a function that casts them."""
    origin, directions = _view(workload, every)
    caster = RigcastCaster(workload.model, workload.data, workload.groups)
    return len(directions), caster.aim(origin, directions)


def _view(workload: Workload, every: int) -> tuple[Floats, Floats]:
    """Return origin (3,) and directions (n, 3) of every `every`-th pixel of the workload's camera."""
    view = next(view for view in workload.views if view.sensor == "depth")
    return view.origin, np.ascontiguousarray(view.directions[::every, ::every].reshape(-1, 3))


def _camera_in_worlds(workload: Workload, worlds: int) -> tuple[int, Callable[[], object]]:
    """Return the number of rays of 80 x 60 pixels of the camera in `worlds` worlds, and a function that casts them.

    Poses are float32 on the device, as in mujoco_warp.
    """
    origin, directions = _view(workload, 8)
    scene, seen = Scene(workload.model, "cpu"), Filter(geom_groups=tuple(workload.groups))
    rays = replace(
        rays_in_frame(directions, origin, np.eye(4), scene.device),
        position=wp.zeros(worlds, dtype=wp.vec3d, device="cpu"),
        rotation=wp.full(worlds, wp.mat33d(np.eye(3)), dtype=wp.mat33d, device="cpu"),
        packets=sort_into_packets(directions),
        worlds=worlds,
    )
    position, rotation = workload.data.geom_xpos, workload.data.geom_xmat.reshape(-1, 3, 3)
    poses = {
        "geom_xpos": wp.array(np.tile(position, (worlds, 1, 1)), dtype=wp.vec3, device="cpu"),
        "geom_xmat": wp.array(np.tile(rotation, (worlds, 1, 1, 1)), dtype=wp.mat33, device="cpu"),
    }

    def frame() -> object:
        scene.update(poses)
        return scene.cast_rays(rays, scene.visible(seen), np.inf).distance.numpy()

    return worlds * len(directions), frame


def _on_threads(count: int, frame: Callable[[], object]) -> Callable[[], object]:
    def run() -> object:
        with patch.dict(os.environ, RIGCAST_THREADS=str(count)):
            return frame()

    return run


def _series(varies: str, points: Sequence[_Point], rounds: int) -> Series:
    times = in_turns({str(point.size): point.frame for point in points}, rounds)
    mrays = [Spread.of(point.rays / times[str(point.size)][0] / 1e6) for point in points]
    return Series(varies, tuple(point.size for point in points), tuple(mrays))
