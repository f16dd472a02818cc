"""No ray is wrong in random scenes of every geom type, with rays of every kind, judged by mj_ray.

A failure names what replays it: `python -i tests/oracle/scenes.py SEED STATE KIND RAY`.
"""

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
import scenes

import rigcast
from rigcast import oracle
from rigcast.oracle import Comparison, Verdict

STATES = 2
SEEDS = range(20)  # x 2 states x 6 kinds x 600 rays = 144 000 rays
AT_RANDOM = ("everywhere", "towards", "inside")  # the kinds for which the edge band is bounded
BAND = 1e-3  # of the rays at random


def report(found: Comparison, seed: int, k: int, kind: str, origins: npt.ArrayLike, directions: npt.ArrayLike) -> str:
    """Return the first wrong ray, and how to replay it."""
    wrong = found.where(Verdict.WRONG)
    ray = int(wrong[0])
    origin = np.broadcast_to(np.asarray(origins), np.shape(directions))[ray].tolist()
    return (
        f"{len(wrong)} wrong rays. python -i tests/oracle/scenes.py {seed} {k} {kind} {ray}\n"
        f"origin {origin}, direction {np.asarray(directions)[ray].tolist()}\n"
        f"got {found.got.take(ray)}\nexpected {found.expected.take(ray)}"
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_no_ray_is_wrong_and_few_are_in_the_edge_band(seed: int) -> None:
    model = scenes.scene(seed)
    scene = rigcast.Scene(model)
    in_band = at_random = 0
    for k in range(STATES):
        data = scenes.state(model, seed, k)
        scene.update(data)
        for kind in scenes.KINDS:
            origins, directions = scenes.rays(model, data, seed, k, kind)
            hits = scene.cast(origins, directions).numpy()
            found = oracle.compare(model, data, origins, directions, hits)
            assert not found.where(Verdict.WRONG).size, report(found, seed, k, kind, origins, directions)
            if kind in AT_RANDOM:
                in_band += len(found.where(Verdict.EDGE))
                at_random += len(directions)
    assert in_band <= BAND * at_random, f"seed {seed}: {in_band} of {at_random} rays in the edge band"


def test_the_scenes_hold_every_supported_geom_type_seen_and_hidden() -> None:
    """Else the test above would prove nothing for a geom type that is never hit."""
    hit: set[int] = set()
    for seed in SEEDS:
        model = scenes.scene(seed)
        data = scenes.state(model, seed, 0)
        got = oracle.Oracle(model, data).cast(*scenes.rays(model, data, seed, 0, "towards"))
        hit |= set(model.geom_type[got.geom_id[got.geom_id >= 0]].tolist())
    assert hit == set(range(int(mujoco.mjtGeom.mjGEOM_MESH) + 1))
