"""What users write down: sensors, mounts, filters, presets. Knows models, not devices."""
