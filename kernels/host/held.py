"""Who holds an array.

Whoever holds an array, or what was made of one without a copy (a view, a numpy array, a tensor), holds a reference that
Python counts. Arrays with no more references than they had at first are held by nobody else.
"""

from collections.abc import Sequence
from sys import getrefcount


def references(arrays: Sequence[object]) -> list[int]:
    """How many there are to each, to be compared with how many there were."""
    return list(map(getrefcount, arrays))
