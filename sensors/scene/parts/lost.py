"""Things whose pose is not finite: never hit, and named once."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import warn_user


class Lost:
    """Warns of each thing when it gets lost, and again only after it has been found.

    name: what a message calls thing k.
    """

    def __init__(self, name: Callable[[int], str]) -> None:
        self._name = name
        self._lost: set[int] = set()

    @property
    def any(self) -> bool:
        """Whether some were, the last time."""
        return bool(self._lost)

    def warn(self, time: float | None, is_finite: NDArray[np.bool_], first: int = 0) -> None:
        """time [s]: of the data. is_finite: (n,) whose poses are, of things `first` to `first` + n - 1.

        One warning names up to ten that are new.
        """
        lost = set((first + np.flatnonzero(~is_finite)).tolist())
        new = sorted(lost - self._lost)
        self._lost = lost | {k for k in self._lost if not first <= k < first + is_finite.size}
        if new:
            names = ", ".join(self._name(k) for k in new[:10])
            more = f" and {len(new) - 10} more" if len(new) > 10 else ""
            when = "" if time is None else f" at t = {time:g} s"
            message = f"pose not finite{when}, not hit: {names}{more}"
            warn_user(message, RuntimeWarning)
