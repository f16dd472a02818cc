"""Where the shapes stand for a ray, in the arrays of a geometry."""

import warp as wp

from .geometry import Geometry
from .vectors import to_double


@wp.struct
class Scope:
    """Of a ray: the span it is cast through, and where in arrays of shapes those that it meets begin."""

    span: int
    first_pose: int
    first_still: int  # of the poses of shapes that stand still while others move
    first_shape: int  # of sizes and boxes
    first_visible: int


@wp.struct
class Pose:
    """Position [m], and rotation whose columns are the shape's axes, in the world."""

    position: wp.vec3d
    rotation: wp.mat33d


@wp.func
def scope_of(g: Geometry, visible: wp.array[wp.bool], span: int, firing: int) -> Scope:
    shapes = g.kind.shape[0]
    world = world_of(g, span)
    scope = Scope()
    scope.span = span
    scope.first_pose = span * shapes
    if g.instants > 1:
        scope.first_still = world * shapes
        scope.first_pose = worlds_of(g) * shapes + firing * g.movers.shape[0]
    scope.first_shape = first_of_world(g.size.shape[0], shapes, world)
    scope.first_visible = first_of_world(visible.shape[0], shapes, world)
    return scope


@wp.func
def world_of(g: Geometry, span: int) -> int:
    if g.instants == 1:
        return span
    return int(span / (g.instants - 1))


@wp.func
def worlds_of(g: Geometry) -> int:
    """How many worlds there are."""
    spans = g.anchor.shape[0]
    if g.instants == 1:
        return spans
    return int(spans / (g.instants - 1))


@wp.func
def first_of_world(size: int, shapes: int, world: int) -> int:
    """Where the entries of a world begin in an array of one for each shape, or of one for each shape of each world."""
    return wp.where(size > shapes, world * shapes, 0)


@wp.func
def pose_of(g: Geometry, shape: int, scope: Scope) -> Pose:
    """Where a shape stands for a ray."""
    entry = scope.first_pose + shape
    if g.place.shape[0] > 0:
        entry = scope.first_still + shape
        if g.place[shape] >= 0:
            entry = scope.first_pose + g.place[shape]
    return pose_at(g, entry)


@wp.func
def pose_at(g: Geometry, entry: int) -> Pose:
    pose = Pose()
    if g.position.shape[0] > 0:
        pose.position = g.position[entry]
        pose.rotation = g.rotation[entry]
    else:
        pose.position = to_double(g.position_float[entry])
        pose.rotation = wp.mat33d(g.rotation_float[entry])
    return pose


@wp.func
def first_instant_of(g: Geometry, span: int) -> int:
    """Entry of the pose of shape 0 at the first instant of a span; n on is that at the second."""
    shapes = g.kind.shape[0]
    if g.instants == 1:
        return span * shapes
    return (span + world_of(g, span)) * shapes
