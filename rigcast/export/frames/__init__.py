"""Formats of single frames: one file, or a few, for each frame."""
