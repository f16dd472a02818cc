"""The arrays of frames, and the launches that read into them."""
