"""Bundles of parallel rays through both levels of the geometry.

A *bundle* is up to BUNDLE rays (rigcast.kernels.packing.bundling) of the same direction from neighbouring origins, such
as those of a height scan. Its *middle* ray traverses the trees for all of them. Boxes are widened along each axis by
the largest offset of any origin from the middle's: whichever box a ray of the bundle enters, the middle ray enters too,
and no later.

For a triangle, everything that depends on a ray's origin is a linear function of its offset x from the middle's origin
o. With a, b the ends of an edge relative to o and e = a - b, the ray passes the edge on the side given by the sign of

    s(x) = d . (e x ((a - x) + (b - x))) = d . (e x (a + b)) - 2 x . (d x e)

(see rigcast.kernels.shapes.triangle), and its height above the plane with the normal n is n . a - n . x.
"""
