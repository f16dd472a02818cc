"""Launches that are made again and again, with arguments that were packed once."""

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
    """A launch whose arguments are kept for as long as it is, as Warp 1.12 does not keep them.

    It reads what structs among the arguments hold by then. block_dim: threads of a block, on CUDA.
    """
    command = command_for(kernel, count, inputs, outputs, device, block_dim)
    return (_OnCpu if wp.get_device(device).is_cpu else _OnCuda)(command, (*inputs, *outputs))


class _OnCuda:
    def __init__(self, command: wp.Launch, arguments: Sequence[Any]) -> None:
        self._command, self._arguments = command, arguments

    def __call__(self) -> None:
        self._command.launch()


class _OnCpu:
    """Calls the compiled function as Warp did the first time, without the way there, which takes as long as a few rays.

    Each time Warp looks up a struct of all arguments by their types, and copies all of them there. The copy of the
    first time serves here, in which structs are renewed. Should Warp call the function in another way, it goes on to.
    """

    def __init__(self, command: wp.Launch, arguments: Sequence[Any]) -> None:
        self._command, self._arguments = command, arguments
        self._compiled = command.hooks.forward
        self._calls: list[tuple[Any, ...]] = []
        self._packed: ctypes.Structure | None = None
        self._structs: list[tuple[memoryview, memoryview]] = []  # in the copy, and as they are by now

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
                if isinstance(value, ctypes.Structure) and not isinstance(argument, wp.array)  # which stays as it is
            ]
            self._packed = packed

    def forward(self, *arguments: Any) -> None:
        """Called by Warp in place of the compiled function."""
        self._calls.append(arguments)
        self._compiled(*arguments)


def _bytes_of(struct: ctypes.Structure, first: int = 0, count: int | None = None) -> memoryview:
    """So many bytes of a struct where they are, all of them where count is None."""
    size = ctypes.sizeof(struct) if count is None else count
    return memoryview((ctypes.c_ubyte * size).from_buffer(struct, first)).cast("B")
