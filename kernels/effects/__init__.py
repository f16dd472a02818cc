"""What sensors make of hits: light, and noise that can be repeated; by kind of sensor what only that has."""
