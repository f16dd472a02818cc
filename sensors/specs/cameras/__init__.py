"""Specifications of depth cameras: pixels, optics, and the principle of measurement."""
