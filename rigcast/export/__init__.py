"""Frames as files, and what every file of frames holds: per-ray fields on the host, and the names behind ids."""
