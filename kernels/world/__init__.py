"""What rays are cast against, made and kept up to date: triangle trees, shapes, and the trees over them."""
