"""Exclusive use by one thread at a time: another thread is refused, so that it cannot interrupt a reading."""

from threading import RLock

from .errors import InputError


class InUse:
    """A reentrant lock that refuses other threads: `with in_use:`.

    Raises InputError in any other thread instead of waiting: readings would otherwise depend on which came first.
    """

    __slots__ = ("_acquire", "_release")

    def __init__(self) -> None:
        lock = RLock()
        self._acquire, self._release = lock.acquire, lock.release

    def __enter__(self) -> None:
        if not self._acquire(False):
            raise InputError(
                "a Scene, or the Rig on it, is in use by another thread, expected one thread at a time: make one for "
                "each thread, or let them take turns by a threading.Lock"
            )

    def __exit__(self, *_: object) -> None:
        self._release()
