"""Packets of rays with a common origin, cast through both levels of the geometry on the CPU.

A *packet* is LANES neighbouring rays, a *tile* PACKETS neighbouring packets. A tile has a basis: an axis a and, across
it, u and v. Each of its rays runs along a + p u + q v with its own p and q. The basis is turned into the frame of a
tree once per tile; there, everything that depends on a ray's direction is a linear function of (1, p, q).

Whole tiles traverse the tree over the shapes, packets traverse the triangle tree of a shape. The boxes tested are:

- nodes over the shapes: against the tile's frustum (four side planes) and the range of its directions;
- the box of a shape: against each packet's range of directions;
- nodes of a triangle tree: against the packet's range of directions, then against each of its rays.

Triangles are tested by their edges. With vertices V0, V1, V2 relative to the origin, a ray with direction d passes an
edge on the side given by the sign of s = d . ((Vi - Vj) x Vi) (see rigcast.kernels.shapes.triangle). The cross product
is computed once for all rays of the packet.

Several functions copy the fields of a struct into locals before a loop and write them back after it: through a struct,
Warp copies the whole field to read one element of it, and LLVM does not vectorise the loop.
"""
