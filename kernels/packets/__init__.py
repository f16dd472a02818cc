"""Packets of rays from one origin through both levels of the geometry.

A *packet* is LANES neighbouring rays, a *tile* PACKETS neighbouring packets. A tile has a basis: an axis a and, across
it, u and v. Every ray of it runs along a + p u + q v with its own p and q, so in the frame of a tree, turned once for
the whole tile, what concerns a ray's direction is a linear function of (1, p, q).

The tree over the shapes is walked by whole tiles, the triangles of a shape by packets. Boxes are held against the four
side planes of a tile's rays and the range of their directions, that of a shape against the ranges of the packets'
directions, and those within a shape against such a range and then against all rays of a packet. For a triangle with
vertices V0, V1, V2 as seen from the origin, the side of an edge on which a ray with direction d passes is s = d .
((Vi - Vj) x Vi) (see rigcast.kernels.shapes.triangle), of which the cross product serves all rays of the packet.
"""
