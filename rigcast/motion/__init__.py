"""What takes a simulation a step further: physics, with or without a controller, or a recorded motion."""
