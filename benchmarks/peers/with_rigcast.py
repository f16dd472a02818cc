"""rigcast on the CPU, single rays."""

import importlib.metadata
from collections.abc import Sequence

import mujoco

import rigcast
from peers.answer import Answer, Caster, Floats
from rigcast.oracle import Things


def cast(model: mujoco.MjModel, data: mujoco.MjData, origins: Floats, directions: Floats) -> Answer:
    """Cast with a fresh scene."""
    return cast_with_props(model, data, origins, directions, ())


def cast_with_props(
    model: mujoco.MjModel, data: mujoco.MjData, origins: Floats, directions: Floats, props: Sequence[rigcast.Prop]
) -> Answer:
    """Cast with a fresh scene that has props, too."""
    scene = rigcast.Scene(model, "cpu", props)
    scene.update(data)
    hits = scene.cast(origins, directions).numpy()
    return Answer(hits.distance.astype(float), Things.of(model, props).numbers(hits), hits.normal.astype(float))


CASTER = Caster("rigcast", importlib.metadata.version("rigcast"), cast)
