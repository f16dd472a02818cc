"""Intersections of rays with triangles and closed forms."""
