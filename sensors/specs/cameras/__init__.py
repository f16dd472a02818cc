"""Depth cameras as users write them down: pixels, lenses, and how depth is measured."""
