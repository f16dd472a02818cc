"""Sensors on a scene, and their frames."""
