"""The tests of commands. A package, because mypy takes no two modules called `conftest`."""
