"""Launches whose arguments are packed once and that are then repeated."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

from .launch import command_for


def recorded(
    kernel: wp.Kernel,
    count: int,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
    block_dim: int = 256,
) -> Callable[[], None]:
    """A repeatable launch that keeps its arguments alive, which Warp 1.12 does not do.

    Structs among the arguments are read anew at each launch. block_dim: threads per block, on CUDA.
    """
    command = command_for(kernel, count, inputs, outputs, device, block_dim)
    arguments = (*inputs, *outputs)
    is_short = wp.get_device(device).is_cpu and _is_as_known(command, len(arguments))
    return (_Shortened if is_short else _ByWarp)(command, arguments)


def turn_struct(struct: Any, values: Any) -> None:
    """Give a Warp struct the values of another of its type, for the next launch.

    It holds no reference to their arrays: the caller must keep these alive.
    """
    own, others = struct.__ctype__(), values.__ctype__()
    ctypes.memmove(ctypes.byref(own), ctypes.byref(others), ctypes.sizeof(own))


def _is_as_known(command: wp.Launch, arguments: int) -> bool:
    """Whether a launch has the parts by which it is shortened; they are not public, and may differ in a later Warp."""
    forward = getattr(getattr(command, "hooks", None), "forward", None)
    params = getattr(command, "params", None)  # bounds and arguments
    return callable(forward) and isinstance(params, Sequence) and len(params) == 1 + arguments


class _ByWarp:
    def __init__(self, command: wp.Launch, arguments: Sequence[Any]) -> None:
        self._command, self._arguments = command, arguments

    def __call__(self) -> None:
        self._command.launch()


class _Shortened:
    """Calls the compiled function directly, with the arguments that Warp packed at the first launch.

    At each launch Warp looks up a struct for all arguments by their types and copies the arguments there, which takes
    as long as casting a few rays. This class keeps that struct and only renews the Warp structs in it. If Warp calls
    the function in another way than expected, every launch goes through Warp.
    """

    def __init__(self, command: wp.Launch, arguments: Sequence[Any]) -> None:
        self._command, self._arguments = command, arguments
        self._compiled = command.hooks.forward
        self._calls: list[tuple[Any, ...]] = []
        self._packed: ctypes.Structure | None = None
        self._structs: list[tuple[memoryview, memoryview]] = []  # (bytes in the packed copy, current bytes)

    def __call__(self) -> None:
        if self._packed is None:
            self._launch_by_warp()
            return
        for copy, struct in self._structs:
            copy[:] = struct
        self._compiled(*self._calls[0])

    def _launch_by_warp(self) -> None:
        hooks, self._command.hooks = self._command.hooks, self
        self._calls.clear()
        self._command.launch()
        self._command.hooks = hooks
        packed = getattr(self._calls[0][-1], "_obj", None) if len(self._calls) == 1 else None
        if isinstance(packed, ctypes.Structure):
            names = [field[0] for field in packed._fields_]
            given = zip(names, self._command.params[1:], self._arguments, strict=True)
            self._structs = [
                (_bytes_of(packed, getattr(type(packed), name).offset, ctypes.sizeof(value)), _bytes_of(value))
                for name, value, argument in given
                if isinstance(value, ctypes.Structure) and not isinstance(argument, wp.array)  # arrays do not change
            ]
            self._packed = packed

    def forward(self, *arguments: Any) -> None:
        """Called by Warp in place of the compiled function."""
        self._calls.append(arguments)
        self._compiled(*arguments)


def _bytes_of(struct: ctypes.Structure, first: int = 0, count: int | None = None) -> memoryview:
    """A view of `count` bytes of a struct from byte `first` on; of all its bytes if count is None."""
    size = ctypes.sizeof(struct) if count is None else count
    return memoryview((ctypes.c_ubyte * size).from_buffer(struct, first)).cast("B")
