"""Motion of shapes between two instants.

The position moves on a straight line and the rotation turns about one axis at a constant rate,

    x(f) = x0 + f (x1 - x0)      R(f) = R0 exp(f [w])      exp([w]) = R0^T R1, |w| <= pi

which is slerp of quaternions. Shapes are placed for every firing before its rays are cast, so a ray always meets shapes
at rest. Shapes that stand still in all worlds and at all instants are placed once. A shape whose pose is not finite at
one end of a span gets position NaN.

With n shapes in W worlds, m of which move, and F firings per world, the poses for the cast are those of all shapes of
each world at its first instant (W n,), followed by those of the m movers at each firing of each world (W F m,).
"""

import warp as wp

from rigcast.kernels.geometry import Geometry
from rigcast.kernels.launching.slices import launch_over_rays
from rigcast.kernels.rays.arrays import RayArrays, Rays, fraction_of, span_of

from .scope import first_instant_of, is_somewhere, pose_at, world_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def rotation_by(w: wp.vec3d) -> wp.mat33d:
    """The rotation exp([w]) about w by |w| [rad].

    Rodrigues' formula: I + sin a [k] + 2 sin^2(a / 2) [k]^2 with a = |w|, k = w / a.
    """
    identity = wp.identity(n=3, dtype=wp.float64)
    angle = wp.length(w)
    if angle == wp.float64(0.0):
        return identity
    k = wp.skew(w / angle)
    half = wp.sin(wp.float64(0.5) * angle)
    return identity + wp.sin(angle) * k + (wp.float64(2.0) * half * half) * (k * k)


@wp.func
def turn_between(a: wp.mat33d, b: wp.mat33d) -> wp.vec3d:
    """The rotation vector w [rad] with b = a exp([w]), |w| <= pi."""
    q = wp.quat_from_matrix(wp.transpose(a) * b)
    v = wp.vec3d(q[0], q[1], q[2])
    sine = wp.length(v)
    if sine == wp.float64(0.0):
        return v
    toward = wp.where(q[3] < wp.float64(0.0), wp.float64(-1.0), wp.float64(1.0))
    return (toward * wp.float64(2.0) * wp.atan2(sine, wp.abs(q[3])) / sine) * v


@wp.kernel
def place_shapes(
    first: int, g: Geometry, rays: RayArrays, position: wp.array[wp.vec3d], rotation: wp.array[wp.mat33d]
) -> None:
    """Write pose i of a cast, in the order given in this module's docstring."""
    i = first + wp.tid()
    shapes = g.kind.shape[0]
    still = world_of(g.instants, g.anchor.shape[0]) * shapes
    if i < still:
        start = pose_at(g, first_instant_of(g, i / shapes * (g.instants - 1)) + i % shapes)
        position[i] = start.position
        rotation[i] = start.rotation
        return
    movers = g.movers.shape[0]
    firing = (i - still) / movers
    shape = g.movers[(i - still) % movers]
    span = span_of(rays, firing)
    f = fraction_of(rays, firing)
    entry = first_instant_of(g, span) + shape
    pose = pose_at(g, entry)
    end = pose_at(g, entry + shapes)
    turn = g.turn[span * shapes + shape]
    position[i] = pose.position + f * (end.position - pose.position)
    if not (is_somewhere(pose) and is_somewhere(end)):
        position[i] = wp.vec3d(wp.float64(wp.nan))
    rotation[i] = pose.rotation
    if wp.length_sq(turn) > wp.float64(0.0):
        rotation[i] = pose.rotation * rotation_by(f * turn)


def at_firings(geometry: Geometry, rays: Rays) -> Geometry:
    """A geometry with the poses of its shapes at each firing of the rays."""
    placed, device = Geometry(), rays.directions.device
    placed.assign(geometry)
    count = rays.worlds * geometry.kind.size + rays.position.size * geometry.movers.size
    placed.position = wp.empty(count, dtype=wp.vec3d, device=device)
    placed.rotation = wp.empty(count, dtype=wp.mat33d, device=device)
    launch_over_rays(place_shapes, count, [geometry, rays.arrays], [placed.position, placed.rotation], device)
    return placed
