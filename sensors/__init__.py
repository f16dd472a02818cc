"""What a user mounts on a MuJoCo model, and what it reads. The public names are in `rigcast`.

Each of these imports from those above it only:

    errors, names, faults...    how mistakes are told, and other small things
    yaml                        YAML files as plain values
    specs                       what users write down
    scene, preview              what rays are cast against; pictures of what they read
    physics                     what sensors do to what their rays hit
    rig                         sensors on a scene, and the frames they give
"""
