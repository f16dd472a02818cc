"""A filter lets through the geoms that mj_ray sees, by its further options."""

from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast.sensors.errors import InputError
from rigcast.sensors.specs.filter import Filter

# Spheres on the y axis; whichever ray along +x from x = -1 meets it, meets that one only.
XML = """
<mujoco>
  <asset>
    <material name="glass" rgba="1 1 1 0"/>
    <material name="faint" rgba="1 1 1 0.01"/>
  </asset>
  <worldbody>
    <geom name="static" size="0.1" pos="0 0 0" group="1"/>
    <geom name="clear" size="0.1" pos="0 1 0" rgba="1 1 1 0"/>
    <geom name="glass" size="0.1" pos="0 2 0" material="glass" rgba="1 1 1 1"/>
    <geom name="faint" size="0.1" pos="0 3 0" material="faint" rgba="1 1 1 0"/>
    <geom name="group7" size="0.1" pos="0 4 0" group="7"/>
    <geom name="group-1" size="0.1" pos="0 5 0" group="-1"/>
    <body name="shelf">
      <geom name="shelf" size="0.1" pos="0 6 0" group="2"/>
    </body>
    <body name="torso">
      <freejoint/>
      <geom name="torso" size="0.1" pos="0 7 0" group="3"/>
      <geom name="torso_visual" size="0.1" pos="0 8 0" contype="0" conaffinity="0"/>
      <body name="arm">
        <geom name="arm" size="0.1" pos="0 9 0" contype="0" group="4"/>
        <body name="hand">
          <joint/>
          <geom name="hand" size="0.1" pos="0 10 0" conaffinity="0" group="5"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
ALL = {"static", "faint", "group7", "group-1", "shelf", "torso", "torso_visual", "arm", "hand"}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def names(model: mujoco.MjModel, seen: np.ndarray) -> set[str]:
    return {model.geom(i).name for i in np.flatnonzero(seen)}


@pytest.mark.parametrize(
    ("filter_", "group", "static", "excluded"),
    [
        (Filter(), None, True, -1),
        (Filter(static=False), None, False, -1),
        *((Filter(geom_groups=[g]), {g}, True, -1) for g in range(6)),
        (Filter(geom_groups=[0, 5], static=False), {0, 5}, False, -1),
        (Filter(geom_groups=[]), set(), True, -1),
        *((Filter(exclude_bodies=[name]), None, True, i) for i, name in enumerate(["world", "shelf", "torso"])),
    ],
)
def test_agrees_with_mj_ray(
    model: mujoco.MjModel, filter_: Filter, group: set[int] | None, static: bool, excluded: int
) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups = None if group is None else np.array([i in group for i in range(6)], np.uint8)
    hit = np.zeros(model.ngeom, bool)
    for geom in range(model.ngeom):
        origin, found = np.array([-1.0, geom, 0.0]), np.full(1, -1, np.int32)
        mujoco.mj_ray(model, data, origin, np.array([1.0, 0, 0]), groups, static, excluded, found)
        hit[geom] = found[0] == geom
    assert names(model, filter_.visible(model)) == names(model, hit)


@pytest.mark.parametrize(
    ("filter_", "expected"),
    [
        (Filter(), ALL),
        (Filter(static=False), {"torso", "torso_visual", "arm", "hand"}),
        (Filter(exclude_bodies=["torso"]), ALL - {"torso", "torso_visual"}),
        (
            Filter(exclude_bodies=["torso"], exclude_subtree=True),
            {"static", "faint", "group7", "group-1", "shelf"},
        ),
        (Filter(exclude_bodies=["arm"], exclude_subtree=True), ALL - {"arm", "hand"}),
        (Filter(exclude_bodies=["hand", "shelf"]), ALL - {"hand", "shelf"}),
        (Filter(exclude_bodies=["world"]), ALL - {"static", "faint", "group7", "group-1"}),
        (Filter(exclude_bodies=["world"], exclude_subtree=True), set()),
        (Filter(geometry="visual"), {"torso_visual"}),
        (Filter(geometry="collision"), ALL - {"torso_visual"}),
    ],
)
def test_lets_through(model: mujoco.MjModel, filter_: Filter, expected: set[str]) -> None:
    seen = filter_.visible(model)
    assert seen.dtype == bool
    assert seen.shape == (model.ngeom,)
    assert names(model, seen) == expected


def test_a_model_without_geoms_has_nothing_to_see() -> None:
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert Filter(exclude_bodies=["world"], exclude_subtree=True).visible(empty).shape == (0,)


def test_unknown_bodies_are_all_named(model: mujoco.MjModel) -> None:
    with pytest.raises(InputError) as caught:
        Filter(exclude_bodies=["torso", "torsoo", "legs"]).visible(model)
    assert "exclude_bodies[1]: no body 'torsoo' in the model, expected one of" in str(caught.value)
    assert "did you mean 'torso'?" in str(caught.value)
    assert "exclude_bodies[2]: no body 'legs' in the model" in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"geom_groups": [6]}, r"geom_groups\[0\]: must be less than or equal to 5, got 6"),
        ({"geom_groups": [1.5]}, r"geom_groups\[0\]: must be an integer, got 1.5"),
        ({"geom_groups": 1}, "geom_groups: "),
        ({"geom_groups": [2, 0, 2]}, r"geom_groups: must have each group at most once, got \[2, 0, 2\]$"),
        (
            {"geom_groups": np.array([1, 0, 1, 0, 0, 0], np.uint8)},
            r"each group at most once, got \[1, 0, 1, 0, 0, 0\]; six flags, as for mj_ray, would be \[0, 2\]$",
        ),
        ({"exclude_subtree": True}, "exclude_subtree needs exclude_bodies"),
        ({"exclude_bodies": "torso"}, "exclude_bodies: must be a list, got 'torso'"),
        ({"geometry": "visul"}, "geometry: must be 'all', 'visual' or 'collision', got 'visul'"),
        ({"static": 1}, "static: must be true or false, got 1"),
        ({"exclude_body": ["a"]}, "unknown key 'exclude_body', .*did you mean 'exclude_bodies'?"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Filter(**arguments)
