"""Rays on a device, at the pose of a frame or in many worlds."""

from dataclasses import replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.rays.arrays import Rays
from rigcast.sensors.errors import InputError

from .given import GivenRays, lend, upload


def rays_in_frame(
    directions: NDArray[np.float64], origins: NDArray[np.float64], pose: NDArray[np.float64], device: wp.Device
) -> Rays:
    """Rays on the device with unit directions (..., 3) and origins (..., 3) or (3,) in a frame with this pose (4, 4).

    On the CPU directions and origins are used where they are.
    """
    return in_pose(Rays(lend(directions, device), lend(origins, device), position=None, rotation=None), pose)


def in_pose(rays: Rays, pose: NDArray[np.float64]) -> Rays:
    """The rays with another pose (4, 4) of their frame."""
    device = rays.directions.device
    rotation = wp.array(pose[None, :3, :3], dtype=wp.mat33d, device=device)
    return replace(rays, position=upload(pose[:3, 3], device), rotation=rotation)


def world_frame(device: wp.Device) -> Rays:
    """Empty rays in the world's frame; cached, because making them takes as long as casting hundreds of rays."""
    nothing = np.empty((0, 3))
    return rays_in_frame(nothing, nothing, np.eye(4), device)


def in_world(given: GivenRays, frame: Rays) -> Rays:
    """The given rays in `world_frame`."""
    return replace(frame, directions=given.directions, origins=given.origins, vectors=given.vectors)


def in_worlds(given: GivenRays, worlds: int) -> Rays:
    """The given rays in many worlds, by their first axis. Raises InputError if its length is not `worlds`."""
    if given.shape[:1] != (worlds,):
        raise InputError(f"Scene.cast: directions: got shape {(*given.shape, 3)}, expected ({worlds}, ..., 3)")
    each, device = (worlds, -1), given.directions.device
    return Rays(
        given.directions.reshape(each),
        given.origins if given.origins.size == 1 else given.origins.reshape(each),
        position=wp.zeros(worlds, dtype=wp.vec3d, device=device),
        rotation=wp.full(worlds, wp.mat33d(np.eye(3)), dtype=wp.mat33d, device=device),
        worlds=worlds,
        vectors=given.vectors,
    )
