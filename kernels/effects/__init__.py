"""What sensors make of hits: beams, echoes, weather, stereo, time of flight, noise that can be repeated."""
