"""Rays on their way into a scene: those of a user, checked, and those of sensors, placed."""
