"""One reading of one sensor, from its aim to its frame."""

from collections.abc import Callable
from functools import partial

from rigcast.kernels.effects.infrared import infrared
from rigcast.kernels.effects.random import RandomSource, random_source
from rigcast.kernels.rays.arrays import Rays
from rigcast.kernels.reading import intensity
from rigcast.sensors.physics.physics import Brightness
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.lidars.lidar import Lidar

from .arrays.frame_arrays import FrameArrays
from .frame import CameraFrame, Frame, LidarFrame
from .mounted import Aim, Mounted


def read_frame(mounted: Mounted, aim: Aim, seed: int) -> Frame:
    """What a sensor reads in the world as its scene stands. seed: of the errors of all readings."""
    random = partial(random_source, seed, mounted.spec.name, next(mounted.frames))
    return frame_of(mounted, aim, read(mounted, aim.rays, aim.arrays, random))


def read(mounted: Mounted, rays: Rays, arrays: FrameArrays, random: Callable[[], RandomSource]) -> Brightness | None:
    """One reading into these arrays. Gives None where brightness follows from what was hit, without errors."""
    visible = mounted.visible()
    if mounted.physics is not None:
        hits, brightness = mounted.physics.read(rays, visible, random())
        arrays.take(hits, rays)
        return brightness
    arrays.read(mounted.scene, rays, visible, (mounted.spec.min_range, mounted.spec.max_range))
    return None


def frame_of(mounted: Mounted, aim: Aim, brightness: Brightness | None) -> Frame:
    """The frame of what was read."""
    spec, arrays, looks = mounted.spec, aim.arrays, mounted.scene.looks
    common = aim.time, aim.pose, arrays.shape, arrays, mounted.source
    if isinstance(spec, Lidar):
        bright = brightness or partial(intensity, arrays.hits, aim.rays, looks().surfaces)
        frame: Frame = LidarFrame(*common, mounted.pattern.ring, mounted.pattern.column, bright)
    elif isinstance(spec, DepthCamera):
        bright = brightness or partial(infrared, arrays.hits, aim.rays.directions, looks().reflectivity)
        pattern = mounted.pattern.given
        assert pattern.intrinsics is not None
        frame = CameraFrame(*common, pattern.intrinsics, pattern.lens, spec.depth_scale, bright)
    else:
        frame = Frame(*common)
    for field in arrays.asked:
        getattr(frame, field)  # which is worked out into the array that it had
    return frame
