"""Launches, in any threads at once: Warp starts, and loads what it launches, in one of them at a time.

Warp itself takes no care of that. Two threads that load a module at once load it twice, under one name; it goes when
the first of the two is dropped, and where the other is called there is nothing any more, which ends the process.
"""

import os
from collections.abc import Sequence
from threading import RLock
from typing import Any

import warp as wp

LOADING = RLock()
"""Held while Warp starts or loads a module."""
_loaded: set[tuple[wp.Kernel, str]] = set()

if hasattr(os, "register_at_fork"):
    # a child has no other thread that could release it
    os.register_at_fork(before=LOADING.acquire, after_in_parent=LOADING.release, after_in_child=LOADING.release)


def start_warp() -> None:
    """Let Warp look for devices, unless it has; before anything else of Warp."""
    with LOADING:
        wp.init()


def launch(
    kernel: wp.Kernel,
    size: int | Sequence[int],
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
) -> None:
    """`wp.launch`."""
    on_device = kernel, wp.get_device(device).alias
    if on_device not in _loaded and command_for(kernel, size, inputs, outputs, device) is not None:
        _loaded.add(on_device)
    wp.launch(kernel, size, inputs=inputs, outputs=outputs, device=device)


def command_for(
    kernel: wp.Kernel,
    size: int | Sequence[int],
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
    block_dim: int = 256,
) -> wp.Launch | None:
    """A launch that is not made yet, of a kernel that is loaded; None where there is nothing to launch."""
    with LOADING:
        return wp.launch(
            kernel, size, inputs=inputs, outputs=outputs, device=device, record_cmd=True, block_dim=block_dim
        )
