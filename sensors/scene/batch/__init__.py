"""Many worlds of one model, from whatever holds their poses."""
