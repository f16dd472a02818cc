"""What rays are cast against: the parts of a model, kept as it changes."""
