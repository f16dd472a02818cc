"""Where the shapes stand for a ray: in its world, at its time.

Between two instants a position moves on a straight line, and a rotation turns about one axis at an even rate:

    x(f) = x0 + f (x1 - x0)      R(f) = R0 exp(f [w])      exp([w]) = R0^T R1, |w| <= pi

which is what slerp does with quaternions. w is kept for each shape, in the shape's own frame.
"""

import warp as wp

from .geometry import Geometry
from .vectors import to_double


@wp.struct
class Moment:
    """Of what world a ray is, and when: where in the arrays of a Geometry the shapes are as it meets them."""

    span: int
    first_pose: int  # of shape 0, at the span's first instant
    first_shape: int  # of its size and box
    fraction: wp.float64  # of the way to the span's second instant


@wp.struct
class Pose:
    """Position [m], and rotation whose columns are the shape's axes, in the world."""

    position: wp.vec3d
    rotation: wp.mat33d


@wp.func
def world_of(g: Geometry, span: int) -> int:
    return span / wp.max(g.instants - 1, 1)


@wp.func
def moment_of(g: Geometry, span: int, fraction: wp.float64) -> Moment:
    shapes = g.kind.shape[0]
    world = world_of(g, span)
    moment = Moment()
    moment.span = span
    moment.first_pose = (world * g.instants + span % wp.max(g.instants - 1, 1)) * shapes
    moment.first_shape = first_of_world(g.size.shape[0], shapes, world)
    moment.fraction = fraction
    return moment


@wp.func
def first_of_world(size: int, shapes: int, world: int) -> int:
    """Where the entries of a world begin in an array of one for each shape, or of one for each shape of each world."""
    return wp.where(size > shapes, world * shapes, 0)


@wp.func
def root_of_top(g: Geometry, span: int) -> int:
    """The node at which the tree over the shapes begins."""
    return span * (g.top.shape[0] / g.anchor.shape[0])


@wp.func
def kept_pose(g: Geometry, at: int) -> Pose:
    pose = Pose()
    if g.position.shape[0] > 0:
        pose.position = g.position[at]
        pose.rotation = g.rotation[at]
    else:
        pose.position = to_double(g.position_float[at])
        pose.rotation = wp.mat33d(g.rotation_float[at])
    return pose


@wp.func
def pose_of(g: Geometry, shape: int, when: Moment) -> Pose:
    """Where a shape stands at a moment."""
    at = when.first_pose + shape
    pose = kept_pose(g, at)
    if when.fraction == wp.float64(0.0):
        return pose
    shapes = g.kind.shape[0]
    pose.position += when.fraction * (kept_pose(g, at + shapes).position - pose.position)
    pose.rotation = pose.rotation * rotation_by(when.fraction * g.turn[when.span * shapes + shape])
    return pose


@wp.func
def rotation_by(w: wp.vec3d) -> wp.mat33d:
    """exp([w]), the rotation about w by |w| [rad]: I + sin a [k] + 2 sin^2(a / 2) [k]^2 with a = |w|, k = w / a."""
    identity = wp.identity(n=3, dtype=wp.float64)
    angle = wp.length(w)
    if angle == wp.float64(0.0):
        return identity
    k = wp.skew(w / angle)
    half = wp.sin(wp.float64(0.5) * angle)
    return identity + wp.sin(angle) * k + (wp.float64(2.0) * half * half) * (k * k)


@wp.func
def turn_between(a: wp.mat33d, b: wp.mat33d) -> wp.vec3d:
    """w [rad] with b = a exp([w]), |w| <= pi."""
    q = wp.quat_from_matrix(wp.transpose(a) * b)
    v = wp.vec3d(q[0], q[1], q[2])
    sine = wp.length(v)
    if sine == wp.float64(0.0):
        return v
    toward = wp.where(q[3] < wp.float64(0.0), wp.float64(-1.0), wp.float64(1.0))
    return (toward * wp.float64(2.0) * wp.atan2(sine, wp.abs(q[3])) / sine) * v
