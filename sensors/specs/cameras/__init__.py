"""Depth cameras as users write them down: pixels, and how depth is measured."""
