"""The rays of a bundle against the edges and planes of a block's triangles.

Rounding of s(x) (see rigcast.kernels.bundles), u = eps / 2:

- s(0): 11u |e|_1 (|a|_1 + |b|_1), as for a single ray;
- 2 x . (d x e): one rounding each of d, e, the products and their difference, one of x, and three of the product with
  x: 8u of 2 |e|_1 |x|_1;
- the sum adds one of each: 12u |e|_1 (|a|_1 + |b|_1) + 18u |e|_1 |x|_1.

The code allows for 16u |e|_1 (|a|_1 + |b|_1 + 4 |x|_1).

Rounding of the height: 5u |a| of n . a, 4u |x| of n . x, and one of each for the difference: 6u |a| + 5u |x|, in place
of 5u |a - x| for a single ray. With the other roundings of triage_triangle, and one more for the product with
1 / (d . n), the distance is off by 10u |a| + 9u |x| + 10u t over |cos|. The code allows for
16u (|a| + 2 |x| + t) / |cos|. Hits too close to call are decided in float64, by rigcast.kernels.hits.hit.

Functions here copy the fields of a struct into locals before their loop over the triangles and write them back after
it. LLVM does not vectorise a loop that reads or writes through a Warp struct.
"""

import warp as wp

from rigcast.kernels.geometry import TriangleBlock
from rigcast.kernels.shapes.triangle import (
    DISTANCE_ROUNDING,
    GRAZING,
    ROUNDING,
    Spans,
    edge_side,
    inside_edges,
    is_culled,
)
from rigcast.kernels.single.ray import Ray
from rigcast.kernels.trees.nodes import WIDTH, vec8, vec8i
from rigcast.kernels.trees.traverse import sign_bits
from rigcast.kernels.vectors import larger, norm1


@wp.struct
class Sides:
    """A block of triangles relative to a bundle: s(x) and the height as linear functions of a ray's offset x.

    side0..2: s(0) of each edge. turn0..2: -2 d x e, the gradient of s. height: n . a, of the middle ray.
    """

    side0: vec8
    side1: vec8
    side2: vec8
    turn0_x: vec8
    turn0_y: vec8
    turn0_z: vec8
    turn1_x: vec8
    turn1_y: vec8
    turn1_z: vec8
    turn2_x: vec8
    turn2_y: vec8
    turn2_z: vec8
    per_slope: vec8  # 1 / (d . n)
    height: vec8
    rounding: vec8  # bound on the error of s
    sure: vec8  # s beyond which a ray surely passes inside; +inf where it grazes the plane
    reach: vec8  # bound on |a|_1 + 2 |x|_1 over the corners a


@wp.func
def sides_of(block: TriangleBlock, ray: Ray, spread: wp.vec3) -> Sides:
    """The Sides of a block for the middle ray of a bundle, valid for offsets up to the spread."""
    x0 = block.x0
    y0 = block.y0
    z0 = block.z0
    x1 = block.x1
    y1 = block.y1
    z1 = block.z1
    x2 = block.x2
    y2 = block.y2
    z2 = block.z2
    normal_x = block.normal_x
    normal_y = block.normal_y
    normal_z = block.normal_z
    origin = ray.origin
    rest = ray.origin_rest
    d = ray.direction
    wider = 2.0 * norm1(spread)
    side0 = vec8()
    side1 = vec8()
    side2 = vec8()
    turn0_x = vec8()
    turn0_y = vec8()
    turn0_z = vec8()
    turn1_x = vec8()
    turn1_y = vec8()
    turn1_z = vec8()
    turn2_x = vec8()
    turn2_y = vec8()
    turn2_z = vec8()
    per_slope = vec8()
    height = vec8()
    rounding = vec8()
    sure = vec8()
    reach = vec8()
    for j in range(WIDTH):
        w0 = wp.vec3(x0[j], y0[j], z0[j])
        w1 = wp.vec3(x1[j], y1[j], z1[j])
        w2 = wp.vec3(x2[j], y2[j], z2[j])
        v0 = (w0 - origin) - rest
        v1 = (w1 - origin) - rest
        v2 = (w2 - origin) - rest
        e0 = w0 - w1
        e1 = w1 - w2
        e2 = w2 - w0
        n = wp.vec3(normal_x[j], normal_y[j], normal_z[j])
        side0[j] = edge_side(d, e0, v0, v1)
        side1[j] = edge_side(d, e1, v1, v2)
        side2[j] = edge_side(d, e2, v2, v0)
        turn0 = -2.0 * wp.cross(d, e0)
        turn1 = -2.0 * wp.cross(d, e1)
        turn2 = -2.0 * wp.cross(d, e2)
        turn0_x[j] = turn0[0]
        turn0_y[j] = turn0[1]
        turn0_z[j] = turn0[2]
        turn1_x[j] = turn1[0]
        turn1_y[j] = turn1[1]
        turn1_z[j] = turn1[2]
        turn2_x[j] = turn2[0]
        turn2_y[j] = turn2[1]
        turn2_z[j] = turn2[2]
        size0 = norm1(v0) + wider
        size1 = norm1(v1) + wider
        size2 = norm1(v2) + wider
        side = larger(norm1(e0) * (size0 + size1), larger(norm1(e1) * (size1 + size2), norm1(e2) * (size2 + size0)))
        slope = wp.dot(d, n)
        per_slope[j] = 1.0 / slope
        height[j] = wp.dot(v0, n)
        rounding[j] = ROUNDING * side
        sure[j] = wp.where(wp.abs(slope) > GRAZING, ROUNDING * side, wp.inf)
        reach[j] = larger(size0, larger(size1, size2))
    sides = Sides()
    sides.side0 = side0
    sides.side1 = side1
    sides.side2 = side2
    sides.turn0_x = turn0_x
    sides.turn0_y = turn0_y
    sides.turn0_z = turn0_z
    sides.turn1_x = turn1_x
    sides.turn1_y = turn1_y
    sides.turn1_z = turn1_z
    sides.turn2_x = turn2_x
    sides.turn2_y = turn2_y
    sides.turn2_z = turn2_z
    sides.per_slope = per_slope
    sides.height = height
    sides.rounding = rounding
    sides.sure = sure
    sides.reach = reach
    return sides


@wp.func
def meet_sides(sides: Sides, block: TriangleBlock, offset: wp.vec3, cull: int) -> Spans:
    """Test one ray of the bundle against the triangles of a block; the spans mean what triage_triangle's do."""
    side0 = sides.side0
    side1 = sides.side1
    side2 = sides.side2
    turn0_x = sides.turn0_x
    turn0_y = sides.turn0_y
    turn0_z = sides.turn0_z
    turn1_x = sides.turn1_x
    turn1_y = sides.turn1_y
    turn1_z = sides.turn1_z
    turn2_x = sides.turn2_x
    turn2_y = sides.turn2_y
    turn2_z = sides.turn2_z
    per_slopes = sides.per_slope
    heights = sides.height
    roundings = sides.rounding
    sure = sides.sure
    reaches = sides.reach
    normal_x = block.normal_x
    normal_y = block.normal_y
    normal_z = block.normal_z
    x = offset[0]
    y = offset[1]
    z = offset[2]
    near = vec8()
    far = vec8()
    possible = vec8i()
    for j in range(WIDTH):
        s0 = side0[j] + (x * turn0_x[j] + y * turn0_y[j] + z * turn0_z[j])
        s1 = side1[j] + (x * turn1_x[j] + y * turn1_y[j] + z * turn1_z[j])
        s2 = side2[j] + (x * turn2_x[j] + y * turn2_y[j] + z * turn2_z[j])
        inside = inside_edges(s0, s1, s2)
        per_slope = per_slopes[j]
        height = heights[j] - (x * normal_x[j] + y * normal_y[j] + z * normal_z[j])
        t = height * per_slope
        error = DISTANCE_ROUNDING * (reaches[j] + wp.abs(t)) * wp.abs(per_slope)
        is_far = wp.abs(height) > ROUNDING * reaches[j]
        is_sure = inside > sure[j] and is_far
        is_hit = inside >= -roundings[j] and not (is_sure and (t < 0.0 or is_culled(per_slope, cull)))
        near[j] = wp.where(is_hit, wp.where(is_sure, t - error, 0.0), wp.inf)
        far[j] = wp.where(is_hit and is_sure, t + error, wp.inf)
        possible[j] = wp.where(is_hit, -1, 0)
    spans = Spans()
    spans.near = near
    spans.far = far
    spans.possible = sign_bits(possible)
    return spans
