"""Beams refracted by rotating wedges, and their packets, reading after reading.

The formula is in rigcast.sensors.specs.lidars.rosette. LANES samples of a line are computed together, which the
compiler turns into vector instructions. Wedges turn at a constant rate, so the sines and cosines of all samples follow
from those of a few:

    cos(a + b) = cos a cos b - sin a sin b      sin(a + b) = sin a cos b + cos a sin b
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.kernels.host.held import Held
from rigcast.kernels.launching.slices import TURN, OverTiles
from rigcast.kernels.launching.turns import turn_of
from rigcast.kernels.packets.packet import LANES, TILE, Tile, double_lanes
from rigcast.kernels.rays.coherent import Packets

from .in_order import Packing, PackingInOrder, by_number, pack_tile

Doubles = npt.NDArray[np.float64]

_MOST = 4
"""Readings whose arrays are kept: for frames that users hold, for the one being made, and spare ones."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@dataclass(frozen=True)
class TurningWedge:
    """A wedge that turns by `step` [rad] about x from one sample to the next.

    tilt: angle of its tilted face [rad]. index: refractive index. tilted_first: whether the light meets the tilted face
    before the one square to x.
    """

    tilt: float
    index: float
    tilted_first: bool
    step: float


@wp.struct
class Wedges:
    """Wedges in the order in which light meets them, and the beams before them. Arrays but `lines` are (wedges,)."""

    samples: int
    lines: wp.array[wp.vec3d]  # (lines,) unit directions of the beams before the wedges
    rise: wp.array[wp.float64]  # n^2 - 1 of the refractive index n
    tilted_first: wp.array[wp.bool]
    # the tilted faces' normals, of which x is constant and y, z rotate:
    x: wp.array[wp.float64]
    aside: wp.array[wp.float64]  # length of (y, z)
    turned: wp.array[wp.float64]  # [rad], from y to z, at the first sample
    step: wp.array[wp.float64]  # [rad], from one sample to the next
    cosine: wp.array[double_lanes]  # of the rotation from the first sample of a block to each
    sine: wp.array[double_lanes]
    # scratch:
    y: wp.array2d[double_lanes]  # (wedges, blocks)
    z: wp.array2d[double_lanes]


@wp.func
def lean(wedges: Wedges, k: int, block: int) -> None:
    """Compute the normal of wedge k's tilted face at each sample of a block."""
    turned = wedges.turned[k] + wp.float64(block * LANES) * wedges.step[k]
    along_y = wedges.aside[k] * wp.cos(turned)
    along_z = wedges.aside[k] * wp.sin(turned)
    cosine = wedges.cosine[k]
    sine = wedges.sine[k]
    y = double_lanes()
    z = double_lanes()
    for i in range(LANES):
        y[i] = along_y * cosine[i] - along_z * sine[i]
        z[i] = along_z * cosine[i] + along_y * sine[i]
    wedges.y[k, block] = y
    wedges.z[k, block] = z


# no return type here: Warp 1.12 takes `-> None` for the type of a value
@wp.func_native("""
    for (int i = 0; i < count; ++i) directions.data[(begin + i) * lines + line] = wp::vec3d(x[i], y[i], z[i]);
""")
def write_line(  # type: ignore[no-untyped-def]
    directions: wp.array[wp.vec3d],
    begin: int,
    count: int,
    lines: int,
    line: int,
    x: double_lanes,
    y: double_lanes,
    z: double_lanes,
):
    """Write `count` samples of a line from sample `begin` on. Native: Warp checks every index for < 0."""


@wp.func
def bend_line(wedges: Wedges, line: int, block: int, directions: wp.array[wp.vec3d]) -> None:
    """Refract a line's beam at the samples of a block; writes directions (samples * lines,), unit."""
    start = wedges.lines[line]
    x = double_lanes()
    y = double_lanes()
    z = double_lanes()
    for i in range(LANES):
        x[i] = start[0]
        y[i] = start[1]
        z[i] = start[2]
    for k in range(wedges.rise.shape[0]):
        rise = wedges.rise[k]
        normal_x = wedges.x[k]
        is_tilted = wedges.tilted_first[k]
        if not is_tilted:
            for i in range(LANES):
                x[i] = wp.sqrt(x[i] * x[i] + rise)
        change = wp.where(is_tilted, rise, -rise)
        normal_y = wedges.y[k, block]
        normal_z = wedges.z[k, block]
        for i in range(LANES):
            along = x[i] * normal_x + y[i] * normal_y[i] + z[i] * normal_z[i]
            turn = wp.sqrt(along * along + change) - along
            x[i] = x[i] + turn * normal_x
            y[i] = y[i] + turn * normal_y[i]
            z[i] = z[i] + turn * normal_z[i]
        if is_tilted:
            for i in range(LANES):
                x[i] = wp.sqrt(x[i] * x[i] - rise)
    begin = block * LANES
    write_line(directions, begin, wp.min(LANES, wedges.samples - begin), wedges.lines.shape[0], line, x, y, z)


@wp.kernel
def bend_and_pack(_thread: int, turns: wp.array[int], wedges: Wedges, these: Packing) -> None:
    """Compute blocks of LANES samples, TURN per turn, and pack the tiles that their rays fill.

    Each thread claims turns. turns: number claimed so far.
    """
    blocks = (wedges.samples + LANES - 1) / LANES
    tiles = TURN * LANES * wedges.lines.shape[0] / TILE  # exact
    turn = turn_of(turns)
    while turn * TURN < blocks:
        for block in range(turn * TURN, wp.min((turn + 1) * TURN, blocks)):
            for k in range(wedges.rise.shape[0]):
                lean(wedges, k, block)
            for line in range(wedges.lines.shape[0]):
                bend_line(wedges, line, block, these.directions)
        for t in range(turn * tiles, wp.min((turn + 1) * tiles, these.tiles.shape[0])):
            pack_tile(these, t)
        turn = turn_of(turns)


class Bending:
    """Beams of several lines through rotating wedges.

    lines: (lines, 3) unit directions before the wedges. wedges: in the order in which light meets them. samples: number
    of directions per line in a reading.
    """

    def __init__(self, lines: Doubles, wedges: Sequence[TurningWedge], samples: int) -> None:
        self._shape = samples, len(lines), 3
        tilt, index, step = (
            np.array(values) for values in zip(*((w.tilt, w.index, w.step) for w in wedges), strict=True)
        )
        turned, blocks = np.arange(LANES) * step[:, None], -(-samples // LANES)
        self._wedges = these = Wedges()
        these.samples = samples
        these.lines = wp.array(lines, dtype=wp.vec3d, device="cpu")
        these.tilted_first = wp.array([w.tilted_first for w in wedges], dtype=wp.bool, device="cpu")
        these.rise, these.x, these.aside = map(_doubles, (index**2 - 1.0, np.cos(tilt), np.sin(tilt)))
        these.turned, these.step = map(_doubles, (np.zeros(len(wedges)), step))
        these.cosine, these.sine = (
            wp.array(a, dtype=double_lanes, device="cpu") for a in (np.cos(turned), np.sin(turned))
        )
        these.y, these.z = (wp.empty((len(wedges), blocks), dtype=double_lanes, device="cpu") for _ in range(2))
        self._turned = these.turned.numpy()
        self._readings: deque[_Reading] = deque(maxlen=_MOST)

    def reading(self, turned: Sequence[float], in_packets: bool) -> tuple[Doubles, Packets | None]:
        """Unit directions (samples, lines, 3) behind the wedges, and their packets, None if not in_packets.

        A later reading overwrites these arrays once nobody holds any of them. turned: angle of each wedge at the first
        sample [rad]; at 0 its tilted face leans to +y.
        """
        self._turned[:] = turned
        reading = self._take(in_packets)
        reading.launch()
        return reading.directions, reading.packing.end() if in_packets else None

    def _take(self, in_packets: bool) -> "_Reading":
        """The latest reading whose arrays nobody holds, or a new one."""
        for reading in reversed(self._readings):
            if reading.in_packets == in_packets and not reading.held.by_others:
                return reading
        reading = _Reading(self._wedges, self._shape, in_packets)
        reading.held.settle()
        self._readings.append(reading)
        return reading


class _Reading:
    """The arrays of one reading (directions of this shape, and their packets), and the launch that writes them."""

    def __init__(self, wedges: Wedges, shape: tuple[int, int, int], in_packets: bool) -> None:
        samples, lines, _ = shape
        self.in_packets, self.directions = in_packets, np.empty(shape)
        self.packing = PackingInOrder(*by_number(samples * lines, lines))
        self.packing.begin(wp.array(self.directions.reshape(-1, 3), dtype=wp.vec3d, device="cpu", copy=False))
        these = self.packing.these
        if not in_packets:
            these.tiles = wp.empty(0, dtype=Tile, device="cpu")
        self.held = Held(self.directions, these.tiles, these.packets)
        self.launch = OverTiles(bend_and_pack, -(-samples // LANES), lambda _: [wedges, these])


def _doubles(values: Doubles) -> wp.array:
    return wp.array(values, dtype=wp.float64, device="cpu")
