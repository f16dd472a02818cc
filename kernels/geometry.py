"""The geometry that rays are cast against: triangle trees, built once, and the shapes that place them in the world.

A *shape* is one closed-form solid or one instance of a triangle tree, with a pose. Poses are float64, so that the
difference between a ray's origin and a shape loses no precision far from the world's origin. Poses of simulations that
have them in float32 are used as they are.

There may be many *worlds* of the same shapes. The poses of each are known at one *instant* or at several. A ray is cast
through one *span*: a world at its only instant, or the motion between two consecutive instants. Every span has its own
tree over the shapes.
"""

import warp as wp

from .trees.nodes import Four, Node, vec8, vec8i

NO_FACE = wp.constant(-1)
PATCHES = 8
"""Number of patches of a plot."""
FARTHEST = wp.constant(1.0e18)
"""Largest coordinate [m] of origins, positions, vertices and sizes. Beyond it products could overflow float32: such
geometry is refused or never hit, and rays from there give NaN."""


@wp.struct
class TriangleBlock:
    """Up to eight triangles with their unit normals, as a structure of arrays; absent triangles are NaN."""

    x0: vec8
    y0: vec8
    z0: vec8
    x1: vec8
    y1: vec8
    z1: vec8
    x2: vec8
    y2: vec8
    z2: vec8
    normal_x: vec8
    normal_y: vec8
    normal_z: vec8
    face: vec8i


@wp.struct
class Plot:
    """Four by eight cells of a height field's surface in three cache lines; see rigcast.kernels.shapes.patches.

    x is an index into Geometry.sides: 9 x coordinates of the columns of corners, then 4 centres and 4 half sizes along
    x of the boxes of the columns of patches. y likewise: 5 y coordinates of the rows of corners, then 8 centres and 8
    half sizes along y of all patches.
    """

    z: wp.types.matrix(shape=(5, 9), dtype=wp.float32)  # heights of the corners [m], row by row
    x: int
    y: int
    face: int  # number of the lower face of the first cell


@wp.struct
class Patch:
    """Two by two cells of a plot, which fill a cache line; used on CUDA.

    If there is only one row or column of cells, y or x of the last corners is NaN, and z repeats that before them.
    """

    x: wp.vec3  # of the columns of corners [m]
    y: wp.vec3  # of the rows of corners [m]
    z: wp.mat33  # heights of the corners [m], row by row
    face: int  # as of the patch's plot


@wp.struct
class Geometry:
    """Everything that a cast reads.

    Functions take it in an array of one: Warp copies structs passed by value, and this one is large.

    Shapes 0..n-1 have a kind (PLANE..SHEET of rigcast.kernels.shapes.solids), a size as defined there, and a pose in
    the world. W worlds with I instants each have S = W spans if I = 1, else S = (I - 1) W.
    """

    # triangle trees:
    nodes: wp.array[Node]  # on the CPU
    fours: wp.array[Four]  # on CUDA
    blocks: wp.array[TriangleBlock]
    plots: wp.array[Plot]  # of height fields on the CPU
    sides: wp.array[float]  # see Plot
    patches: wp.array[Patch]  # of height fields on CUDA, where plots are stored as nodes
    # shapes:
    kind: wp.array[int]  # (n,)
    twin: wp.array[int]  # (n,) the last earlier shape of the same kind and triangle tree, or -1
    visible: wp.array[wp.bool]  # set by each cast, else empty; (n,) for all worlds, or (W n,)
    # (n,) for all worlds, or (W n,):
    size: wp.array[wp.vec3]
    root: wp.array[int]  # of the triangle tree, among nodes or fours
    columns: wp.array[int]  # cells per row of a height field, else 0
    hfields: wp.array[int]  # (k,) height fields whose plots are not stored as nodes; see packets.traverse.plots
    center: wp.array[wp.vec3]  # of the shape's box in its own frame [m]
    half: wp.array[wp.vec3]  # half size of that box [m]
    reach: wp.array[float]  # largest |coordinate| of the shape in its own frame [m]
    # poses (W I n,), in float64 or in float32, the other pair is empty; in a cast with I > 1 laid out as in
    # rigcast.kernels.poses.moving:
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]  # columns: the shape's axes in the world
    position_float: wp.array[wp.vec3]
    rotation_float: wp.array[wp.mat33]
    instants: int  # I
    movers: wp.array[int]  # shapes that move between any two instants; movers and place are empty if I = 1
    place: wp.array[int]  # (n,) index of each shape among the movers, -1 for shapes that stand still
    turn: wp.array[wp.vec3d]  # (S n,) rotation vector [rad] from a span's first instant to its second; empty if I = 1
    # the trees over the shapes, each relative to its anchor:
    top: wp.array[Node]  # (S m,) on the CPU
    top_fours: wp.array[Four]  # (S m,) on CUDA
    top_count: int  # m, the nodes of each tree
    anchor: wp.array[wp.vec3d]  # (S,) in the world [m]
    top_reach: wp.array[float]  # (S,) largest |coordinate| of the tree's boxes [m]
