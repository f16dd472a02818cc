"""Frames and runs as files: OpenEXR images, PLY point clouds, NumPy archives and their index."""
