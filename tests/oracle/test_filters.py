"""Filters per cast over one shared scene, each against mj_ray."""

import pytest
import scenes
from judged_casts import assert_none_wrong

import rigcast
from rigcast import Filter, oracle

SEED = 21
MODEL = scenes.scene(SEED)
DATA = scenes.state(MODEL, SEED, 1)
NAMED = ("b0", "b1", "b2")


@pytest.fixture(scope="module")
def scene() -> rigcast.Scene:
    shared = rigcast.Scene(MODEL)
    shared.update(DATA)
    return shared


@pytest.mark.parametrize(
    "filter",
    [
        Filter(),
        Filter(geom_groups=(0, 2, 5)),
        Filter(geom_groups=()),
        Filter(static=False),
        Filter(geometry="visual"),
        Filter(geometry="collision"),
        Filter(exclude_bodies=("world",)),
        Filter(exclude_bodies=("world",), exclude_subtree=True),
        Filter(exclude_bodies=NAMED[:1]),
        Filter(exclude_bodies=NAMED),
        Filter(exclude_bodies=NAMED[:1], exclude_subtree=True),
        Filter(exclude_bodies=NAMED, exclude_subtree=True, static=False, geom_groups=(0, 1, 2, 3)),
        Filter(exclude_bodies=NAMED[1:], geometry="visual", geom_groups=(1, 3, 5)),
    ],
    ids=str,
)
def test_a_filter_sees_what_mj_ray_sees(scene: rigcast.Scene, filter: Filter) -> None:
    origins, directions = scenes.rays(MODEL, DATA, SEED, 1, "towards")
    hits = scene.cast(origins, directions, filter=filter).numpy()
    assert_none_wrong(MODEL, DATA, origins, directions, hits, filter)


def test_filters_change_what_is_hit() -> None:
    """Else the test above would prove nothing."""
    origins, directions = scenes.rays(MODEL, DATA, SEED, 1, "towards")
    everything = oracle.Oracle(MODEL, DATA).cast(origins, directions)
    for filter in (
        Filter(static=False),
        Filter(geometry="visual"),
        Filter(geometry="collision"),
        Filter(exclude_bodies=NAMED),
        Filter(exclude_bodies=NAMED, exclude_subtree=True),
    ):
        seen = oracle.Oracle(MODEL, DATA, filter).cast(origins, directions)
        assert (seen.geom_id != everything.geom_id).sum() > 20, str(filter)
