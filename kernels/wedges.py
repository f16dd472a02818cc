"""Beams behind rotating wedges, reading after reading.

The formula is that of rigcast.sensors.specs.rosette, in the same order, so that directions have the same bits. Samples
of a line go together, LANES at once, which the compiler turns into vector instructions.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

from .cast import tile_after
from .launch import TURN, prepare_over_tiles
from .packets.packet import LANES, double_lanes
from .turns import turn_of

Doubles = npt.NDArray[np.float64]

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})


@wp.struct
class Wedges:
    """Wedges in the order in which the light meets them, the beams before them, and those behind them."""

    lines: wp.array[wp.vec3d]
    rise: wp.array[wp.float64]  # (wedges,) n^2 - 1 of the refractive index n
    tilted_first: wp.array[wp.bool]
    # the tilted faces' normals, of which x stays:
    x: wp.array[wp.float64]  # (wedges,)
    y: wp.array2d[double_lanes]  # (wedges, blocks)
    z: wp.array2d[double_lanes]
    # out:
    directions: wp.array2d[wp.vec3d]  # (samples, lines)


@wp.func
def bend_line(wedges: Wedges, line: int, block: int) -> None:
    """Of LANES samples, or those that there are."""
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
    for i in range(wp.min(LANES, wedges.directions.shape[0] - begin)):
        wedges.directions[begin + i, line] = wp.vec3d(x[i], y[i], z[i])


@wp.kernel
def bend_blocks(_thread: int, turns: wp.array[int], wedges: Wedges) -> None:
    """Blocks of LANES samples of all lines that no other thread takes. turns: how many were taken."""
    block = turn_of(turns) * TURN
    while block * LANES < wedges.directions.shape[0]:
        for line in range(wedges.lines.shape[0]):
            bend_line(wedges, line, block)
        block = tile_after(block, turns)


class Bending:
    """Beams of several lines through wedges, at so many samples.

    lines: (lines, 3) unit, before the wedges. index: (wedges,) their refractive indices. tilted_first: (wedges,)
    whether the light meets the tilted face before the one square to x.
    """

    def __init__(self, lines: Doubles, index: Doubles, tilted_first: npt.NDArray[np.bool_], samples: int) -> None:
        self._shape = samples, len(lines)
        blocks = -(-samples // LANES)
        self._wedges = wedges = Wedges()
        wedges.lines = wp.array(lines, dtype=wp.vec3d, device="cpu")
        wedges.rise = wp.array(index**2 - 1.0, dtype=wp.float64, device="cpu")
        wedges.tilted_first = wp.array(tilted_first, dtype=wp.bool, device="cpu")
        wedges.x = wp.zeros(len(index), dtype=wp.float64, device="cpu")
        wedges.y = wp.zeros((len(index), blocks), dtype=double_lanes, device="cpu")
        wedges.z = wp.zeros((len(index), blocks), dtype=double_lanes, device="cpu")
        # where normals are written: one after the other, without a block's end
        self._x = wedges.x.numpy()
        self._y, self._z = (a.numpy().reshape(len(index), -1)[:, :samples] for a in (wedges.y, wedges.z))
        self._launch = prepare_over_tiles(bend_blocks, blocks, lambda _: [wedges])

    def directions(self, normals: Sequence[tuple[float, Doubles, Doubles]]) -> Doubles:
        """(samples, lines, 3) unit: where the light goes on. normals: x, y (samples,) and z of each tilted face."""
        for k, normal in enumerate(normals):
            self._x[k], self._y[k], self._z[k] = normal
        self._wedges.directions = directions = wp.empty(self._shape, dtype=wp.vec3d, device="cpu")
        self._launch()
        return directions.numpy()
