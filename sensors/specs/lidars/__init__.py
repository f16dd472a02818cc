"""Specifications of lidars: beams, rosettes, patterns from files, and measurement effects."""
