"""Schedules of readings, and readings that take time."""
