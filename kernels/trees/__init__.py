"""Trees of boxes: over triangles, and over shapes."""
