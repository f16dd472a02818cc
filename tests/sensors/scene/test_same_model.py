"""Data of a copy of the model is read like the model's own, or refused; never with the other's shapes."""

import copy
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast import InputError, Lidar, Mount, Rig, Scene, Worlds
from rigcast.sensors.scene.same_model import PLACES, SHAPES

XML = """
<mujoco>
  <asset>
    <material name="red" rgba="1 0 0 1"/>
    <hfield name="hills" nrow="2" ncol="2" elevation="0 1 1 0" size="1 1 1 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1"/>
    <geom name="hills" type="hfield" hfield="hills" pos="5 0 0"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1" material="red"/>
    <body name="cart" pos="0 0 0.5">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <site name="mast"/>
      <camera name="eye"/>
    </body>
  </worldbody>
</mujoco>
"""
LIDAR = Lidar(name="top", mount=Mount(site="mast"), elevation_deg=[0], columns=1)


def sense(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    return Rig(model, [LIDAR]).sense(data)["top"].range.numpy()


def step(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    return Rig(model, [LIDAR]).step(data)[0].range.numpy()


def sense_worlds(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    own = mujoco.MjData(model)
    mujoco.mj_forward(model, own)
    return Rig(model, [LIDAR]).sense([own, data, own])["top"].range.numpy()[1]


def update(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    scene = Scene(model)
    scene.update(data)
    return scene.cast((0, 0, 0.5), (1, 0, 0)).distance.numpy()


READ = (sense, step, sense_worlds, update)


def copied(field: str | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model, and data of a copy of it in which a field was edited."""
    model = mujoco.MjModel.from_xml_string(XML)
    other = copy.copy(model)
    if field is not None:
        getattr(other, field)[-1] += 1
    data = mujoco.MjData(other)
    mujoco.mj_forward(other, data)
    return model, data


@pytest.mark.parametrize("read", READ)
def test_data_of_a_copy_is_looked_at(read: Callable[..., Any]) -> None:
    model, data = copied()
    np.testing.assert_allclose(read(model, data).ravel(), [3.9], rtol=1e-6)


@pytest.mark.parametrize("field", SHAPES)
@pytest.mark.parametrize("read", READ)
def test_data_of_a_copy_with_other_shapes_is_refused(read: Callable[..., Any], field: str) -> None:
    if field in ("geom_type", "geom_dataid"):
        model, data = copied()
        getattr(data.model, field)[-1] = 0
    else:
        model, data = copied(field)
    with pytest.raises(InputError, match=rf"of a copy of the model that has another {field}"):
        read(model, data)


@pytest.mark.parametrize("field", PLACES)
def test_data_of_a_copy_with_other_places_is_refused_where_poses_are_worked_out(field: str) -> None:
    model, data = copied(field)
    for read in (sense, step):
        with pytest.raises(InputError, match=rf"Rig: data is of a copy of the model that has another {field}"):
            read(model, data)
    for read in (sense_worlds, update):  # which use poses as they are
        read(model, data)


def test_a_copy_that_is_edited_later_is_seen_in_a_list_that_is_known() -> None:
    model, data = copied()
    rig, worlds = Rig(model, [LIDAR]), [data, data]
    rig.sense(worlds)
    data.model.geom_size[0, 0] += 1
    with pytest.raises(InputError, match=r"Worlds: batch\[1\] is of a copy"):
        rig.sense(worlds)
    with pytest.raises(InputError, match=r"Worlds: batch\[1\] is of a copy"):
        rig.sense(Worlds(worlds))
