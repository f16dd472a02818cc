"""Scenes: the geometry of a model that rays are cast against, kept up to date."""
