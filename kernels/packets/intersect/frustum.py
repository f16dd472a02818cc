"""Tests of boxes against many rays at once, by the side planes of their frustum and the range of their directions."""

import warp as wp

from rigcast.kernels.inline import inlined
from rigcast.kernels.packets.packet import PACKETS, Tile, View
from rigcast.kernels.single.ray import MARGIN
from rigcast.kernels.trees.nodes import WIDTH, Node, vec8
from rigcast.kernels.trees.traverse import Entered
from rigcast.kernels.vectors import Interval, interval, larger, smaller

TINY = wp.constant(1.0e-30)
LANE_ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u


Slowness = wp.types.vector(length=5, dtype=wp.float32)
"""For a set of numbers d: least sign, largest sign, least 1 / |d|, largest 1 / |d|. The fifth entry is unused padding:
see rigcast.kernels.vectors.Interval."""


@wp.func
def slowness_of(a: float, u: float, v: float, p_low: float, p_high: float, q_low: float, q_high: float) -> Slowness:
    """Slowness of one component of a + p u + q v over a range of p and q.

    The rounding error of the component is at most 5u (1 + |p| + |q|); the code allows for 16u.
    """
    pu_low = p_low * u
    pu_high = p_high * u
    qv_low = q_low * v
    qv_high = q_high * v
    rounding = LANE_ROUNDING * (1.0 + larger(-p_low, p_high) + larger(-q_low, q_high))
    low = a + smaller(pu_low, pu_high) + smaller(qv_low, qv_high) - rounding
    high = a + larger(pu_low, pu_high) + larger(qv_low, qv_high) + rounding
    by_low = wp.abs(1.0 / low)
    by_high = wp.abs(1.0 / high)
    made = Slowness()
    made[0] = wp.where(low > 0.0, 1.0, -1.0)
    made[1] = wp.where(high < 0.0, -1.0, 1.0)
    made[2] = smaller(by_low, by_high)
    made[3] = wp.where(low * high <= 0.0, 1.0 / TINY, larger(by_low, by_high))
    return made


@wp.func
def in_slab(slow: Slowness, c: float, h: float) -> Interval:
    """Interval of t >= 0 in which any of the directions d may satisfy c - h <= t d <= c + h.

    Where d takes both signs, c is treated as lying ahead for either sign, which only widens the interval.
    """
    ahead = larger(slow[0] * c, slow[1] * c)
    return interval((ahead - h) * slow[2], (ahead + h) * slow[3])


@wp.struct
class Frustum:
    """The volume swept by rays over a range of p and q: points x relative to the origin with right . x <= 0 and so on.

    slow_x, slow_y, slow_z: Slowness of a + p u + q v. A ray's points are t (a + p u + q v); t is at most the distance.

    Rounding of the planes, u = eps / 2: at t (a + p u + q v), left . x is off by 3u |p|, one rounding of u and one of
    their difference, at most (4 + sqrt(2)) sqrt(2) u t < 8u t within 45 degrees of the axis. SLACK in p, of
    rigcast.kernels.packing.sorting, moves the plane by more than 15u t. Products with boxes have a rounding of 6u,
    where the view's margin covers 8u.
    """

    left: wp.vec3
    right: wp.vec3
    bottom: wp.vec3
    top: wp.vec3
    slow_x: Slowness
    slow_y: Slowness
    slow_z: Slowness


@wp.func
def frustum_of(view: View, p_low: float, p_high: float, q_low: float, q_high: float) -> Frustum:
    a = view.axis
    u = view.u
    v = view.v
    f = Frustum()
    f.left = p_low * a - u
    f.right = u - p_high * a
    f.bottom = q_low * a - v
    f.top = v - q_high * a
    f.slow_x = slowness_of(a[0], u[0], v[0], p_low, p_high, q_low, q_high)
    f.slow_y = slowness_of(a[1], u[1], v[1], p_low, p_high, q_low, q_high)
    f.slow_z = slowness_of(a[2], u[2], v[2], p_low, p_high, q_low, q_high)
    return f


@wp.func
def off_zero(a: wp.vec3) -> wp.vec3:
    """|a| with no component 0, so that products with infinite half sizes are not NaN."""
    return wp.abs(a) + wp.vec3(TINY, TINY, TINY)


@wp.func
def weighted(a: wp.vec3, x: float, y: float, z: float) -> float:
    return a[0] * x + a[1] * y + a[2] * z


@wp.func
def boxes_from(node: Node, origin: wp.vec3, margin: float) -> Node:
    """The boxes of a node relative to the origin, widened by a margin."""
    center_x = node.center_x
    center_y = node.center_y
    center_z = node.center_z
    half_x = node.half_x
    half_y = node.half_y
    half_z = node.half_z
    for j in range(WIDTH):
        center_x[j] = center_x[j] - origin[0]
        center_y[j] = center_y[j] - origin[1]
        center_z[j] = center_z[j] - origin[2]
        half_x[j] = half_x[j] + margin
        half_y[j] = half_y[j] + margin
        half_z[j] = half_z[j] + margin
    boxes = Node()
    boxes.center_x = center_x
    boxes.center_y = center_y
    boxes.center_z = center_z
    boxes.half_x = half_x
    boxes.half_y = half_y
    boxes.half_z = half_z
    boxes.child = node.child
    return boxes


@wp.func
def enter_frustum(boxes: Node, f: Frustum, limit: float) -> Entered:
    """The boxes, as from boxes_from, that the frustum enters no farther than the limit [m]."""
    center_x = boxes.center_x
    center_y = boxes.center_y
    center_z = boxes.center_z
    half_x = boxes.half_x
    half_y = boxes.half_y
    half_z = boxes.half_z
    left = f.left
    right = f.right
    bottom = f.bottom
    top = f.top
    slow_x = f.slow_x
    slow_y = f.slow_y
    slow_z = f.slow_z
    left_size = off_zero(left)
    right_size = off_zero(right)
    bottom_size = off_zero(bottom)
    top_size = off_zero(top)
    distance = vec8()
    children = int(0)
    for j in range(WIDTH):
        x = center_x[j]
        y = center_y[j]
        z = center_z[j]
        hx = half_x[j]
        hy = half_y[j]
        hz = half_z[j]
        off_left = weighted(left, x, y, z) - weighted(left_size, hx, hy, hz)
        off_right = weighted(right, x, y, z) - weighted(right_size, hx, hy, hz)
        off_bottom = weighted(bottom, x, y, z) - weighted(bottom_size, hx, hy, hz)
        off_top = weighted(top, x, y, z) - weighted(top_size, hx, hy, hz)
        outside = larger(larger(off_left, off_right), larger(off_bottom, off_top))
        in_x = in_slab(slow_x, x, hx)
        in_y = in_slab(slow_y, y, hy)
        in_z = in_slab(slow_z, z, hz)
        enter = larger(larger(in_x[0], in_y[0]), larger(in_z[0], 0.0))
        leave = smaller(smaller(in_x[1], in_y[1]), smaller(in_z[1], limit))
        # unbounded planes come first: their hits limit the reach of all rays
        distance[j] = wp.where(half_x[j] + half_y[j] + half_z[j] < wp.inf, enter, 0.0)
        enters = outside <= 0.0 and enter <= leave and half_x[j] >= 0.0
        children = children | wp.where(enters, 1 << j, 0)
    entered = Entered()
    entered.children = children
    entered.distance = distance
    return entered


@inlined
def packets_at_box(view: View, tile: Tile, center: wp.vec3, half: wp.vec3, reach: vec8) -> int:
    """Bit mask of the packets that may enter a box in the view's frame before their reach [m].

    All rounding except that of directions is covered by box_margin, applied here per axis because a plane's box is
    unbounded along two axes.
    """
    p_low = tile.p_low
    p_high = tile.p_high
    q_low = tile.q_low
    q_high = tile.q_high
    a = view.axis
    u = view.u
    v = view.v
    c = center - view.origin
    h = half + MARGIN * (wp.abs(view.origin) + wp.abs(center) + half)
    packets = int(0)
    for j in range(PACKETS):
        x = in_slab(slowness_of(a[0], u[0], v[0], p_low[j], p_high[j], q_low[j], q_high[j]), c[0], h[0])
        y = in_slab(slowness_of(a[1], u[1], v[1], p_low[j], p_high[j], q_low[j], q_high[j]), c[1], h[1])
        z = in_slab(slowness_of(a[2], u[2], v[2], p_low[j], p_high[j], q_low[j], q_high[j]), c[2], h[2])
        enter = larger(larger(x[0], y[0]), larger(z[0], 0.0))
        leave = smaller(smaller(x[1], y[1]), smaller(z[1], reach[j]))
        packets = packets | wp.where(enter > leave, 0, 1 << j)
    return packets & tile.packets
