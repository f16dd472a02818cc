"""YAML files as plain values with the line and column of each, for error messages."""
