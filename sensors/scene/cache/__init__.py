"""What a start works out kept on disk for the next: trees over triangles, and packets of rays."""
