"""Hits: which one is first, its distance, face and normal, and the arrays that it is written to."""
