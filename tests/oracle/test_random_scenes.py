"""No ray is wrong in random scenes of every geom type, with rays of every kind, judged by mj_ray.

A failure names what replays it: `python -i tests/oracle/scenes.py SEED STATE KIND RAY`.
"""

import mujoco
import pytest
import scenes
from judged_casts import assert_none_wrong

import rigcast
from rigcast import oracle
from rigcast.oracle import Verdict

STATES = 2
SEEDS = range(20)  # x 2 states x 6 kinds x 600 rays = 144 000 rays
AT_RANDOM = ("everywhere", "towards", "inside")  # the kinds for which the edge band is bounded
BAND = 1e-3  # of the rays at random


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
            replay = f"python -i tests/oracle/scenes.py {seed} {k} {kind} RAY"
            found = assert_none_wrong(model, data, origins, directions, hits, what=replay)
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
