"""The arrays of frames, and the launches that write them."""
