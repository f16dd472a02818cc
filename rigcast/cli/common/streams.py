"""The standard streams of a command, whatever they were given as."""

import io
import os
import sys
from typing import Any


def prepare_streams() -> None:
    """Let words on standard error that cannot be written be lost, open streams that are closed, and escape letters that
    the encoding of standard output does not have.

    The number of a closed stream would be that of the next file, into which libraries print what was meant for it.
    """
    for stream in (0, 1, 2):
        try:
            os.fstat(stream)
        except OSError:
            # takes the lowest number that is free; an answer still cannot be written
            opened = os.open(os.devnull, os.O_RDONLY if stream == 1 else os.O_RDWR)
            os.set_inheritable(opened, True)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    encoding = "utf-8" if sys.stderr is None else sys.stderr.encoding
    sys.stderr = io.TextIOWrapper(_Lossy(2, "w", closefd=False), encoding, "backslashreplace", write_through=True)


def why_unwritable() -> str | None:
    """Why an empty line more cannot be written to standard output, whose rest then goes nowhere; None where it can."""
    try:
        print(flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else the interpreter tries again at its end
        return error.strerror or str(error)
    return None


class _Lossy(io.FileIO):
    """Drops what cannot be written: a command ends with the exit code of its fault, whether or not that can be told."""

    def write(self, text: Any, /) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)
