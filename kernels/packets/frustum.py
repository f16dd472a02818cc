"""Boxes held against the side planes and directions of many rays at once."""

import warp as wp

from rigcast.kernels.ray import MARGIN
from rigcast.kernels.traverse import Entered
from rigcast.kernels.trees.nodes import WIDTH, Node, vec8
from rigcast.kernels.vectors import Interval, interval, larger, smaller

from .packet import PACKETS, Tile, View

TINY = wp.constant(1.0e-30)
LANE_ROUNDING = wp.constant(8.0 * 2.0**-23)  # 16u


@wp.struct
class Frustum:
    """Where rays of a range of p and q run: points x, as seen from the origin, with right . x <= 0 and so on."""

    axis: wp.vec3
    left: wp.vec3
    right: wp.vec3
    bottom: wp.vec3
    top: wp.vec3
    slowness: wp.vec3  # 1 / the largest |component| of any of the unit directions


@wp.func
def frustum_of(view: View, p_low: float, p_high: float, q_low: float, q_high: float) -> Frustum:
    f = Frustum()
    f.axis = view.axis
    f.left = p_low * view.axis - view.u
    f.right = view.u - p_high * view.axis
    f.bottom = q_low * view.axis - view.v
    f.top = view.v - q_high * view.axis
    middle = wp.abs(view.axis + 0.5 * (p_low + p_high) * view.u + 0.5 * (q_low + q_high) * view.v)
    # the length of a + p u + q v is at least 1
    most = middle + 0.5 * (p_high - p_low) * wp.abs(view.u) + 0.5 * (q_high - q_low) * wp.abs(view.v)
    f.slowness = wp.vec3(0.9999 / (most[0] + TINY), 0.9999 / (most[1] + TINY), 0.9999 / (most[2] + TINY))
    return f


@wp.func
def off_zero(a: wp.vec3) -> wp.vec3:
    """|a|, never 0, for products with half sizes that may be infinite."""
    return wp.abs(a) + wp.vec3(TINY, TINY, TINY)


@wp.func
def weighted(a: wp.vec3, x: float, y: float, z: float) -> float:
    return a[0] * x + a[1] * y + a[2] * z


@wp.func
def boxes_from(node: Node, origin: wp.vec3, margin: float) -> Node:
    """The boxes of a node as seen from the origin, wider by a margin."""
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
    """The boxes of boxes_from that reach into the frustum no farther than the limit."""
    center_x = boxes.center_x
    center_y = boxes.center_y
    center_z = boxes.center_z
    half_x = boxes.half_x
    half_y = boxes.half_y
    half_z = boxes.half_z
    axis = f.axis
    left = f.left
    right = f.right
    bottom = f.bottom
    top = f.top
    slowness = f.slowness
    axis_size = off_zero(axis)
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
        ahead = weighted(axis, x, y, z) + weighted(axis_size, hx, hy, hz)
        off_left = weighted(left, x, y, z) - weighted(left_size, hx, hy, hz)
        off_right = weighted(right, x, y, z) - weighted(right_size, hx, hy, hz)
        off_bottom = weighted(bottom, x, y, z) - weighted(bottom_size, hx, hy, hz)
        off_top = weighted(top, x, y, z) - weighted(top_size, hx, hy, hz)
        outside = larger(larger(off_left, off_right), larger(off_bottom, off_top))
        near_xy = larger((wp.abs(x) - hx) * slowness[0], (wp.abs(y) - hy) * slowness[1])
        near = larger(near_xy, larger((wp.abs(z) - hz) * slowness[2], 0.0))
        # planes without bounds first, as they bound how far all rays reach
        distance[j] = wp.where(half_x[j] + half_y[j] + half_z[j] < wp.inf, near, 0.0)
        enters = outside <= 0.0 and ahead >= 0.0 and near <= limit and half_x[j] >= 0.0
        children = children | wp.where(enters, 1 << j, 0)
    entered = Entered()
    entered.children = children
    entered.distance = distance
    return entered


@wp.func
def component_range(a: float, u: float, v: float, p_low: float, p_high: float, q_low: float, q_high: float) -> Interval:
    """Between what one component of a + p u + q v is for a range of p and q.

    Rounded it is within 5u (1 + |p| + |q|) of what it should be, of which 16u are allowed for.
    """
    pu_low = p_low * u
    pu_high = p_high * u
    qv_low = q_low * v
    qv_high = q_high * v
    rounding = LANE_ROUNDING * (1.0 + larger(-p_low, p_high) + larger(-q_low, q_high))
    low = a + smaller(pu_low, pu_high) + smaller(qv_low, qv_high)
    high = a + larger(pu_low, pu_high) + larger(qv_low, qv_high)
    return interval(low - rounding, high + rounding)


@wp.func
def in_slab(direction: Interval, c: float, h: float) -> Interval:
    """From which t to which t any of these directions d may have c - h <= t d <= c + h, t >= 0.

    Where d has one sign both ends are linear in 1 / d.
    """
    by_low = 1.0 / direction[0]
    by_high = 1.0 / direction[1]
    h_low = h * wp.abs(by_low)
    h_high = h * wp.abs(by_high)
    enter = smaller(c * by_low - h_low, c * by_high - h_high)
    leave = larger(c * by_low + h_low, c * by_high + h_high)
    soonest = larger(wp.abs(c) - h, 0.0) * smaller(wp.abs(by_low), wp.abs(by_high))
    has_both_signs = direction[0] * direction[1] <= 0.0
    return interval(wp.where(has_both_signs, soonest, enter), wp.where(has_both_signs, wp.inf, leave))


@wp.func
def packets_at_box(view: View, tile: Tile, center: wp.vec3, half: wp.vec3, reach: vec8) -> int:
    """Bit by bit, the packets some of whose rays may enter a box in the view's frame before their reach.

    Rays are taken as t (a + p u + q v), so t is at most the distance. All other rounding is within box_margin, here of
    one axis each, as a plane's box is without bounds along two of them.
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
        x = in_slab(component_range(a[0], u[0], v[0], p_low[j], p_high[j], q_low[j], q_high[j]), c[0], h[0])
        y = in_slab(component_range(a[1], u[1], v[1], p_low[j], p_high[j], q_low[j], q_high[j]), c[1], h[1])
        z = in_slab(component_range(a[2], u[2], v[2], p_low[j], p_high[j], q_low[j], q_high[j]), c[2], h[2])
        enter = larger(larger(x[0], y[0]), larger(z[0], 0.0))
        leave = smaller(smaller(x[1], y[1]), smaller(z[1], reach[j]))
        # infinite boxes make NaN of inf - inf, which is not outside
        packets = packets | wp.where(enter > leave, 0, 1 << j)
    return packets & tile.packets
