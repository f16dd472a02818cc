"""Optical properties of surfaces: from the model's colours, or given by the user."""

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from lidar_scenes import ahead, model_of, sense, wall

from rigcast import InputError, LidarFrame, Prop, Rig, Scene, Surface, load_rig

ASSET = """
<material name="blue" rgba="0 0 1 0.25" reflectance="0.3"/>
<mesh name="cube" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"/>
"""
WORLD = """
<geom name="plain" size="1"/>
<geom name="red" size="1" rgba="1 0 0 0.5"/>
<geom name="blue" size="1" material="blue"/>
<geom name="painted" size="1" material="blue" rgba="1 1 1 0.9"/>
<body name="box"><geom name="inner" size="1"/></body>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return model_of(WORLD, ASSET)


@pytest.fixture
def prop(tmp_path: Path) -> Prop:
    file = tmp_path / "cube.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return Prop(name="sign", file=file)


def looks(scene: Scene) -> dict[str, list[float]]:
    surfaces = scene.looks().surfaces
    return {
        name: getattr(surfaces, name).numpy().astype(float).round(4).tolist()
        for name in ("reflectivity", "transmission", "mirror")
    }


def test_surfaces_are_those_of_the_drawn_colours(model: mujoco.MjModel, prop: Prop) -> None:
    assert looks(Scene(model, props=[prop])) == {
        "reflectivity": [0.5, 0.2126, 0.0722, 1.0, 0.5, 0.5],
        "transmission": [0, 0.5, 0.75, 0.1, 0, 0],
        "mirror": [0, 0, 0.3, 0.3, 0, 0],
    }


def test_the_last_entry_for_a_thing_counts_and_leaves_what_it_does_not_say(model: mujoco.MjModel, prop: Prop) -> None:
    surfaces = [
        Surface(material="blue", reflectivity=0.9),
        Surface(geom="painted", reflectivity=0.2, transmission=0.0),
        Surface(body="box", mirror=0.7),
        Surface(body="world", mirror=0.1),
        Surface(prop="sign", reflectivity=5.0),
    ]
    assert looks(Scene(model, props=[prop], surfaces=surfaces)) == {
        "reflectivity": [0.5, 0.2126, 0.9, 0.2, 0.5, 5.0],
        "transmission": [0, 0.5, 0.75, 0, 0, 0],
        "mirror": [0.1, 0.1, 0.1, 0.1, 0.7, 0.1],
    }


def test_colours_edited_at_run_time_are_seen(model: mujoco.MjModel) -> None:
    scene = Scene(model)
    before = looks(scene)
    model.geom_rgba[0] = [1, 1, 1, 0.5]
    assert before["reflectivity"][0] == 0.5
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    scene.update(data)
    assert looks(scene)["reflectivity"][0] == 1.0
    assert looks(scene)["transmission"][0] == 0.5


def lidar_frame(rig: Rig, data: mujoco.MjData) -> LidarFrame:
    frame = rig.sense(data)["top"]
    assert isinstance(frame, LidarFrame)
    return frame


@pytest.mark.parametrize("slope", [0, 30, 60])
def test_the_intensity_of_an_ideal_lidar_is_reflectivity_times_cosine(slope: float) -> None:
    room = model_of(f'<geom type="plane" size="0 0 1" euler="0 {slope - 90} 0" pos="5 0 0" rgba="0.8 0.8 0.8 1"/>')
    frame = sense(room, ahead())
    np.testing.assert_allclose(frame.intensity.numpy(), 0.8 * np.cos(np.deg2rad(slope)), rtol=1e-5)
    assert frame.intensity.dtype.__name__ == "float32"


def test_the_intensity_of_a_miss_is_0_and_colours_edited_later_do_not_show() -> None:
    assert sense(model_of(wall("wall", 5)), ahead(max_range=4.0)).intensity.numpy().item() == 0
    model = model_of(wall("wall", 5))
    rig = Rig(model, [ahead()])
    data = mujoco.MjData(model)
    frame = lidar_frame(rig, data)
    model.geom_rgba[0, :3] = 1
    later = lidar_frame(rig, data)
    assert frame.intensity.numpy().item() == pytest.approx(0.5)
    assert later.intensity.numpy().item() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("surface", "message"),
    [
        ({"geom": "plane"}, "surfaces[0]: geom: no geom 'plane' in the model, expected one of plain"),
        (
            {"material": "bleu"},
            "surfaces[0]: material: no material 'bleu' in the model, expected one of blue; did you mean",
        ),
        ({"body": "crate"}, "surfaces[0]: body: no body 'crate' in the model, expected one of world, box"),
        ({"prop": "crate"}, "surfaces[0]: prop: no prop 'crate', and none with a name exists"),
    ],
)
def test_names_that_are_not_there_are_refused(model: mujoco.MjModel, surface: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        Rig(model, [ahead()], surfaces=[Surface(**surface)])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "give one of geom, material, body and prop, got none"),
        ({"geom": "a", "body": "b"}, "give one of geom, material, body and prop, got geom and body"),
        ({"geom": "a", "transmission": 1.5}, "transmission: must be less than or equal to 1, got 1.5"),
        ({"geom": "a", "reflectivity": -1}, "reflectivity: must be greater than or equal to 0, got -1"),
    ],
)
def test_surfaces_that_make_no_sense_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        Surface(**given)


RIG = """
sensors:
  - name: top
    type: lidar
    elevation_deg: [0]
    columns: 1
    mount: {}
    noise: {range_std: 0.02, dropout: 0.001}
    detection: {range: 40, accuracy: 0.03, accuracy_range: 10}
    beam: {divergence_deg: [0.17, 0.09]}
    returns: dual
    max_surfaces: 4
    mirrors: true
    weather: {rain_rate: 5, visibility: 300}
surfaces:
  - {geom: plain, reflectivity: 0.9}
  - {material: blue, transmission: 0.9}
"""


def test_a_rig_file_takes_all_of_it(model: mujoco.MjModel, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(RIG)
    rig = load_rig(tmp_path / "rig.yaml", model)
    (lidar,) = rig.sensors
    assert lidar.noise.range_std == 0.02  # type: ignore[union-attr]
    assert looks(rig.scene)["reflectivity"][0] == pytest.approx(0.9)
    frame = lidar_frame(rig, mujoco.MjData(model))
    assert frame.range.shape == frame.intensity.shape == frame.ring.shape == frame.stamp.shape == (1, 1, 2)
    assert frame.points.shape == frame.normal.shape == frame.points_world.shape == (1, 1, 2, 3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("range_std: 0.02", "range_sdt: 0.02", "rig.yaml:8:13: sensors[0].noise.range_sdt: unknown key 'range_sdt'"),
        ("dropout: 0.001", "dropout: 2", "sensors[0].noise.dropout: must be less than or equal to 1, got 2"),
        ("range: 40, ", "", "sensors[0].detection.range: required, but not given"),
        ("accuracy: 0.03, ", "", "sensors[0].detection: give both of accuracy and accuracy_range"),
        ("detection: {range: 40, accuracy: 0.03, accuracy_range: 10}", "", "sensors[0]: weather needs detection"),
        ("visibility: 300", "visibility: 0", "weather.visibility: must be greater than or equal to 5, got 0"),
        (
            "returns: dual",
            "returns: both",
            "sensors[0].returns: must be 'first', 'last', 'strongest' or 'dual', got 'both'",
        ),
        ("max_surfaces: 4", "max_surfaces: 5", "sensors[0].max_surfaces: must be less than or equal to 4, got 5"),
        ("geom: plain", "geom: plian", "surfaces[0].geom: no geom 'plian' in the model"),
    ],
)
def test_mistakes_are_shown_where_they_are(
    model: mujoco.MjModel, tmp_path: Path, old: str, new: str, message: str
) -> None:
    (tmp_path / "rig.yaml").write_text(RIG.replace(old, new))
    with pytest.raises(InputError, match=re.escape(message)):
        load_rig(tmp_path / "rig.yaml", model)
