"""One reading of one sensor, from its aim to its frame."""

import math
from functools import partial
from typing import Any

import warp as wp

from rigcast.kernels.effects.infrared import infrared
from rigcast.kernels.effects.random import RandomSource, random_source
from rigcast.kernels.reading import intensity
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.lidar import Lidar

from .frame import CameraFrame, Frame, LidarFrame
from .mounted import Aim, Mounted


def read_frame(mounted: Mounted, aim: Aim, seed: int) -> Frame:
    """What a sensor reads in the world as its scene stands. seed: of the errors of all readings."""
    if isinstance(mounted.spec, Lidar):
        frame: Frame = _read_lidar(mounted, aim, seed)
    elif isinstance(mounted.spec, DepthCamera):
        frame = _read_camera(mounted, mounted.spec, aim, seed)
    else:
        _read_plainly(mounted, aim)
        frame = Frame(**_common(mounted, aim))
    for field in aim.kept.asked:
        getattr(frame, field)  # which writes over what it was
    return frame


def _read_lidar(mounted: Mounted, aim: Aim, seed: int) -> LidarFrame:
    rays, kept = aim.rays, aim.kept
    if mounted.physics is None:
        _read_plainly(mounted, aim)
        bright = partial(intensity, kept.hits, rays, mounted.scene.looks().surfaces)
    else:
        reading = mounted.physics.read(rays, mounted.visible(), _random(mounted, aim, seed))
        kept.take(reading.hits, rays)
        bright = partial(_copied, reading.intensity)
    return LidarFrame(**_common(mounted, aim), ring=mounted.ring, column=mounted.column, _intensity=bright)


def _read_camera(mounted: Mounted, spec: DepthCamera, aim: Aim, seed: int) -> CameraFrame:
    pattern, rays, kept = mounted.pattern, aim.rays, aim.kept
    if mounted.depth_physics is None:
        _read_plainly(mounted, aim)
        seen = kept.hits
    else:
        reading = mounted.depth_physics.read(rays, mounted.visible(), _random(mounted, aim, seed))
        kept.take(reading.hits, rays)
        seen = reading.seen
    assert pattern.intrinsics is not None
    return CameraFrame(
        **_common(mounted, aim),
        intrinsics=pattern.intrinsics,
        lens=pattern.lens,
        depth_scale=spec.depth_scale,
        _intensity=partial(infrared, seen, rays.directions, mounted.scene.looks().reflectivity),
    )


def _read_plainly(mounted: Mounted, aim: Aim) -> None:
    """A reading without errors."""
    limits = mounted.spec.min_range, mounted.spec.max_range
    aim.kept.read(mounted.scene, aim.rays, mounted.visible(), limits)


def _copied(values: wp.array, out: wp.array | None) -> wp.array:
    if out is None:
        return values.flatten()
    wp.copy(out, values.flatten())
    return out


def _random(mounted: Mounted, aim: Aim, seed: int) -> RandomSource:
    """The random numbers of the next reading of a sensor."""
    rays = math.prod(mounted.pattern.shape)
    return random_source(seed, mounted.spec.name, next(mounted.frames), aim.worlds, rays)


def _common(mounted: Mounted, aim: Aim) -> dict[str, Any]:
    """What every frame is made with."""
    return {
        "sensor": mounted.spec.name,
        "time": aim.time,
        "pose": aim.pose,
        "shape": aim.kept.shape,
        "_kept": aim.kept,
        "_ids_of_shape": mounted.scene.ids_in_use,
        "_body_of_shape": mounted.scene.body_of_shape,
        "_firing_times": mounted.firing_times,
        "_pattern": mounted.pattern,
    }
