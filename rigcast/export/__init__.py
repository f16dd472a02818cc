"""Frames as files; per-ray fields on the host, and tables of ids, for all formats."""
