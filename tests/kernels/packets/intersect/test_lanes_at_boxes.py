"""Every box that a ray of a packet enters is entered, and hardly any other.

Within a mesh it may be let through where it is entered by the mirror images of rays of which some go either way.
"""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type,index"

import numpy as np
import pytest
import warp as wp
from made_worlds import random_rotations
from numpy.typing import NDArray

from rigcast.kernels.hits.hit import APART
from rigcast.kernels.packets.intersect.frustum import (
    LANE_ROUNDING,
    boxes_from,
    enter_frustum,
    frustum_of,
    packets_at_box,
)
from rigcast.kernels.packets.intersect.slabs import (
    enter_any,
    enter_lane_by_lane,
    lanes_at_box,
    margin_of_lanes,
    slabs_of,
    way_of,
)
from rigcast.kernels.packets.packet import ALL_LANES, LANES, PACKETS, Packet, PacketHits, Tile, Vectors, View, lanes
from rigcast.kernels.single.ray import box_margin
from rigcast.kernels.trees.nodes import Node, empty_node, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

Doubles = NDArray[np.float64]
CASES = 20_000


@wp.func
def _packets(view: View, p: lanes, q: lanes, far: float, center: wp.vec3, half: wp.vec3) -> int:
    """Bit mask of those of eight equal packets that enter a box."""
    tile = Tile()
    reach = vec8()
    tile.packets = wp.static(2**PACKETS - 1)
    for k in range(PACKETS):
        tile.p_low[k] = wp.min(p)
        tile.p_high[k] = wp.max(p)
        tile.q_low[k] = wp.min(q)
        tile.q_high[k] = wp.max(q)
        reach[k] = far
    return packets_at_box(view, tile, center, half, reach)


@wp.func
def _tile(view: View, p: lanes, q: lanes, far: float, node: Node) -> int:
    """Bit mask of the boxes of a node that a tile of these rays enters."""
    frustum = frustum_of(view, wp.min(p), wp.max(p), wp.min(q), wp.max(q))
    return enter_frustum(boxes_from(node, view.origin, view.margin), frustum, far).children


@wp.kernel
def _enter(
    p: wp.array[lanes],
    q: wp.array[lanes],
    far: wp.array[float],
    basis: wp.array[wp.mat33],
    origin: wp.array[wp.vec3],
    center: wp.array[wp.vec3],
    half: wp.array[wp.vec3],
    best: wp.array[PacketHits],
    local: wp.array[Vectors],
    any_ray: wp.array[int],
    at_once: wp.array[int],
    one_by_one: wp.array[int],
    distance: wp.array[float],
    packets: wp.array[int],
    tiles: wp.array[int],
) -> None:
    """Bit by bit, which rays enter the first box of a node, from where the first of them is in it; packets, tiles."""
    i = wp.tid()
    view = View()
    view.origin = origin[i]
    view.axis = basis[i][0]
    view.u = basis[i][1]
    view.v = basis[i][2]
    view.margin = box_margin(origin[i], wp.max(wp.abs(center[i]) + half[i]))
    packet = Packet()
    packet.p = p[i]
    packet.q = q[i]
    for k in range(LANES):
        d = view.axis + packet.p[k] * view.u + packet.q[k] * view.v
        packet.length[k] = wp.length(d)
        best[i].far[k] = far[i]
    node = empty_node()
    node.center_x[0] = center[i][0]
    node.center_y[0] = center[i][1]
    node.center_z[0] = center[i][2]
    node.half_x[0] = half[i][0]
    node.half_y[0] = half[i][1]
    node.half_z[0] = half[i][2]
    p_half = 0.5 * (wp.max(p[i]) - wp.min(p[i]))
    q_half = 0.5 * (wp.max(q[i]) - wp.min(q[i]))
    middle = view.axis + (wp.min(p[i]) + p_half) * view.u + (wp.min(q[i]) + q_half) * view.v
    spread = p_half * wp.abs(view.u) + q_half * wp.abs(view.v) + 2.0 * LANE_ROUNDING * wp.vec3(1.0, 1.0, 1.0)
    way = way_of(packet, view, middle, spread, local)
    slabs = slabs_of(node, view.origin, margin_of_lanes(view, 2.0), way)
    nearest = wp.vec3(slabs.near_x[0], slabs.near_y[0], slabs.near_z[0])
    farthest = wp.vec3(slabs.far_x[0], slabs.far_y[0], slabs.far_z[0])
    any_ray[i] = enter_any(slabs, way, far[i] * APART).children
    at_once[i] = lanes_at_box(way.slowness, best[i].far, nearest, farthest)
    entered = enter_lane_by_lane(slabs, way, best, i, ALL_LANES, wp.inf)
    one_by_one[i] = wp.where(entered.children == 1, entered.lanes[0], 0)
    distance[i] = entered.distance[0]
    packets[i] = _packets(view, p[i], q[i], far[i], center[i], half[i])
    tiles[i] = _tile(view, p[i], q[i], far[i], node)


class Packets:
    """Packets of rays, from origins and in bases of their own, and a point on a ray of each.

    Their p and q are up to 0.5, and differ by up to `spread`.
    """

    def __init__(self, seed: int, scale: float, spread: float = 1.0) -> None:
        self.rng = np.random.default_rng(seed)
        middle = self.rng.uniform(-0.5 * (1 - spread), 0.5 * (1 - spread), (2, CASES, 1))
        self.p, self.q = (middle + self.rng.uniform(-spread / 2, spread / 2, (2, CASES, LANES))).astype(np.float32)
        self.basis = random_rotations(self.rng, CASES)
        self.basis[: CASES // 4] = np.eye(3)  # along the axes, where products vanish
        self.p[: CASES // 8], self.q[: CASES // 8] = 0, 0
        self.origin = (scale * self.rng.normal(size=(CASES, 3))).astype(np.float32)
        a, u, v = (self.basis[:, None, k] for k in range(3))
        self.directions = a + self.p[..., None] * u + self.q[..., None] * v
        t = scale * np.exp(self.rng.uniform(-3, 3, (CASES, 1)))
        self.points = self.origin + t * self.directions[np.arange(CASES), self.rng.integers(0, LANES, CASES)]

    def enter(self, center: Doubles, half: Doubles, far: Doubles | float = np.inf) -> NDArray[np.bool_]:
        """Whether any ray of each packet enters its box; the test of all lanes and that of one lane at a time agree."""
        out = [
            wp.empty(CASES, dtype=kind, device="cpu") for kind in (PacketHits, Vectors, int, int, int, float, int, int)
        ]
        arrays = [
            wp.array(np.ascontiguousarray(values, np.float32), dtype=kind, device="cpu")
            for values, kind in (
                (self.p, lanes),
                (self.q, lanes),
                (np.broadcast_to(far, CASES), float),
                (self.basis, wp.mat33),
                (self.origin, wp.vec3),
                (center, wp.vec3),
                (half, wp.vec3),
            )
        ]
        wp.launch(_enter, CASES, inputs=arrays, outputs=out, device="cpu")
        any_ray, at_once, one_by_one, self.distance, packets, tiles = (array.numpy() for array in out[2:])
        np.testing.assert_array_equal(at_once, one_by_one)
        assert set(any_ray) <= {0, 1}
        assert (any_ray >= (at_once != 0)).all()
        assert set(packets) <= {0, 2**PACKETS - 1}
        assert set(tiles) <= {0, 1}
        self.is_entered, self.is_entered_by_tile = packets != 0, tiles != 0
        return np.asarray(at_once != 0)

    def seen(self, center: Doubles, is_mirrored: bool = False) -> tuple[Doubles, Doubles]:
        """Centres of boxes relative to the origin, and directions.

        is_mirrored: take |c| and |d| along axes on which the rays of a packet go both ways.
        """
        c, d = np.broadcast_arrays((center - self.origin)[:, None], self.directions)
        ways = [np.array([self.p.min(1), self.p.max(1)]), np.array([self.q.min(1), self.q.max(1)])]
        a, u, v = (self.basis[:, k] for k in range(3))
        corners = np.stack([a + p[:, None] * u + q[:, None] * v for p in ways[0] for q in ways[1]])
        both = (corners.min(axis=0) < 1e-4) & (corners.max(axis=0) > -1e-4) & is_mirrored
        return np.where(both[:, None], np.abs(c), c), np.where(both[:, None], np.abs(d), d)

    def lines_pass(self, center: Doubles, half: Doubles, is_mirrored: bool = False) -> NDArray[np.bool_]:
        """Whether any ray's line passes a box, in float64."""
        c, d = self.seen(center, is_mirrored)
        off = np.abs(np.cross(c, d))
        room = [
            half[:, None, k - 2] * np.abs(d[..., k - 1]) + half[:, None, k - 1] * np.abs(d[..., k - 2])
            for k in range(3)
        ]
        return np.asarray((off <= np.stack(room, axis=-1)).all(axis=-1).any(axis=-1), bool)

    def distances(self, center: Doubles, half: Doubles, is_mirrored: bool = False) -> Doubles:
        """The least distance at which a ray of each packet is in its box, in float64; +inf where none enters it."""
        c, d = self.seen(center, is_mirrored)
        unit = d / np.linalg.norm(d, axis=-1, keepdims=True)
        inverse = 1 / np.where(np.abs(unit) < 1e-20, 1e-20, unit)
        middle, room = c * inverse, half[:, None] * np.abs(inverse)
        enter, leave = (middle - room).max(axis=-1).clip(0), (middle + room).min(axis=-1)
        return np.asarray(np.where(enter <= leave, enter, np.inf).min(axis=1), np.float64)


def box_around(points: Doubles, rng: np.random.Generator, scale: float) -> tuple[Doubles, Doubles]:
    """Boxes that contain the points, of all sizes, many of size 0 along some axes."""
    half = scale * np.exp(rng.uniform(-12, 0, points.shape)) * (rng.random(points.shape) < 0.5)
    center = (points + rng.uniform(-1, 1, points.shape) * half).astype(np.float32).astype(np.float64)
    return center, np.nextafter(np.maximum(half, np.abs(points - center)).astype(np.float32), np.float32(np.inf))


@pytest.mark.parametrize("spread", [1.0, 0.02])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("seed", range(3))
def test_a_box_that_a_ray_enters_is_not_refused(seed: int, scale: float, spread: float) -> None:
    packets = Packets(seed, scale, spread)
    entered = packets.enter(*box_around(packets.points, packets.rng, scale))
    for is_entered in entered, packets.is_entered, packets.is_entered_by_tile:
        assert is_entered.all(), f"seed {seed}, scale {scale}: refused {np.flatnonzero(~is_entered)[:5]}"


@pytest.mark.parametrize("spread", [1.0, 0.02])
@pytest.mark.parametrize("seed", range(3))
def test_a_box_that_no_ray_comes_near_is_refused(seed: int, spread: float) -> None:
    packets = Packets(seed, 1.0, spread)
    aside = np.exp(packets.rng.uniform(-6, 1, (CASES, 1))) * packets.rng.normal(size=(CASES, 3))
    center, half = box_around(packets.points + aside, packets.rng, 0.3)
    size = 1e-4 * (np.abs(packets.origin) + np.abs(center)).max(axis=1, keepdims=True)
    is_near = packets.lines_pass(center, half + size, is_mirrored=True)
    entered = packets.enter(center, half)
    assert 0.01 < is_near.mean() < 0.95
    assert not (entered & ~is_near).any(), f"seed {seed}: let through {np.flatnonzero(entered & ~is_near)[:5]}"


@pytest.mark.parametrize("seed", range(3))
def test_a_box_that_a_narrow_packet_does_not_come_near_is_refused(seed: int) -> None:
    packets = Packets(seed, 1.0, spread=1e-5)
    aside = np.exp(packets.rng.uniform(-6, 1, (CASES, 1))) * packets.rng.normal(size=(CASES, 3))
    center, half = box_around(packets.points + aside, packets.rng, 0.3)
    size = 1e-3 * (np.abs(packets.origin) + np.abs(center)).max(axis=1, keepdims=True)
    is_near = np.isfinite(packets.distances(center, half + size))
    packets.enter(center, half)
    assert 0.01 < is_near.mean() < 0.95
    let_through = np.flatnonzero((packets.is_entered | packets.is_entered_by_tile) & ~is_near)
    assert not let_through.size, f"seed {seed}: let through {let_through[:5]}"


def test_a_plane_without_bounds_is_entered_by_packets_that_go_down() -> None:
    packets = Packets(0, 1.0, spread=1e-5)
    center, half = np.zeros((CASES, 3)), np.broadcast_to([np.inf, np.inf, 0.0], (CASES, 3))
    packets.enter(center, half)
    descent = (packets.origin[:, None] * packets.directions)[..., 2] / np.abs(packets.origin[:, None, 2])
    assert packets.is_entered[(descent < 0).any(axis=1)].all()
    assert not packets.is_entered[(descent > 1e-4).all(axis=1)].any()


def test_a_box_beyond_all_hits_is_refused() -> None:
    packets = Packets(0, 1.0)
    center, half = box_around(packets.points, packets.rng, 1.0)
    entered = packets.enter(center, half, np.nextafter(packets.distances(center, half).astype(np.float32), np.inf))
    assert entered.all(), f"refused {np.flatnonzero(~entered)[:5]}"
    for is_entered in packets.is_entered, packets.is_entered_by_tile:
        assert is_entered.all(), f"refused {np.flatnonzero(~is_entered)[:5]}"
    assert (packets.distance <= packets.distances(center, half) * (1 + 1e-6)).all()
    size = 1e-4 * (np.abs(packets.origin) + np.abs(center)).max(axis=1, keepdims=True)
    at_least = packets.distances(center, half + size, is_mirrored=True)
    entered = packets.enter(center, half, 0.999 * at_least)
    assert (at_least > 0).mean() > 0.5
    assert not entered[at_least > 0].any(), f"let through {np.flatnonzero(entered & (at_least > 0))[:5]}"


def test_a_packet_is_refused_at_a_box_beyond_its_reach() -> None:
    packets = Packets(0, 1.0, spread=1e-5)
    center, half = box_around(packets.points, packets.rng, 1.0)
    size = 1e-3 * (np.abs(packets.origin) + np.abs(center)).max(axis=1, keepdims=True)
    at_least = packets.distances(center, half + size)
    packets.enter(center, half, at_least / np.sqrt(1.5))  # the longest a + p u + q v
    assert (at_least > 0).mean() > 0.5
    assert not (packets.is_entered | packets.is_entered_by_tile)[at_least > 0].any()
