"""Simulations as commands and data sets run them: initial state, and steps by physics or by a recorded motion."""
