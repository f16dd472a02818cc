"""Poses read from MuJoCo's arrays on the host: of bodies, geoms and so on, and of frames mounted on them.

Everything runs on the CPU, in one launch where numpy would take a dozen steps.
"""

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.launching.recorded import recorded
from rigcast.kernels.poses.mounts import ALIGNMENTS, aligned, turned_by
from rigcast.kernels.poses.scope import is_within_reach

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Doubles = npt.NDArray[np.float64]


@wp.struct
class Taking:
    """The addresses of positions (n, 3) and rotations (n, 9), float64, and the arrays to copy them to."""

    from_position: wp.uint64
    from_rotation: wp.uint64
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]
    lost: wp.array[int]


@wp.func
def size_of(m: wp.mat33d) -> wp.float64:
    """The sum of all |elements|; finite if and only if all are."""
    size = wp.float64(0.0)
    for row in range(3):
        for column in range(3):
            size += wp.abs(m[row, column])
    return size


@wp.kernel
def take_poses(these: Taking) -> None:
    """Copy poses. Positions of those that are not finite, or beyond FARTHEST, become NaN; `lost` counts these."""
    count = these.position.shape[0]
    positions = wp.array(ptr=these.from_position, shape=(count,), dtype=wp.vec3d)
    rotations = wp.array(ptr=these.from_rotation, shape=(count,), dtype=wp.mat33d)
    lost = int(0)
    for k in range(count):
        position = positions[k]
        rotation = rotations[k]
        if not (is_within_reach(position) and size_of(rotation) < wp.float64(wp.inf)):
            position = wp.vec3d(wp.float64(wp.nan))
            lost += 1
        these.position[k] = position
        these.rotation[k] = rotation
    these.lost[0] = lost


class TakenPoses:
    """The poses of n objects at the last `take`: `position` (n,) vec3d [m] and `rotation` (n,) mat33d, on the CPU.

    The position is NaN where the pose is not finite, or beyond FARTHEST.
    """

    def __init__(self, count: int) -> None:
        self.position = wp.empty(count, dtype=wp.vec3d, device="cpu")
        self.rotation = wp.empty(count, dtype=wp.mat33d, device="cpu")
        lost = wp.zeros(1, dtype=int, device="cpu")
        self._count_lost = lost.numpy().item
        self._these = Taking()
        self._these.position, self._these.rotation, self._these.lost = self.position, self.rotation, lost
        self._from: tuple[Doubles | None, Doubles | None] = (None, None)
        self._take = recorded(take_poses, 1, [self._these], [], "cpu")

    def take(self, position: Doubles, rotation: Doubles) -> int:
        """Copy positions (n, 3) [m] and rotations (n, 9), both contiguous; return the number of poses set to NaN."""
        if position is not self._from[0] or rotation is not self._from[1]:
            self._these.from_position, self._these.from_rotation = position.ctypes.data, rotation.ctypes.data
            self._from = position, rotation
        self._take()
        return self._count_lost()


@wp.struct
class Placing:
    """A frame mounted on a carrier, as in rigcast.kernels.poses.mounts, and the arrays for its pose in the world."""

    from_position: wp.uint64  # address of the carrier's position, float64; 0 for the world
    from_rotation: wp.uint64  # address of its rotation
    offset: wp.vec3d
    turn: wp.mat33d
    alignment: int  # the number of one of ALIGNMENTS
    # out:
    pose: wp.array[wp.mat44d]
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]


@wp.kernel
def place_frame(frame: Placing) -> None:
    """Compute the frame's pose in the world; see rigcast.kernels.poses.mounts."""
    position = frame.offset
    rotation = frame.turn
    if frame.from_position != wp.uint64(0):
        carrier_position = wp.array(ptr=frame.from_position, shape=(1,), dtype=wp.vec3d)
        carrier_rotation = wp.array(ptr=frame.from_rotation, shape=(1,), dtype=wp.mat33d)
        position = carrier_rotation[0] * frame.offset + carrier_position[0]
        rotation = turned_by(carrier_rotation[0], frame.turn)
    rotation = aligned(rotation, frame.alignment)
    pose = wp.identity(n=4, dtype=wp.float64)
    for row in range(3):
        for column in range(3):
            pose[row, column] = rotation[row, column]
        pose[row, 3] = position[row]
    frame.pose[0] = pose
    frame.position[0] = position
    frame.rotation[0] = rotation


class PlacedFrame:
    """A frame mounted on a carrier or in the world; its pose is `position` (1,) vec3d [m] and `rotation` (1,) mat33d on
    a device.

    which: index of the carrier among those of its kind. offset: (4, 4), the frame's pose in the carrier's frame.
    alignment: one of ALIGNMENTS.
    """

    def __init__(self, which: int, offset: Doubles, alignment: str, device: wp.Device) -> None:
        frame = Placing()
        frame.offset, frame.turn = wp.vec3d(offset[:3, 3]), wp.mat33d(offset[:3, :3])
        frame.alignment = ALIGNMENTS.index(alignment)
        frame.position, frame.rotation = (wp.empty(1, dtype=dtype, device="cpu") for dtype in (wp.vec3d, wp.mat33d))
        frame.pose = wp.empty(1, dtype=wp.mat44d, device="cpu")
        self._frame, self._pose, self._which = frame, frame.pose.numpy()[0], which
        self._from: tuple[Doubles | None, Doubles | None] = (None, None)
        self._place = recorded(place_frame, 1, [frame], [], "cpu")
        self._on_cpu = device.is_cpu
        self.position = frame.position if self._on_cpu else wp.empty_like(frame.position, device=device)
        self.rotation = frame.rotation if self._on_cpu else wp.empty_like(frame.rotation, device=device)

    def place(self, position: Doubles | None, rotation: Doubles | None) -> Doubles:
        """Update the frame's pose in the world and return it, (4, 4).

        position, rotation: of all carriers of its kind, contiguous (n, 3) [m] and (n, 9); None for the world.
        """
        if position is not self._from[0] or rotation is not self._from[1]:
            self._frame.from_position = 0 if position is None else position[self._which].ctypes.data
            self._frame.from_rotation = 0 if rotation is None else rotation[self._which].ctypes.data
            self._from = position, rotation
        self._place()
        if not self._on_cpu:
            wp.copy(self.position, self._frame.position)
            wp.copy(self.rotation, self._frame.rotation)
        return self._pose.copy()
