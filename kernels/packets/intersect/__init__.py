"""Tests of packets against boxes, against edges and planes of triangles, and against solids."""
