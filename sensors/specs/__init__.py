"""Specifications that users write: sensors, mounts, filters, presets. Knows models, not devices."""
