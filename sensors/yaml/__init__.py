"""YAML files as plain values, with the line and column of each, so that a fault can be pointed at."""
