"""Trees of boxes over anything that has a box: how they are grown, and the walk through them."""
