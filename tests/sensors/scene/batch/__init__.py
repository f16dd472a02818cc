"""Batches of worlds. A package, because mypy takes no two modules called `conftest`."""
