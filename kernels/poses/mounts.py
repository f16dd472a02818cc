"""Poses of frames mounted on carriers (bodies, sites, cameras, the world), in many worlds at once.

A frame mounted with pose (t, Q) on a carrier with pose (p, R) has the pose (p + R t, A(R Q)) in the world. The
alignment A keeps the whole rotation ("base"), only the heading of the frame's x axis, which makes it a rotation about z
("yaw"), or nothing of it ("world").
"""

from collections.abc import Callable
from dataclasses import dataclass
from operator import is_
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.launch import launch
from rigcast.kernels.launching.recorded import recorded

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ALIGNMENTS = ("base", "yaw", "world")
"""Alignments of frames, by their numbers in kernels."""
_YAW, _WORLD = wp.constant(1), wp.constant(2)


@dataclass(frozen=True)
class Carriers:
    """Poses of n carriers in many worlds, on one device.

    position: (nworld, n) vec3 or vec3d [m]. rotation: (nworld, n) mat33 or mat33d; columns are the carrier's axes.
    The first axis may have size 1: the same poses in all worlds. So may the second: one carrier, whatever `which` says.
    """

    position: wp.array
    rotation: wp.array


@dataclass(frozen=True)
class Attachment:
    """The mounting of a frame: one for all worlds, arrays (1,), or one per world, (nworld,), on one device.

    which: int32, index of the carrier. offset: vec3d [m] and turn: mat33d, the frame's pose in the carrier's frame; the
    columns of turn are the frame's axes.
    """

    which: wp.array
    offset: wp.array
    turn: wp.array

    def of_worlds(self, part: slice) -> "Attachment":
        """The mountings in some of the worlds; needs one per world."""
        return Attachment(self.which[part], self.offset[part], self.turn[part])

    @staticmethod
    def of(which: npt.ArrayLike, offset: npt.NDArray[np.float64], device: wp.DeviceLike) -> "Attachment":
        """Make mountings from indices of carriers (n,) and poses in their frames (n, 4, 4)."""
        return Attachment(
            wp.array(which, dtype=int, device=device),
            wp.array(np.ascontiguousarray(offset[:, :3, 3]), dtype=wp.vec3d, device=device),
            wp.array(np.ascontiguousarray(offset[:, :3, :3]), dtype=wp.mat33d, device=device),
        )


@wp.func
def as_vec3d(v: Any) -> wp.vec3d:
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def as_mat33d(m: Any) -> wp.mat33d:
    out = wp.mat33d()
    for row in range(3):
        for column in range(3):
            out[row, column] = wp.float64(m[row, column])
    return out


@wp.func
def upright(rotation: wp.mat33d) -> wp.mat33d:
    """The rotation about z by the heading of the x axis; the identity if that axis is vertical."""
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


@wp.func
def aligned(rotation: wp.mat33d, alignment: int) -> wp.mat33d:
    """What an alignment, one of ALIGNMENTS by its number, keeps of a rotation."""
    if alignment == _YAW:
        return upright(rotation)
    if alignment == _WORLD:
        return wp.identity(n=3, dtype=wp.float64)
    return rotation


@wp.func
def turned_by(rotation: wp.mat33d, turn: wp.mat33d) -> wp.mat33d:
    """The product rotation * turn, column by column; a product of two matrices would round differently."""
    return wp.matrix_from_cols(
        rotation * wp.vec3d(turn[0, 0], turn[1, 0], turn[2, 0]),
        rotation * wp.vec3d(turn[0, 1], turn[1, 1], turn[2, 1]),
        rotation * wp.vec3d(turn[0, 2], turn[1, 2], turn[2, 2]),
    )


@wp.kernel
def place_on_carrier(
    # carriers:
    position: wp.array2d[Any],
    rotation: wp.array2d[Any],
    time: wp.array[Any],  # of each world; empty for 0
    # the frame on it, in all worlds or in each:
    which: wp.array[int],
    offset: wp.array[wp.vec3d],
    turns: wp.array[wp.mat33d],
    alignment: int,
    active: wp.array[wp.bool],  # empty for all
    # out, (worlds, frames):
    placed_position: wp.array2d[wp.vec3d],
    placed_rotation: wp.array2d[wp.mat33d],
    slot: int,
    # out, of each world; may be empty:
    poses: wp.array3d[wp.float64],
    times: wp.array[wp.float64],
) -> None:
    """Place frame `slot` of each world on its carrier; see Frames.place."""
    w = wp.tid()
    own = w % which.shape[0]
    carrier = which[own] % position.shape[1]
    r = as_mat33d(rotation[w % rotation.shape[0], carrier])
    place = r * offset[own] + as_vec3d(position[w % position.shape[0], carrier])
    # nested, as older versions of Warp evaluate the whole of an `and`
    if active.shape[0] > 0:  # noqa: SIM102
        if not active[w]:
            place = wp.vec3d(wp.float64(wp.nan), wp.float64(wp.nan), wp.float64(wp.nan))
    axes = aligned(turned_by(r, turns[own]), alignment)
    placed_position[w, slot] = place
    placed_rotation[w, slot] = axes
    if poses.shape[0] > 0:
        for row in range(3):
            for column in range(3):
                poses[w, row, column] = axes[row, column]
            poses[w, row, 3] = place[row]
            poses[w, 3, row] = wp.float64(0.0)
        poses[w, 3, 3] = wp.float64(1.0)
    if times.shape[0] > 0:
        times[w] = wp.float64(0.0)
        if time.shape[0] > 0:
            times[w] = wp.float64(time[w])


@wp.kernel
def copy_frames(
    position: wp.array2d[Any],
    rotation: wp.array2d[Any],
    # out:
    copied_position: wp.array2d[wp.vec3d],
    copied_rotation: wp.array2d[wp.mat33d],
) -> None:
    """Copy poses of carriers to float64."""
    w, k = wp.tid()
    copied_position[w, k] = as_vec3d(position[w, k])
    copied_rotation[w, k] = as_mat33d(rotation[w, k])


# All overloads are made here, so that the module is compiled once. Warp would look one up at every launch, which takes
# longer than the kernel.
_KINDS = ((wp.vec3, wp.mat33), (wp.vec3d, wp.mat33d))
_PLACE_ON_CARRIER = {
    (vector, number): wp.overload(
        place_on_carrier,
        {"position": wp.array2d[vector], "rotation": wp.array2d[matrix], "time": wp.array[number]},
    )
    for vector, matrix in _KINDS
    for number in (wp.float32, wp.float64)
}
_COPY_FRAMES = {
    vector: wp.overload(copy_frames, {"position": wp.array2d[vector], "rotation": wp.array2d[matrix]})
    for vector, matrix in _KINDS
}


BYTES_PER_FRAME = 96
"""Size of one frame of Frames."""


class Frames:
    """Poses of n frames in many worlds: position (nworld, n) vec3d [m], rotation (nworld, n) mat33d, columns axes.

    pose: (nworld, 4, 4) float64, the matrix of the frame placed last, frame to world; time: (nworld,) float64 [s]. Both
    are empty unless `with_matrix`.
    """

    def __init__(self, position: wp.array, rotation: wp.array, pose: wp.array, time: wp.array) -> None:
        self.position, self.rotation, self.pose, self.time = position, rotation, pose, time
        self._everywhere = wp.empty(0, dtype=wp.bool, device=position.device)
        self._no_time = wp.empty(0, dtype=wp.float64, device=position.device)
        # of each frame, its launch and what that was prepared for:
        self._prepared: dict[int, tuple[Callable[[], None], tuple[object, ...]]] = {}

    @staticmethod
    def empty(worlds: int, count: int, device: wp.DeviceLike, *, with_matrix: bool = False) -> "Frames":
        matrices = worlds if with_matrix else 0
        return Frames(
            wp.empty((worlds, count), dtype=wp.vec3d, device=device),
            wp.empty((worlds, count), dtype=wp.mat33d, device=device),
            wp.empty((matrices, 4, 4), dtype=wp.float64, device=device),
            wp.empty(matrices, dtype=wp.float64, device=device),
        )

    def of_worlds(self, part: slice) -> "Frames":
        """Views of the frames in some of the worlds."""
        return Frames(self.position[part], self.rotation[part], self.pose[part], self.time[part])

    def copy(self, carriers: Carriers) -> None:
        """Set the first frames of each world to the poses of the carriers, given for every world, in float64."""
        outputs = [self.position, self.rotation]
        inputs = [carriers.position, carriers.rotation]
        kernel = _COPY_FRAMES[carriers.position.dtype]
        launch(kernel, carriers.position.shape, inputs, outputs, self.position.device)

    def place(
        self,
        slot: int,
        carriers: Carriers,
        on: Attachment,
        *,
        alignment: str = "base",
        active: wp.array | None = None,
        time: wp.array | None = None,
    ) -> None:
        """Set frame `slot` of every world to its pose on its carrier, and `pose` and `time` if there are any.

        The launch is kept, and made again while the arrays stay the same.

        Args:
            slot: the frame.
            carriers: poses of the carriers, in the world.
            on: the frame's mounting on one of them.
            alignment: one of ALIGNMENTS.
            active: (nworld,) bool; in worlds where it is False the position is NaN. None: all are active.
            time: (nworld,) float32 or float64 [s]; None for 0.
        """
        given = carriers.position, carriers.rotation, time, on, alignment, active
        place, known = self._prepared.get(slot, (None, ()))
        if place is None or not all(map(is_, given, known)):
            when = self._no_time if time is None else time
            everywhere = self._everywhere if active is None else active
            kernel = _PLACE_ON_CARRIER[carriers.position.dtype, when.dtype]
            mounting = on.which, on.offset, on.turn, ALIGNMENTS.index(alignment)
            inputs = [carriers.position, carriers.rotation, when, *mounting, everywhere]
            outputs = [self.position, self.rotation, slot, self.pose, self.time]
            worlds, device = self.position.shape[0], self.position.device
            place = recorded(kernel, worlds, inputs, outputs, device)
            self._prepared[slot] = place, given
        place()


def origin(device: wp.DeviceLike) -> Carriers:
    """The world's frame as the only carrier; filled on the device, so that a CUDA graph can repeat it."""
    zero = wp.zeros((1, 1), dtype=wp.vec3d, device=device)
    return Carriers(zero, wp.full((1, 1), wp.mat33d(np.eye(3)), dtype=wp.mat33d, device=device))
