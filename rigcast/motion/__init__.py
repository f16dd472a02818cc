"""Steps of a simulation: physics, with or without a controller, or a recorded motion."""
