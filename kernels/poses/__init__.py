"""Poses of shapes and of mounted frames, and their motion between instants."""
