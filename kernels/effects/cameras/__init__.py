"""What depth cameras make of hits: stereo, time of flight, readings that are lost."""
