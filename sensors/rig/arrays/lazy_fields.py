"""Fields of a frame that are computed from its hits on first access, in the arrays of earlier readings."""

from collections.abc import Callable

import warp as wp

from rigcast.kernels.hits.out import FIELD_NAMES
from rigcast.kernels.host.held import Held

WorkOut = Callable[[wp.array | None], wp.array]
Show = Callable[[wp.array], wp.array]

_BY_CAST, _NONE = frozenset(FIELD_NAMES), frozenset[str]()


class LazyFields:
    """The lazily computed fields of one frame, by name.

    held: the frame's arrays, those of fields among them. asked: what the frame of the present reading works out at
    once. for_cast: of what was asked of the last reading, what the present one's cast can write, in less time than it
    takes later. written: what it does write.
    """

    def __init__(self, held: Held) -> None:
        self.asked: set[str] = set()
        self.for_cast, self.written = _NONE, _NONE
        self._held = held
        # as computed, and as a frame shows them:
        self._worked_out: dict[str, wp.array] = {}
        self._shown: dict[str, wp.array] = {}
        # those asked of the present reading, and of the one before:
        self._current, self._before = set[str](), set[str]()

    def start(self) -> None:
        """Begin another reading, of which no field has been requested yet."""
        self._before, self._current, self.written, self.asked = self._current, set(), _NONE, set()
        self.for_cast = _BY_CAST & self._before

    @property
    def unanswered(self) -> set[str]:
        """The fields that the frame of a failed reading was to compute."""
        return self.asked - self._current

    def ask_again(self, unanswered: set[str]) -> None:
        """Request these fields again, for users who hold those of the last reading; the frame computes them anew."""
        self.asked = self._before | unanswered

    def arrays(self, names: frozenset[str]) -> dict[str, wp.array]:
        """The arrays to which these fields were written before."""
        return {name: self._worked_out[name] for name in names}

    def get(self, name: str, work_out: WorkOut, show: Show = lambda array: array) -> wp.array:
        """A field, computed on first access in the array that it had, or in a new one; as `show` returns it."""
        if name not in self._current:
            if name not in self.written:
                self._work_out(name, work_out, show)
            self._current.add(name)
            self._held.settle()
        return self._shown[name]

    def _work_out(self, name: str, work_out: WorkOut, show: Show) -> None:
        """Compute a field. A function of its own, so that its local references are gone when references are counted."""
        known = self._worked_out.get(name)
        array = work_out(known)
        if array is not known:
            self._worked_out[name], self._shown[name] = array, show(array)
            self._held.add(array, self._shown[name])
