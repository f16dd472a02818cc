"""Fields of a frame that are computed from its hits on first access, in the arrays of earlier readings."""

from collections.abc import Callable

import warp as wp

from rigcast.kernels.hits.out import FIELD_NAMES
from rigcast.kernels.host.held import Held

Compute = Callable[[wp.array | None], wp.array]
Show = Callable[[wp.array], wp.array]

_BY_CAST, _NONE = frozenset(FIELD_NAMES), frozenset[str]()


class LazyFields:
    """The lazily computed fields of one frame, by name.

    held: the frame's arrays, including those of fields. requested: fields that the frame of the present reading
    computes at once. for_cast: fields requested of the last reading that the present one's cast can write, which takes
    less time than computing them later. written: fields that it does write.
    """

    def __init__(self, held: Held) -> None:
        self.requested: set[str] = set()
        self.for_cast, self.written = _NONE, _NONE
        self._held = held
        # as computed, and as a frame shows them:
        self._computed: dict[str, wp.array] = {}
        self._shown: dict[str, wp.array] = {}
        # those requested of the present reading, and of the one before:
        self._current, self._before = set[str](), set[str]()

    def start(self) -> None:
        """Begin another reading, of which no field has been requested yet."""
        self._before, self._current, self.written, self.requested = self._current, set(), _NONE, set()
        self.for_cast = _BY_CAST & self._before

    @property
    def unanswered(self) -> set[str]:
        """The fields that the frame of a failed reading was to compute."""
        return self.requested - self._current

    def request_again(self, unanswered: set[str]) -> None:
        """Request these fields again, for users who hold those of the last reading; the frame computes them anew."""
        self.requested = self._before | unanswered

    def arrays(self, names: frozenset[str]) -> dict[str, wp.array]:
        """The arrays to which these fields were written before."""
        return {name: self._computed[name] for name in names}

    def get(self, name: str, compute: Compute, show: Show = lambda array: array) -> wp.array:
        """A field, computed on first access in the array that it had, or in a new one; as `show` returns it."""
        if name not in self._current:
            if name not in self.written:
                self._compute(name, compute, show)
            self._current.add(name)
            self._held.settle()
        return self._shown[name]

    def _compute(self, name: str, compute: Compute, show: Show) -> None:
        """Compute a field. A function of its own, so that its local references are gone when references are counted."""
        known = self._computed.get(name)
        array = compute(known)
        if array is not known:
            self._computed[name], self._shown[name] = array, show(array)
            self._held.add(array, self._shown[name])
