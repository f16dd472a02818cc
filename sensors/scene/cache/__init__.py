"""Caches on disk for the next start: trees over triangles, and packets of rays."""
