"""Rays that go through the trees by themselves, each with a stack of its own."""
