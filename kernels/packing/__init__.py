"""Which rays are cast together."""
