"""Options for writing frames: the `export:` section of a rig."""

from typing import Literal

from pydantic import Field

from rigcast.sensors.specs.spec import Spec

PointLayout = Literal["auto", "full", "velodyne", "ouster", "livox", "hesai"]


class Export(Spec):
    """How frames are written. The formats themselves are those of a Recorder, or of `--format`.

    >>> Export(exr_compression="piz", point_layout="ouster")
    """

    exr_compression: Literal["none", "rle", "zips", "zip", "piz"] = Field(
        default="zip", description="compression of OpenEXR files, all lossless; every reader supports zip"
    )
    point_layout: PointLayout = Field(
        default="auto",
        description="fields of a ROS PointCloud2: those of a maker's driver, or full: all that a frame has; "
        "auto: by the maker of the sensor's preset, else full",
    )
    depth_encoding: Literal["32FC1", "16UC1"] = Field(
        default="32FC1",
        description="ROS depth images: metres in 32FC1, or whole millimetres in 16UC1 with 0 for a miss",
    )
    depth_points: bool = Field(
        default=False,
        description="ROS: whether depth cameras give a PointCloud2 of all pixels in addition to their images",
    )
    world_frame: str = Field(default="map", min_length=1, description="ROS name of MuJoCo's world frame")
    transform_rate_hz: float = Field(
        default=100.0, gt=0, description="ROS: /clock and /tf between frames, at most this often [Hz]"
    )
