"""Many worlds of one model, from various sources of poses."""
