"""rigcast on the CPU, single rays."""

import importlib.metadata

import mujoco

import rigcast
from peers.answer import Answer, Caster, Floats


def cast(model: mujoco.MjModel, data: mujoco.MjData, origins: Floats, directions: Floats) -> Answer:
    """Cast with a fresh scene."""
    scene = rigcast.Scene(model, device="cpu")
    scene.update(data)
    hits = scene.cast(origins, directions).numpy()
    return Answer(hits.distance.astype(float), hits.geom_id, hits.normal.astype(float))


CASTER = Caster("rigcast", importlib.metadata.version("rigcast"), cast)
