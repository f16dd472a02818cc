"""Rays for casts: checks of users' rays, and placement of sensors' rays."""
