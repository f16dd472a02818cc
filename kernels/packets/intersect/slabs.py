"""Slab tests of the boxes of a tree against the rays of a packet.

Flip each axis so that it points the way the ray goes. A box spans [n, f] along each axis, relative to the origin; the
ray enters it at max n / |d| and leaves it at min f / |d|, over the three axes. The rays of a packet nearly always go
the same way along an axis. Where they do not, the box is treated as lying ahead of every ray. That also accepts its
mirror image. Few rays enter the image and not the box, because all of them run close to the mirror plane.
"""

import warp as wp

from rigcast.kernels.hits.hit import APART
from rigcast.kernels.inline import inlined
from rigcast.kernels.packets.lanes import far_of, lane_bits, least_of, most_of
from rigcast.kernels.packets.packet import LANES, Packet, PacketHits, Vectors, View, int_lanes, lanes
from rigcast.kernels.single.ray import MARGIN, inverse_of
from rigcast.kernels.trees.nodes import WIDTH, Node, vec8, vec8i
from rigcast.kernels.trees.traverse import sign_bits
from rigcast.kernels.vectors import larger, lowest_bit, smaller

from .frustum import LANE_ROUNDING


@wp.struct
class Way:
    """Signs and slownesses of a packet's directions d in the frame of a tree.

    low, high: least and largest sign of d along each axis. slowness: 1 / |d| per ray, finite. least, most: its least
    and largest value over all rays.
    """

    low: wp.vec3
    high: wp.vec3
    slowness: Vectors
    least: wp.vec3
    most: wp.vec3


@inlined
def way_of(packet: Packet, view: View, middle: wp.vec3, spread: wp.vec3, local: wp.array[Vectors]) -> Way:
    """The Way of a packet in a view's frame; writes its unit directions in that frame to `local`.

    For each ray, a + p u + q v after rounding is within `spread` of `middle`.
    """
    p = packet.p
    q = packet.q
    length = packet.length
    a = view.axis
    u = view.u
    v = view.v
    x = lanes()
    y = lanes()
    z = lanes()
    slow_x = lanes()
    slow_y = lanes()
    slow_z = lanes()
    for i in range(LANES):
        scale = 1.0 / length[i]
        x[i] = scale * (a[0] + p[i] * u[0] + q[i] * v[0])
        y[i] = scale * (a[1] + p[i] * u[1] + q[i] * v[1])
        z[i] = scale * (a[2] + p[i] * u[2] + q[i] * v[2])
        slow_x[i] = wp.abs(inverse_of(x[i]))
        slow_y[i] = wp.abs(inverse_of(y[i]))
        slow_z[i] = wp.abs(inverse_of(z[i]))
    local[0].x = x
    local[0].y = y
    local[0].z = z
    way = Way()
    way.slowness.x = slow_x
    way.slowness.y = slow_y
    way.slowness.z = slow_z
    way.least = wp.vec3(least_of(slow_x), least_of(slow_y), least_of(slow_z))
    way.most = wp.vec3(most_of(slow_x), most_of(slow_y), most_of(slow_z))
    for k in range(3):
        way.low[k] = wp.where(middle[k] > spread[k], 1.0, -1.0)
        way.high[k] = wp.where(middle[k] < -spread[k], -1.0, 1.0)
    return way


@wp.func
def margin_of_lanes(view: View, widest: float) -> float:
    """Margin [m] for tests of single rays of a packet against a tree's boxes. widest: the packet's largest w.

    Rounding, u = eps / 2, w = 1 + |p| + |q|: each component of d = a + p u + q v is off by at most 5u w, w being larger
    than any of them; the length and the quotient add 4u. So at the distance of the box, at most |c|_1 + |h|_1, a ray is
    within 9u w (|c|_1 + |h|_1) of where it should be. The code allows for 16u. All other rounding is covered by the
    view's margin, as for enter_boxes. That margin is 8u times the sum of the largest coordinates of the origin and of
    the tree, and |c|_1 + |h|_1 is at most three times that sum.
    """
    return view.margin * (1.0 + 3.0 * (LANE_ROUNDING / MARGIN) * widest)


@wp.struct
class Slabs:
    """Extents of a node's boxes along each axis, relative to the origin, with the axis pointing the way the rays go."""

    near_x: vec8
    near_y: vec8
    near_z: vec8
    far_x: vec8
    far_y: vec8
    far_z: vec8


@inlined
def slabs_of(node: Node, origin: wp.vec3, margin: float, way: Way) -> Slabs:
    """The slabs of a node's boxes, widened by a margin."""
    center_x = node.center_x
    center_y = node.center_y
    center_z = node.center_z
    half_x = node.half_x
    half_y = node.half_y
    half_z = node.half_z
    low = way.low
    high = way.high
    near_x = vec8()
    near_y = vec8()
    near_z = vec8()
    far_x = vec8()
    far_y = vec8()
    far_z = vec8()
    for j in range(WIDTH):
        x = center_x[j] - origin[0]
        y = center_y[j] - origin[1]
        z = center_z[j] - origin[2]
        x = larger(low[0] * x, high[0] * x)
        y = larger(low[1] * y, high[1] * y)
        z = larger(low[2] * z, high[2] * z)
        hx = half_x[j] + margin
        hy = half_y[j] + margin
        hz = half_z[j] + margin
        near_x[j] = x - hx
        near_y[j] = y - hy
        near_z[j] = z - hz
        far_x[j] = x + hx
        far_y[j] = y + hy
        far_z[j] = z + hz
    slabs = Slabs()
    slabs.near_x = near_x
    slabs.near_y = near_y
    slabs.near_z = near_z
    slabs.far_x = far_x
    slabs.far_y = far_y
    slabs.far_z = far_z
    return slabs


@wp.struct
class EnteredByLanes:
    """Entered, for a packet. lanes: bit mask of the rays that enter each box."""

    children: int
    distance: vec8
    lanes: vec8i


@inlined
def enter_any(slabs: Slabs, way: Way, limit: float) -> EnteredByLanes:
    """The boxes that a packet may enter no farther than the limit [m]; does not compute which rays enter them."""
    near_x = slabs.near_x
    near_y = slabs.near_y
    near_z = slabs.near_z
    far_x = slabs.far_x
    far_y = slabs.far_y
    far_z = slabs.far_z
    least = way.least
    most = way.most
    distance = vec8()
    entering = vec8i()
    for j in range(WIDTH):
        enter = larger(larger(near_x[j] * least[0], near_y[j] * least[1]), larger(near_z[j] * least[2], 0.0))
        leave = smaller(smaller(far_x[j] * most[0], far_y[j] * most[1]), smaller(far_z[j] * most[2], limit))
        distance[j] = enter
        # the last condition excludes absent children for any ray and box, as larger and smaller drop NaN
        entering[j] = wp.where(enter <= leave and near_x[j] <= far_x[j], -1, 0)
    entered = EnteredByLanes()
    entered.children = sign_bits(entering)
    entered.distance = distance
    return entered


@inlined
def lanes_at_box(slowness: Vectors, limits: lanes, near: wp.vec3, far: wp.vec3) -> int:
    """Bit mask of the rays that enter a box before their best hits, at most `limits` [m] away; see enter_boxes."""
    slow_x = slowness.x
    slow_y = slowness.y
    slow_z = slowness.z
    entering = int_lanes()
    for i in range(LANES):
        enter = larger(larger(near[0] * slow_x[i], near[1] * slow_y[i]), larger(near[2] * slow_z[i], 0.0))
        leave = smaller(smaller(far[0] * slow_x[i], far[1] * slow_y[i]), smaller(far[2] * slow_z[i], limits[i] * APART))
        entering[i] = wp.where(enter <= leave, -1, 0)
    return lane_bits(entering)


@inlined
def enter_lane_by_lane(
    slabs: Slabs, way: Way, best: wp.array[PacketHits], slot: int, which: int, limit: float
) -> EnteredByLanes:
    """The boxes that rays of the mask `which` enter before the limit [m] and their best hits; see enter_boxes."""
    near_x = slabs.near_x
    near_y = slabs.near_y
    near_z = slabs.near_z
    far_x = slabs.far_x
    far_y = slabs.far_y
    far_z = slabs.far_z
    slow_x = way.slowness.x
    slow_y = way.slowness.y
    slow_z = way.slowness.z
    distance = vec8()
    entering = vec8i()
    for j in range(WIDTH):
        distance[j] = wp.inf
    while which != 0:
        i = lowest_bit(which)
        which = which & (which - 1)
        x = slow_x[i]
        y = slow_y[i]
        z = slow_z[i]
        end = smaller(far_of(best, slot, i) * APART, limit)
        lane = 1 << i
        for j in range(WIDTH):
            enter = larger(larger(near_x[j] * x, near_y[j] * y), larger(near_z[j] * z, 0.0))
            leave = smaller(smaller(far_x[j] * x, far_y[j] * y), smaller(far_z[j] * z, end))
            is_entered = enter <= leave and near_x[j] <= far_x[j]
            distance[j] = smaller(distance[j], wp.where(is_entered, enter, wp.inf))
            entering[j] = entering[j] | wp.where(is_entered, lane, 0)
    entered = EnteredByLanes()
    entered.children = sign_bits(-entering)
    entered.distance = distance
    entered.lanes = entering
    return entered
