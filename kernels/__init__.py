"""Code that runs on the device: Warp functions, kernels and launchers. Knows arrays, nothing of MuJoCo or files.

Each of these imports only from those above it:

    elements, vectors, inline, on_cuda, launching    what all kernels share
    trees, rays                                      trees of boxes; the rays of a sensor
    geometry                                         the geometry that rays are cast against, as structs
    shapes, poses                                    intersections of rays and shapes; poses of shapes and sensors
    hits                                             first hits, their distance, face and normal
    host, world                                      geometry built and kept up to date
    single, packets, packing, bundles                casts of rays one by one, in packets, in bundles; their grouping
    effects                                          measurement effects of sensors
    cast                                             casts of a sensor's rays, in any of these ways
"""
