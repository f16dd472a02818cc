"""What rays are cast against: triangle trees, built once, and the shapes that place them in the world.

A *shape* is one closed-form solid or one instance of a triangle tree, with a pose. Poses are float64, so that the
difference between a ray's origin and a shape loses nothing however far both are from the world's origin; those of
simulations that know them in float32 are used as they are.

There may be many *worlds* of the same shapes, and each may be known at one *instant* or at several. A ray is cast
through one *span*: a world at its only instant, or what moves between two following ones. Every span has its own tree
over the shapes.
"""

import warp as wp

from .trees.nodes import Node, vec8, vec8i

NO_FACE = wp.constant(-1)
PATCHES = 8
"""Of a plot."""
FARTHEST = wp.constant(1.0e18)
"""Origins, positions, vertices and sizes [m] beyond this, in any coordinate, could overflow float32 where they are
multiplied: geometry there is refused or never hit, and rays from there give NaN."""


@wp.struct
class TriangleBlock:
    """Up to eight triangles and their unit normals, coordinate by coordinate; an absent one is all NaN."""

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
    """Four by eight cells of the surface of a height field in three cache lines; see rigcast.kernels.shapes.patches.

    x: where in Geometry.sides those of its nine columns of corners begin, and after them of centres, then of half sizes
    of the boxes of the four columns of patches. y: the same of its five rows, and of all eight patches.
    """

    z: wp.types.matrix(shape=(5, 9), dtype=wp.float32)  # row by row
    x: int
    y: int
    face: int  # the lower one of the first cell


@wp.struct
class Patch:
    """Two by two cells of a plot, which fill a cache line, as CUDA has them.

    Where there are but one row or column of cells, y or x of the last corners is NaN, and z that of those before.
    """

    x: wp.vec3  # of the columns of corners
    y: wp.vec3  # of the rows
    z: wp.mat33  # row by row
    face: int  # that of its plot


@wp.struct
class Geometry:
    """All that a cast reads.

    Casts have it in an array of one: Warp gives functions copies of structs, and of this one they are large.

    Shapes 0..n-1 have a kind (PLANE..SHEET of rigcast.kernels.shapes.solids), a size as there, and a pose in the world.
    With I instants in each of W worlds, I > 1, there are S = (I - 1) W spans, else S = W.
    """

    # triangle trees:
    nodes: wp.array[Node]
    blocks: wp.array[TriangleBlock]
    plots: wp.array[Plot]  # of height fields on the CPU
    sides: wp.array[float]  # what Plot says
    patches: wp.array[Patch]  # of height fields on CUDA, whose plots are nodes there
    # shapes:
    kind: wp.array[int]  # (n,)
    twin: wp.array[int]  # an earlier shape of the same kind and triangle tree, or -1
    visible: wp.array[wp.bool]  # of a cast, or empty; (n,) for all worlds, or (W n,)
    # (n,) for all worlds, or (W n,):
    size: wp.array[wp.vec3]
    root: wp.array[int]  # node of the triangle tree's root
    columns: wp.array[int]  # how many cells of a height field are in a row
    fields: wp.array[
        int
    ]  # shapes that are height fields whose plots are not stored as nodes; see packets.traverse.plots
    center: wp.array[wp.vec3]  # of the shape's box in its own frame, and the half size
    half: wp.array[wp.vec3]
    reach: wp.array[float]  # largest |coordinate| of the shape in its own frame
    # poses (W I n,), in float64 or in float32, the others are empty; for the cast as
    # rigcast.kernels.poses.moving has them:
    position: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]  # columns: the shape's axes in the world
    position_float: wp.array[wp.vec3]
    rotation_float: wp.array[wp.mat33]
    instants: int  # I
    movers: wp.array[int]  # the shapes that do not stand still through all instants; both empty where I is 1
    place: wp.array[int]  # (n,) of each shape among these, -1 of what stands still
    turn: wp.array[wp.vec3d]  # (S n,) rotation vector from a span's first instant to its second; empty where I is 1
    # the trees over the shapes, relative to an anchor each:
    top: wp.array[Node]  # (S m,)
    top_count: int  # m, the nodes of each
    anchor: wp.array[wp.vec3d]  # (S,)
    top_reach: wp.array[float]  # (S,) largest |coordinate| of the tree's boxes
