"""Launches from several Python threads at once, of which only one at a time starts Warp or loads a module.

Warp does not ensure this itself. Two threads that load a module at once load it twice, under one name; when the first
copy is dropped, the code of both is gone, and calls of the other crash the process.
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
    """Initialise Warp, if it is not yet; call this before anything else of Warp."""
    with LOADING:
        wp.init()


def launch(
    kernel: wp.Kernel,
    size: int | Sequence[int],
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    device: wp.DeviceLike,
) -> None:
    """`wp.launch`, safe to call in several threads at once."""
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
    """A launch to be made later, of a kernel whose module is loaded now; None if there is nothing to launch."""
    with LOADING:
        return wp.launch(
            kernel, size, inputs=inputs, outputs=outputs, device=device, record_cmd=True, block_dim=block_dim
        )
