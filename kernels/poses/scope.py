"""Indices and poses of the shapes that a ray is cast against, in the arrays of a geometry."""

import warp as wp

from rigcast.kernels.elements import double_vector_at, matrix_at
from rigcast.kernels.geometry import FARTHEST, Geometry
from rigcast.kernels.inline import inlined
from rigcast.kernels.vectors import to_double


@wp.struct
class Scope:
    """The span that a ray is cast through, and the index of its world's or firing's first entry in arrays of shapes."""

    span: int
    first_pose: int  # in arrays of poses; with several instants, of those of the movers
    first_still: int  # in arrays of poses, of those of shapes that stand still while others move
    first_shape: int  # in arrays of sizes and boxes
    first_visible: int  # in `visible`


@wp.struct
class Pose:
    """Position [m], and rotation whose columns are the shape's axes, in the world."""

    position: wp.vec3d
    rotation: wp.mat33d


@wp.func
def scope_of(g: wp.array[Geometry], span: int, firing: int) -> Scope:
    shapes = g[0].kind.shape[0]
    instants = g[0].instants
    world = world_of(instants, span)
    scope = Scope()
    scope.span = span
    scope.first_pose = span * shapes
    if instants > 1:
        scope.first_still = world * shapes
        scope.first_pose = world_of(instants, g[0].anchor.shape[0]) * shapes + firing * g[0].movers.shape[0]
    scope.first_shape = first_of_world(g[0].size.shape[0], shapes, world)
    scope.first_visible = first_of_world(g[0].visible.shape[0], shapes, world)
    return scope


@wp.func
def world_of(instants: int, span: int) -> int:
    """The world of a span. Given the number of all spans, the number of worlds."""
    if instants == 1:
        return span
    return int(span / (instants - 1))


@wp.func
def first_of_world(size: int, shapes: int, world: int) -> int:
    """Index of a world's first entry in an array of `size` entries: (n,) for all worlds, or (W n,)."""
    return wp.where(size > shapes, world * shapes, 0)


@inlined
def pose_of(g: wp.array[Geometry], shape: int, scope: Scope) -> Pose:
    """The pose of a shape for a ray."""
    entry = entry_of(g[0].place, shape, scope)
    return pose_among(g[0].position, g[0].rotation, g[0].position_float, g[0].rotation_float, entry)


@inlined
def entry_of(place: wp.array[int], shape: int, scope: Scope) -> int:
    """Index of a shape's pose for a ray."""
    entry = scope.first_pose + shape
    if place.shape[0] > 0:
        entry = scope.first_still + shape
        if place[shape] >= 0:
            entry = scope.first_pose + place[shape]
    return entry


@wp.func
def is_doubled(g: wp.array[Geometry], shape: int, scope: Scope) -> bool:
    """Whether the shape's twin is visible and has the same triangles at the same pose, and so takes all of its hits.

    An example is a mesh that is both the visual and the collision geom of a body.
    """
    twin = g[0].twin[shape]
    if twin < 0:
        return False
    if not g[0].visible[scope.first_visible + twin]:
        return False
    if g[0].root[scope.first_shape + twin] != g[0].root[scope.first_shape + shape]:
        return False
    own = pose_of(g, shape, scope)
    other = pose_of(g, twin, scope)
    return own.position == other.position and own.rotation == other.rotation


@wp.func
def pose_at(g: Geometry, entry: int) -> Pose:
    return pose_among(g.position, g.rotation, g.position_float, g.rotation_float, entry)


@inlined
def pose_among(
    position: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    position_float: wp.array[wp.vec3],
    rotation_float: wp.array[wp.mat33],
    entry: int,
) -> Pose:
    pose = Pose()
    if position.shape[0] > 0:
        pose.position = double_vector_at(position, entry)
        pose.rotation = matrix_at(rotation, entry)
    else:
        pose.position = to_double(position_float[entry])
        pose.rotation = wp.mat33d(rotation_float[entry])
    return pose


@wp.func
def first_instant_of(g: Geometry, span: int) -> int:
    """Index of the pose of shape 0 at the first instant of a span; that at the second instant is n entries later."""
    shapes = g.kind.shape[0]
    if g.instants == 1:
        return span * shapes
    return (span + world_of(g.instants, span)) * shapes


@wp.func
def is_somewhere(pose: Pose) -> bool:
    """Whether a shape with this pose can be hit: no number is NaN or larger than FARTHEST."""
    total = wp.float64(0.0)
    for row in range(3):
        for column in range(3):
            total += wp.abs(pose.rotation[row, column])
    return is_within_reach(pose.position) and total <= wp.float64(FARTHEST)


@wp.func
def is_within_reach(position: wp.vec3d) -> bool:
    """Whether every coordinate is within FARTHEST; false for NaN."""
    x = wp.abs(position[0]) <= wp.float64(FARTHEST)
    y = wp.abs(position[1]) <= wp.float64(FARTHEST)
    z = wp.abs(position[2]) <= wp.float64(FARTHEST)
    return x and y and z
