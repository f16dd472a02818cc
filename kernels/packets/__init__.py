"""Packets of rays from one origin through both levels of the geometry.

A *packet* is LANES neighbouring rays, a *tile* PACKETS neighbouring packets. A tile has a basis: an axis a and, across
it, u and v. Every ray of it runs along a + p u + q v with its own p and q, so in the frame of a tree, turned once for
the whole tile, what concerns a ray's direction is a linear function of (1, p, q).

The tree over the shapes is walked by whole tiles, the triangles of a shape by packets; boxes are held against the four
side planes of the rays, not against the rays, that of a shape against the ranges of the packets' directions. For a
triangle with vertices V0, V1, V2 as seen from the origin, the side
of an edge on which a ray passes is s = c . (a + p u + q v), c = (Vi - Vj) x (Vi + Vj) (see
rigcast.kernels.shapes.triangle). The products c . a, c . u and c . v serve all rays of the packet.
"""
