"""What runs on the device: Warp functions and kernels, and their launchers. Knows arrays, nothing of MuJoCo or files.

Each of these imports from those above it only:

    elements, vectors, inline, on_cuda, launching    what all kernels share
    trees, rays                                      trees of boxes; the rays of a sensor
    geometry                                         what rays are cast against, as kernels have it
    shapes, poses                                    where a ray meets a shape; where shapes and sensors stand
    hits                                             what there is to know about a hit
    host, world                                      geometry made and kept up to date
    single, packets, packing, bundles                rays cast one by one, in packets, in bundles; which go together
    effects                                          what sensors make of hits
    cast                                             the cast of a sensor's rays, whichever way they go
"""
