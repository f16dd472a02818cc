"""Distances, faces and normals of the hits of packets, and how they are written to the caller's arrays."""
