"""The picture of a frame."""

from PIL import Image

from rigcast.sensors.preview.camera import draw_camera
from rigcast.sensors.preview.height_scan import draw_height_scan
from rigcast.sensors.preview.lidar import draw_lidar
from rigcast.sensors.rig.frame import CameraFrame, Frame, LidarFrame
from rigcast.sensors.specs.pattern import Pattern


def draw_preview(pattern: Pattern, frame: Frame) -> Image.Image:
    """Draw one frame of one sensor, 1200 pixels wide, with scales in metres.

    A camera: z-depth, normals, geoms. A lidar: range image above a top-down view. A height scan: its grid.

    Args:
        pattern: of the sensor whose frame it is.
        frame: one reading, of one world.
    """
    if isinstance(frame, CameraFrame):
        return draw_camera(frame)
    if isinstance(frame, LidarFrame):
        return draw_lidar(frame, pattern)
    return draw_height_scan(frame, pattern)
