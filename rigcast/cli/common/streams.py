"""Preparation of a command's standard streams, however they were opened or closed."""

import io
import os
import sys
from typing import Any


def prepare_streams() -> None:
    """Drop output to standard error that cannot be written, reopen closed streams, and escape characters that
    the encoding of standard output does not have.

    Otherwise the next opened file would get a closed stream's number, and libraries would print into it.
    """
    for stream in (0, 1, 2):
        try:
            os.fstat(stream)
        except OSError:
            # takes the lowest free number; results still cannot be written
            opened = os.open(os.devnull, os.O_RDONLY if stream == 1 else os.O_RDWR)
            os.set_inheritable(opened, True)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    encoding = "utf-8" if sys.stderr is None else sys.stderr.encoding
    sys.stderr = io.TextIOWrapper(_Lossy(2, "w", closefd=False), encoding, "backslashreplace", write_through=True)


def why_unwritable() -> str | None:
    """The reason why standard output cannot be written, which is then redirected to nowhere; None if it can."""
    try:
        print(flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else the interpreter tries again at exit
        return error.strerror or str(error)
    return None


class _Lossy(io.FileIO):
    """A stream that drops what cannot be written, so that a command keeps its exit code in any case."""

    def write(self, text: Any, /) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)
