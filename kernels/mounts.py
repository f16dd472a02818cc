"""The poses of frames that are fixed to others, in many worlds at once.

A frame at offset (t, Q) in a carrier with pose (p, R) has the pose (p + R t, R Q). Aligned to yaw, it is turned about z
only, by the heading of its x axis.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@dataclass(frozen=True)
class Carriers:
    """Frames in many worlds, on one device: position (nworld, n) vec3 or vec3d [m], rotation (nworld, n) mat33 or mat33d.

    The first axis may have one entry instead, which holds in all worlds.
    """

    position: wp.array
    rotation: wp.array


@wp.func
def upright(rotation: wp.mat33d) -> wp.mat33d:
    """Turned about z only, by the heading of the x axis; not at all where that is vertical."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    x = rotation[0, 0]
    y = rotation[1, 0]
    length = wp.sqrt(x * x + y * y)
    cosine = one
    sine = zero
    if length != zero:
        cosine = x / length
        sine = y / length
    return wp.mat33d(cosine, -sine, zero, sine, cosine, zero, zero, zero, one)


@wp.kernel
def place_on_carrier(
    # carriers:
    position: wp.array2d[Any],
    rotation: wp.array2d[Any],
    which: int,
    # the frame on it:
    offset: wp.vec3d,
    turn: wp.mat33d,
    yaw_aligned: bool,
    # out, one per world:
    placed_position: wp.array[wp.vec3d],
    placed_rotation: wp.array[wp.mat33d],
) -> None:
    w = wp.tid()
    p = position[w % position.shape[0], which]
    m = rotation[w % rotation.shape[0], which]
    r = wp.mat33d()
    for row in range(3):
        for column in range(3):
            r[row, column] = wp.float64(m[row, column])
    placed_position[w] = r * offset + wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))
    # column by column: the product of two matrices rounds otherwise
    own = wp.matrix_from_cols(
        r * wp.vec3d(turn[0, 0], turn[1, 0], turn[2, 0]),
        r * wp.vec3d(turn[0, 1], turn[1, 1], turn[2, 1]),
        r * wp.vec3d(turn[0, 2], turn[1, 2], turn[2, 2]),
    )
    if yaw_aligned:
        own = upright(own)
    placed_rotation[w] = own


for _vector, _matrix in ((wp.vec3, wp.mat33), (wp.vec3d, wp.mat33d)):
    wp.overload(place_on_carrier, {"position": wp.array2d[_vector], "rotation": wp.array2d[_matrix]})


def place_on(
    carriers: Carriers,
    which: int,
    offset: npt.NDArray[np.float64],
    worlds: int,
    *,
    yaw_aligned: bool = False,
) -> tuple[wp.array, wp.array]:
    """Positions (worlds,) vec3d [m] and rotations (worlds,) mat33d of a frame at `offset` (4, 4) in carrier `which`."""
    device = carriers.position.device
    position = wp.empty(worlds, dtype=wp.vec3d, device=device)
    rotation = wp.empty(worlds, dtype=wp.mat33d, device=device)
    frame = [which, wp.vec3d(*offset[:3, 3]), wp.mat33d(*offset[:3, :3].flatten()), yaw_aligned]
    inputs = [carriers.position, carriers.rotation, *frame]
    wp.launch(place_on_carrier, worlds, inputs=inputs, outputs=[position, rotation], device=device)
    return position, rotation
