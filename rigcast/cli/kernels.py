"""Building a rig for a command: Warp kept quiet, a word where kernels are compiled first or a sensor is boxed in."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

import mujoco
import numpy as np
from rich.console import Console
from rich.markup import escape

from rigcast.quiet import quiet_warp
from rigcast.rig_file import RigConfig
from rigcast.sensors.rig.frame import Frame
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.scene.hits import Hits

_PATIENCE = 1.5  # s; cached kernels load in less
_TOUCHING = 0.01  # m


def ready_rig(
    console: Console,
    config: RigConfig,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    device: str | None,
    seed: int | None = None,
) -> Rig:
    """The rig of a file with its kernels compiled: it has cast once, into the state of `data`."""
    quiet_warp()
    with word_if_compiling(console):
        rig = config.build(model, device, seed)
        frames = rig.sense(data)
    close = [name for name, frame in frames.items() if _is_close(frame)]
    for sensor, hits in rig.cast(data, close).items():
        if word := _word_if_boxed_in(sensor, hits, model):
            console.print(escape(word), soft_wrap=True)
    return rig


def _is_close(frame: Frame) -> bool:
    """Whether half of the rays or more read less than _TOUCHING: too near, as what is invalid may be, too."""
    return float(np.mean(~(frame.range.numpy() >= _TOUCHING))) >= 0.5


def _word_if_boxed_in(sensor: str, hits: Hits, model: mujoco.MjModel) -> str:
    """Of a sensor most of whose rays end where they begin: on what, and how to leave that out."""
    distance, geom_id = hits.distance.numpy(), hits.geom_id.numpy()
    geoms = geom_id[(distance < _TOUCHING) & (geom_id >= 0)]
    if geoms.size < 0.5 * distance.size:
        return ""
    body = model.body(int(np.bincount(model.geom_bodyid[geoms]).argmax())).name
    share = f"{geoms.size / distance.size:.0%} of its rays end within {_TOUCHING:g} m"
    return f"{sensor}: {share}, most on body {body!r}; `filter: {{exclude_bodies: [{body}]}}` leaves that out"


@contextmanager
def word_if_compiling(console: Console) -> Iterator[None]:
    """Say that kernels are being compiled where the body takes longer than loading them."""
    timer = Timer(_PATIENCE, console.print, ["compiling kernels, on first use only: about 20 s"])
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
