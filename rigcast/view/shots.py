"""Shots: the data of a reading that a view shows, from a new frame or from files."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.preview.camera import Shown, depth_or_range
from rigcast.sensors.rig.frame import CameraFrame, Frame
from rigcast.sensors.specs.cameras.depth_camera import pixel_rays
from rigcast.sensors.specs.lens import Lens

VALUES = ("range", "intensity", "ring", "geom_id")  # fields by which points can be coloured


@dataclass(frozen=True, eq=False)
class Shot:
    """One reading of one sensor.

    pose: (4, 4) float64, sensor in world. points: (n, 3) float32 [m] in the sensor's frame, of the n rays with a
    finite range. values: (n,) each, by name, some of VALUES. image: (height, width) float32 [m] of a camera, its
    z-depths, or the ranges if it sees behind itself, as `shows` says; else None. size: the camera's (width, height),
    which has more pixels than the image where that is `thinned`. intrinsics: (3, 3) float64 [pixels] of a camera whose
    image is of z-depths, else None.
    """

    sensor: str
    time: float
    pose: NDArray[np.float64]
    points: NDArray[np.float32]
    values: Mapping[str, NDArray[Any]]
    image: NDArray[np.float32] | None = None
    shows: Shown = "depth"
    intrinsics: NDArray[np.float64] | None = None
    size: tuple[int, int] | None = None

    @classmethod
    def of(cls, sensor: str, time: float, pose: NDArray[np.float64], arrays: Mapping[str, Any]) -> "Shot":
        """The shot of arrays by name, one entry per ray: points, any of VALUES, a camera's depth, range and
        intrinsics."""
        points = arrays["points"].reshape(-1, 3)
        hit = np.isfinite(points).all(axis=1)
        values = {name: arrays[name].reshape(-1)[hit] for name in VALUES if name in arrays}
        if "depth" not in arrays:
            return cls(sensor, time, pose, points[hit], values)
        image, shows = depth_or_range(arrays["depth"], arrays["range"])
        intrinsics, size = (arrays.get("intrinsics") if shows == "depth" else None), image.shape[::-1]
        return cls(sensor, time, pose, points[hit], values, image, shows, intrinsics, size)

    def thinned(self, most: int, widest: int) -> "Shot":
        """The same with every second, third, ... of its points, so that they are no more than `most`, and likewise of
        its pixels, in rows of `widest` to less than twice as many."""
        step = max(1, -(-len(self.points) // most))
        pixel = 1 if self.image is None else max(1, self.image.shape[1] // widest)
        if step == pixel == 1:
            return self
        values = {name: own[::step].copy() for name, own in self.values.items()}
        image = None if self.image is None else self.image[::pixel, ::pixel].copy()
        return replace(self, points=self.points[::step].copy(), values=values, image=image)

    @property
    def points_world(self) -> NDArray[np.float64]:
        """(n, 3) float64 [m]."""
        return self.points @ self.pose[:3, :3].T + self.pose[:3, 3]


def shot_of(frame: Frame) -> Shot:
    """The shot of a frame of one world."""
    fields = {name: getattr(frame, name, None) for name in ("points", *VALUES)}
    arrays = {name: field.numpy() for name, field in fields.items() if field is not None}
    if isinstance(frame, CameraFrame):
        arrays |= {"depth": frame.depth.numpy(), "intrinsics": frame.intrinsics}
    return Shot.of(frame.sensor, frame.time, frame.pose, arrays)


def arrays_of_image(
    depth: NDArray[np.float32], intrinsics: NDArray[np.float64], lens: Lens | None
) -> dict[str, NDArray[Any]]:
    """Points and ranges of a z-depth image (height, width) [m], beside the image itself."""
    height, width = depth.shape
    rays = pixel_rays(intrinsics, lens, width, height, subrays=1)[..., 0, :]
    with np.errstate(invalid="ignore"):  # infinite depth times 0
        distance = depth / rays[..., 2]
        points = (rays * distance[..., None]).astype(np.float32)
    return {"points": points, "range": distance.astype(np.float32), "depth": depth, "intrinsics": intrinsics}


def sensors_in(shots: Iterable[Shot]) -> list[str]:
    """The names of the sensors that these are of."""
    return list(dict.fromkeys(shot.sensor for shot in shots))


def values_in(shots: Iterable[Shot]) -> list[str]:
    """Which of VALUES any of these has."""
    there = set[str]().union(*(shot.values for shot in shots))
    return [name for name in VALUES if name in there]


class Share:
    """Selects every n-th of each sensor's shots, beginning with the first: at most `most` of all, or one of each.

    counts: number of shots by sensor. most: None for all.
    """

    def __init__(self, counts: Sequence[int], most: int | None) -> None:
        enough = sum(counts) if most is None else max(most, len(counts))
        self._step = next(step for step in count(1) if sum(-(-n // step) for n in counts) <= enough)
        self._seen = Counter[str]()

    def takes(self, sensor: str) -> bool:
        """Whether the next shot of a sensor is one of them."""
        self._seen[sensor] += 1
        return (self._seen[sensor] - 1) % self._step == 0
