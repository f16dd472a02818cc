"""Objects whose pose is not finite: they are never hit and named in one warning."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import warn_user


class Lost:
    """Warns when an object's pose stops being finite; warns again only after it has been finite in between.

    name: function that gives the name of object k in messages.
    """

    def __init__(self, name: Callable[[int], str]) -> None:
        self._name = name
        self._lost: set[int] = set()

    @property
    def any(self) -> bool:
        """Whether any object was lost at the last call."""
        return bool(self._lost)

    def warn(self, time: float | None, is_finite: NDArray[np.bool_], first: int = 0) -> None:
        """Warn of newly lost objects. time: of the data [s]. is_finite: (n,) for the poses of objects `first`, ...

        One warning names up to ten new ones.
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
