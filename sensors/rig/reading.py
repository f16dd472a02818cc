"""Readings of sensors: from their aims to their frames."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from rigcast.kernels.cast import Readings, launch
from rigcast.kernels.effects.light import infrared, intensity
from rigcast.kernels.effects.random import RandomSource, random_source
from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.physics.physics import Brightness
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.lidars.lidar import Lidar

from .arrays.frame_arrays import FrameArrays
from .frame import CameraFrame, Frame, LidarFrame
from .mounted import Aim, Mounted


class Request(NamedTuple):
    """A request to read a sensor along these rays, into these arrays, with random numbers from `random`."""

    mounted: Mounted
    rays: Rays
    arrays: FrameArrays
    random: Callable[[], RandomSource]


def read_frames(aimed: Sequence[tuple[Mounted, Aim]], seed: int) -> list[Frame]:
    """Frames of sensors in the world at which their scene stands. seed: for the errors of all readings."""
    requests = [
        Request(m, aim.rays, aim.arrays, partial(random_source, seed, m.spec.name, next(m.frames))) for m, aim in aimed
    ]
    brightness, _ = read(requests)
    return [frame_of(m, aim, bright) for (m, aim), bright in zip(aimed, brightness, strict=True)]


def read(requests: Sequence[Request]) -> tuple[list[Brightness | None], object]:
    """Make these readings: sensors without errors all at once, the others one after the other.

    Returns the intensity of each, None where it follows from the hits; and what a CUDA graph that repeats them must
    hold.
    """
    brightness: list[Brightness | None] = []
    used: list[object] = []
    casts: dict[str, Readings] = {}
    for mounted, rays, arrays, random in requests:
        spec, visible = mounted.spec, mounted.visible()
        if mounted.physics is None:
            if spec.name in casts:  # arrays of one sensor may share their launches
                used.append(launch(casts.values()))
                casts.clear()
            casts[spec.name] = arrays.readings(mounted.scene, rays, visible, (spec.min_range, spec.max_range))
            brightness.append(None)
        else:
            reading = mounted.physics.read(rays, visible, random(), arrays.hits)
            arrays.taken(rays)
            brightness.append(reading.brightness)
            used.append(reading.used)
    used.append(launch(casts.values()))
    return brightness, used


def frame_of(mounted: Mounted, aim: Aim, brightness: Brightness | None) -> Frame:
    """The frame of a reading."""
    spec, arrays, looks = mounted.spec, aim.arrays, mounted.scene.looks
    common = aim.time, aim.pose, arrays.shape, arrays, mounted.source
    if isinstance(spec, Lidar):
        bright = brightness or partial(intensity, arrays.hits, aim.rays, looks().reflectivity)
        frame: Frame = LidarFrame(*common, bright)
    elif isinstance(spec, DepthCamera):
        bright = brightness or partial(infrared, arrays.hits, aim.rays.directions, looks().reflectivity)
        pattern = mounted.pattern.given
        assert pattern.intrinsics is not None
        frame = CameraFrame(*common, pattern.intrinsics, pattern.lens, spec.depth_scale, bright)
    else:
        frame = Frame(*common)
    for field in arrays.fields.requested:
        getattr(frame, field)  # computed into the array that it had
    return frame
