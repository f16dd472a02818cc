"""Sensors on a MuJoCo model, and their readings. The public names are in `rigcast`.

Each of these imports from those above it only:

    errors, names, faults...    error messages, and other small things
    yaml                        YAML files as plain values
    specs                       specifications of sensors, mounts, filters
    scene, preview              the geometry that rays are cast against; pictures of readings
    physics                     measurement effects of sensors
    rig                         sensors on a scene, and their frames
"""
