"""When readings fall due, and readings that take time."""
