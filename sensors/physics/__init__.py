"""Measurement effects of sensors: light, electronics, weather."""
