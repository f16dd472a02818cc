"""Bounding volume hierarchies over anything that has a box: building, refitting and traversal."""
