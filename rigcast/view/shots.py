"""What a view shows of a reading, be it just taken or read from the folder that a run has left."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import trimesh
from numpy.typing import NDArray

from rigcast.export.recorder import INDEX_NAME
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.frame import CameraFrame, Frame

VALUES = ("range", "intensity", "ring", "geom_id")  # by which points can be coloured
_READABLE = ("npz", "exr", "ply")


@dataclass(frozen=True, eq=False)
class Shot:
    """One reading of one sensor.

    pose: (4, 4) float64, sensor in world. points: (n, 3) float32 [m] in the sensor's frame, of the n rays with a
    finite range. values: (n,) each, by name, some of VALUES. depth: (height, width) float32 [m] of a camera, else None,
    as is intrinsics, (3, 3) float64 [pixels].
    """

    sensor: str
    time: float
    pose: NDArray[np.float64]
    points: NDArray[np.float32]
    values: Mapping[str, NDArray[Any]]
    depth: NDArray[np.float32] | None = None
    intrinsics: NDArray[np.float64] | None = None

    @property
    def points_world(self) -> NDArray[np.float64]:
        """(n, 3) float64 [m]."""
        return self.points @ self.pose[:3, :3].T + self.pose[:3, 3]


def shot_of(frame: Frame) -> Shot:
    """What is shown of a frame of one world."""
    arrays = {name: getattr(frame, name).numpy() for name in ("points", *VALUES) if hasattr(frame, name)}
    if isinstance(frame, CameraFrame):
        arrays |= {"depth": frame.depth.numpy(), "intrinsics": frame.intrinsics}
    return _shot(frame.sensor, frame.time, frame.pose, arrays)


def read_run(folder: Path) -> Iterator[Shot]:
    """The readings that `rigcast run` has written to a folder as npz, exr or ply, in the order of their times.

    Raises InputError for a folder without frames.npz, or without a frame in one of these formats.
    """
    try:
        with np.load(folder / INDEX_NAME) as archive:
            index = {name: archive[name] for name in archive.files}
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{folder / INDEX_NAME}: cannot be read: {reason}; expected a folder of rigcast run") from None
    columns = [index[name] for name in _READABLE if name in index]
    files = [next((column[i] for column in columns if column[i]), "") for i in range(len(index["sensor"]))]
    if not any(files):
        raise InputError(f"{folder}: no frame in any of {', '.join(_READABLE)}, of which a view is made")
    for i in np.argsort(index["time"], kind="stable"):
        if files[i]:
            arrays = _read(folder / files[i])
            yield _shot(str(index["sensor"][i]), float(index["time"][i]), index["pose"][i], arrays)


def _shot(sensor: str, time: float, pose: NDArray[np.float64], arrays: Mapping[str, Any]) -> Shot:
    points = arrays["points"].reshape(-1, 3)
    hit = np.isfinite(points).all(axis=1)
    values = {name: arrays[name].reshape(-1)[hit] for name in VALUES if name in arrays}
    return Shot(sensor, time, pose, points[hit], values, arrays.get("depth"), arrays.get("intrinsics"))


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.suffix == ".npz":
            with np.load(path) as archive:
                return {name: archive[name] for name in archive.files}
        return _read_exr(path) if path.suffix == ".exr" else _read_ply(path)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error


def _read_exr(path: Path) -> dict[str, Any]:
    image = OpenEXR.File(str(path), separate_channels=True)
    channels = {name: channel.pixels for name, channel in image.channels().items()}
    depth, intrinsics = channels["Z"], image.header()["intrinsics"]
    # Pixel (u, v) looks along ((u + 0.5 - cx) / fx, (v + 0.5 - cy) / fy, 1), and depth is along z.
    v, u = np.indices(depth.shape) + 0.5
    across, down = (u - intrinsics[0, 2]) / intrinsics[0, 0], (v - intrinsics[1, 2]) / intrinsics[1, 1]
    with np.errstate(invalid="ignore"):  # 0 x inf in the centre
        points = np.stack([across * depth, down * depth, depth], axis=-1).astype(np.float32)
    return {**channels, "points": points, "depth": depth, "intrinsics": intrinsics}


def _read_ply(path: Path) -> dict[str, Any]:
    cloud = trimesh.load(path, process=False)
    points = np.asarray(cloud.vertices, dtype=np.float32)
    rows = cloud.metadata["_ply_raw"]["vertex"]["data"]
    arrays = {name: np.asarray(rows[name]).reshape(-1) for name in VALUES if name in (rows.dtype.names or ())}
    return {"points": points, "range": np.linalg.norm(points, axis=-1), **arrays}
