"""Points of frames, drawn in MuJoCo's viewer."""

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from numbers import Real
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError, require_type, require_whole
from rigcast.sensors.preview.colour import Scale
from rigcast.sensors.rig.frame import Frame, as_frames


def overlay(viewer: Any, frames: Frame | Iterable[Frame], *, size: float = 0.01, most: int = 5000) -> int:
    """Draw the points of one or several frames in a MuJoCo viewer, coloured by range; near is warm.

    In a viewer it replaces all of `viewer.user_scn`, so you can call it after every `rig.step`; without frames it
    clears the points. Call `viewer.sync()` to see the result. To an `MjvScene` it adds the points.

    Args:
        viewer: of `mujoco.viewer.launch_passive`, or your own `MjvScene`.
        frames: one Frame or several, each of one world.
        size: half the edge of the box drawn for a point [m].
        most: largest number of points; of more, only every second, third, ... is drawn, as MuJoCo draws them one by
            one.

    Returns:
        How many points were drawn, at most as many as the scene has room for.

    Raises:
        InputError: something that is not a viewer or not a Frame, frames of many worlds, a size that is not positive,
            or a `most` that is not a whole number from 0 on.

    >>> with mujoco.viewer.launch_passive(model, data) as viewer:
    ...     rigcast.overlay(viewer, rig.sense(data).values())
    ...     viewer.sync()
    """
    require_type("overlay: size", size, Real)
    require_whole("overlay: most", most, 0)
    if not 0 < size < np.inf:
        raise InputError(f"overlay: size: got {size}, expected a positive number of metres")
    listed = as_frames("overlay: frames", [frames] if isinstance(frames, Frame) else frames)
    for frame in listed:
        frame.require_one_world()
    points, colours = _cloud(listed)
    scene, lock = _scene_of(viewer)
    with lock:
        if scene is not viewer:
            scene.ngeom = 0
        room = min(most, scene.maxgeom - scene.ngeom)
        chosen = slice(None, None, max(1, -(-len(points) // max(room, 1))))
        return _add_boxes(scene, points[chosen][:room], colours[chosen], size)


def _scene_of(viewer: Any) -> tuple[mujoco.MjvScene, AbstractContextManager[Any]]:
    if isinstance(viewer, mujoco.MjvScene):
        return viewer, nullcontext()
    scene = getattr(viewer, "user_scn", None)
    if not isinstance(scene, mujoco.MjvScene):
        expected = "expected the viewer of mujoco.viewer.launch_passive, or an MjvScene"
        raise InputError(f"overlay: viewer: got {type(viewer).__name__} without a scene of its own, {expected}")
    return scene, viewer.lock()


def _cloud(frames: list[Frame]) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Points (n, 3) [m] in the world and their colours (n, 4) from 0 to 1, in one scale for all frames."""
    points = np.concatenate([np.empty((0, 3)), *(frame.points_world.numpy().reshape(-1, 3) for frame in frames)])
    ranges = np.concatenate([np.empty(0, np.float32), *(frame.range.numpy().ravel() for frame in frames)])
    hit = np.isfinite(ranges)
    rgba = np.ones((int(hit.sum()), 4), np.float32)
    if hit.any():
        rgba[:, :3] = Scale.of(ranges, reverse=True).colours(ranges[hit]) / 255
    return points[hit], rgba


def _add_boxes(scene: mujoco.MjvScene, points: NDArray[np.float64], colours: NDArray[np.float32], size: float) -> int:
    half, upright = np.full(3, size), np.eye(3).ravel()
    for point, rgba in zip(points, colours[: len(points)], strict=True):
        mujoco.mjv_initGeom(scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_BOX, half, point, upright, rgba)
        scene.ngeom += 1
    return len(points)
