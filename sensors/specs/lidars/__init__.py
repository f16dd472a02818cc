"""Lidars as users write them down: beams, rosettes, patterns from files, and what disturbs them."""
