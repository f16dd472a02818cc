"""The formats, and their assignment to sensors."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from rigcast.sensors.errors import InputError
from rigcast.sensors.extras import load_extra
from rigcast.sensors.names import did_you_mean
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.sensor_spec import SensorSpec

Kind = Literal["frame", "cameras", "run"]


@dataclass(frozen=True)
class Format:
    """A format that frames are written in.

    holds: what one file of it holds, a frame, the frames of all cameras at one time, or a whole run.
    suffixes: of the files of a frame; of a run, its folder. needs: the module that writes it and the extra
    that brings it, where that does not come with rigcast. most_classes: the most that it has numbers for.
    """

    holds: Kind = "frame"
    suffixes: tuple[str, ...] = ()
    images_only: bool = False
    needs: tuple[str, str] | None = None
    most_classes: int | None = None


FORMATS = {
    "exr": Format(suffixes=(".exr",), images_only=True),
    "exr_multipart": Format("cameras", (".exr",), images_only=True),
    "png": Format(suffixes=(".png",), images_only=True),
    "ply": Format(suffixes=(".ply",)),
    "pcd": Format(suffixes=(".pcd",), needs=("pypcd4", "pcd")),
    "las": Format(suffixes=(".las",), needs=("laspy", "las"), most_classes=192),
    "laz": Format(suffixes=(".laz",), needs=("lazrs", "las"), most_classes=192),
    "kitti": Format(suffixes=(".bin", ".label"), most_classes=2**16 - 1),
    "nuscenes": Format(suffixes=(".pcd.bin", "_lidarseg.bin"), most_classes=2**8 - 1),
    "npz": Format(suffixes=(".npz",)),
    "zarr": Format("run", ("frames.zarr",), needs=("zarr", "zarr")),
    "mcap": Format("run", ("rosbag2_mcap",), needs=("rosbags", "ros")),
    "sqlite3": Format("run", ("rosbag2_sqlite3",), needs=("rosbags", "ros")),
}


def choose_formats(sensors: Sequence[SensorSpec], formats: Sequence[str] | None) -> dict[str, tuple[str, ...]]:
    """Assign to each sensor, by name, the formats that fit it: all fit a depth camera; formats of images fit no other.

    Args:
        sensors: of one rig.
        formats: any of FORMATS; None is exr for depth cameras and ply for the others.

    Raises:
        InputError: no format, or all unknown formats and those whose library is not installed, or all sensors that none
            of them fits.
    """
    if formats is None:
        return {spec.name: ("exr",) if _is_image(spec) else ("ply",) for spec in sensors}
    if isinstance(formats, str) or not isinstance(formats, Iterable):
        raise InputError(f"Recorder: formats: got {formats!r}, expected a list of names, such as [{str(formats)!r}]")
    wanted = tuple(dict.fromkeys(formats))
    faults = [fault for name in wanted for fault in _format_faults(name)]
    if not wanted:
        faults = [f"got no format, expected any of {', '.join(FORMATS)}"]
    if faults:
        raise InputError("\n".join(faults))
    chosen = {spec.name: tuple(f for f in wanted if _is_image(spec) or not FORMATS[f].images_only) for spec in sensors}
    faults = [_unfit(spec, wanted) for spec in sensors if not chosen[spec.name]]
    if faults:
        raise InputError("\n".join(faults))
    return chosen


def _is_image(spec: SensorSpec) -> bool:
    return isinstance(spec, DepthCamera)


def _format_faults(name: str) -> Iterator[str]:
    """A sentence for a format that does not exist, or whose library is not installed."""
    if name not in FORMATS:
        yield f"no format {name!r}, expected any of {', '.join(FORMATS)}{did_you_mean(str(name), list(FORMATS))}"
    elif needs := FORMATS[name].needs:
        try:
            load_extra(f"format {name}", *needs)
        except InputError as error:
            yield str(error)


def _unfit(spec: SensorSpec, wanted: Sequence[str]) -> str:
    return (
        f"sensor {spec.name!r} is a {spec.type}, but format {', '.join(wanted)} is for depth cameras only; "
        f"expected ply, npz or another as well"
    )
