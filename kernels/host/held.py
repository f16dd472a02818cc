"""Who holds an array.

Whoever holds an array, or what was made of one without a copy (a view, a numpy array, a tensor), holds a reference that
Python counts. Arrays with no more references than they had at first are held by nobody else.
"""

from sys import getrefcount


class Held:
    """Arrays that are given to others, and whether these still hold any."""

    def __init__(self, *arrays: object) -> None:
        self._arrays = list(arrays)
        self._at_first: list[int] = []

    def add(self, *arrays: object) -> None:
        """More of them, of which nobody may get any before `settle`."""
        self._arrays += arrays

    def settle(self) -> None:
        """Count the references to those that were added since the last time: from now on others may hold them."""
        if len(self._at_first) < len(self._arrays):
            self._at_first += self._references()[len(self._at_first) :]

    @property
    def by_others(self) -> bool:
        """Whether anybody holds one of them but who did at `settle`; nobody does before the first time."""
        return bool(self._at_first) and self._references() != self._at_first

    def _references(self) -> list[int]:
        return list(map(getrefcount, self._arrays))
