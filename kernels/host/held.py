"""Detection whether others still hold an array.

Holding an array, or anything made from it without a copy (a view, a numpy array, a tensor), holds a reference that
Python counts. An array with no more references than at first is held by nobody else.
"""

from sys import getrefcount


class Held:
    """Arrays given to others, and whether others still hold any of them."""

    def __init__(self, *arrays: object) -> None:
        self._arrays = list(arrays)
        self._at_first: list[int] = []

    def add(self, *arrays: object) -> None:
        """Add arrays; they must not be given to others before `settle`."""
        self._arrays += arrays

    def settle(self) -> None:
        """Count the references to the arrays added since the last call; from now on they may be given to others."""
        if len(self._at_first) < len(self._arrays):
            self._at_first += self._references()[len(self._at_first) :]

    @property
    def by_others(self) -> bool:
        """Whether the number of references to any array differs from that at `settle`; False before the first call."""
        return bool(self._at_first) and self._references() != self._at_first

    def _references(self) -> list[int]:
        return list(map(getrefcount, self._arrays))
