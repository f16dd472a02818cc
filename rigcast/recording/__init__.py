"""Runs as folders: every frame in its formats, recordings of whole runs, and their index."""
