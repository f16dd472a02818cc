"""The geometry that rays are cast against, built and kept up to date: triangle trees, shapes, trees over shapes."""
