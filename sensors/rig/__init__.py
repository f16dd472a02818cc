"""Sensors on a scene, and the frames they give."""
