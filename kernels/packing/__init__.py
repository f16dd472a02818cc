"""Grouping of rays that are cast together: packets, bundles, warps."""
