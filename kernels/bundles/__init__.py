"""Bundles of parallel rays through both levels of the geometry.

A *bundle* is up to MOST rays of one direction from neighbouring origins, such as those of a height scan. Its *middle*
ray walks the trees for all of them, through boxes that are wider by how far any of their origins is from its own along
each axis: whatever box a ray of the bundle enters, the middle one enters too, and no later.

For the triangles of a block all that concerns a ray's origin is a linear function of its offset x from the middle's
origin o. With a, b the ends of an edge as seen from o, e = a - b, the side of it on which a ray passes is

    s(x) = d . (e x ((a - x) + (b - x))) = d . (e x (a + b)) - 2 x . (d x e)

(see rigcast.kernels.shapes.triangle), and its height above the plane with the normal n is n . a - n . x.
"""
