"""Names, bodies and classes of ids."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import rigcast
from rigcast.export.ids import IdTable
from rigcast.rig_file import open_rig
from rigcast.sensors.errors import InputError

XML = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="robot">
      <geom name="hull" size="0.1"/>
      <body name="arm"><geom size="0.1"/><body name="tool"><geom name="blade" size="0.1"/></body></body>
    </body>
    <body name="rack_1"><geom name="shelf" size="0.1"/></body>
    <body name="rack_2"><geom size="0.1"/></body>
  </worldbody>
</mujoco>
"""
SOFT = """
<mujoco>
  <worldbody>
    <body name="robot"><geom size="0.1"/></body>
    <flexcomp name="towel" type="grid" count="2 2 1" spacing="1 1 1" dim="2" mass="1" radius="0.1"/>
  </worldbody>
  <deformable>
    <skin name="hide" vertex="0 0 0  1 0 0  0 1 0" face="0 1 2">
      <bone body="robot" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/>
    </skin>
  </deformable>
</mujoco>
"""
PROPS = {"sign": rigcast.Mount(), "post": rigcast.Mount(body="robot")}
# floor, hull, geom_2 of the arm, blade, shelf, geom_5 of rack_2
MODEL = mujoco.MjModel.from_xml_string(XML)


@pytest.mark.parametrize(
    ("classes", "expected"),
    [
        ({}, ["", "", "", "", "", ""]),
        ({"robot": ["robot"]}, ["", "robot", "robot", "robot", "", ""]),
        ({"robot": ["robot"], "arm": ["arm"]}, ["", "robot", "arm", "arm", "", ""]),
        ({"arm": ["arm"], "robot": ["robot"], "knife": ["blade"]}, ["", "robot", "arm", "knife", "", ""]),
        ({"rack": ["rack_*"], "ground": ["floor"]}, ["ground", "", "", "", "rack", "rack"]),
        ({"rest": ["world"], "rack": ["rack_[12]"]}, ["rest", "rest", "rest", "rest", "rack", "rack"]),
        ({"one": ["geom_2", "geom_5"]}, ["", "", "one", "", "", "one"]),
    ],
)
def test_a_geom_has_the_class_of_the_nearest_name(classes: dict[str, list[str]], expected: list[str]) -> None:
    table = IdTable.of(MODEL, classes)
    assert table.class_name.tolist() == ["", *classes]
    assert table.class_name[table.geom_class].tolist() == expected


def test_a_miss_has_no_class() -> None:
    table = IdTable.of(MODEL, {"rack": ["rack_2"]})
    fields = {"geom_id": np.array([[-1, 5], [0, -1]], np.int32)}
    np.testing.assert_array_equal(table.class_of(fields), [[0, 1], [0, 0]])


def test_flexes_skins_and_props_have_names_and_classes() -> None:
    model = mujoco.MjModel.from_xml_string(SOFT)
    sign, post = (rigcast.Prop(name=name, file=Path("x.stl"), mount=mount) for name, mount in PROPS.items())
    table = IdTable.of(model, {"cloth": ["towel"], "robot": ["robot"], "sign": ["sign"]}, [sign, post])
    assert (table.flex_name.tolist(), table.flex_class.tolist()) == (["towel"], [1])
    assert (table.skin_name.tolist(), table.skin_class.tolist()) == (["hide"], [0])
    assert (table.prop_name.tolist(), table.prop_body.tolist()) == (["sign", "post"], [0, 1])
    assert table.prop_class.tolist() == [3, 2]
    ids = {"geom_id": [-1, 0, -1, -1], "flex_id": [0, -1, -1, -1], "prop_id": [-1, -1, 1, -1]}
    np.testing.assert_array_equal(table.class_of({k: np.array(v, np.int32) for k, v in ids.items()}), [1, 2, 2, 0])


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        (
            "{rack: [rack_3]}",
            "rig.yaml:4:18: classes.rack[0]: no geom, body, flex, skin or prop 'rack_3'; did you mean 'rack_",
        ),
        ("{a: [robot], b: ['ro*']}", "classes.b: 'robot' is in class 'a' already, expected one class for each"),
        ("{a: robot}", "classes.a: must be a list, got 'robot'"),
        ("[robot]", "classes: must be a mapping"),
    ],
)
def test_classes_that_do_not_fit_are_shown_where_they_are(tmp_path: Path, classes: str, message: str) -> None:
    sensor = "{name: a, type: lidar, mount: {}, elevation_deg: [0], columns: 4}"
    rig = f"model: m.xml\nsensors:\n  - {sensor}\nclasses: {classes}\n"
    (tmp_path / "m.xml").write_text(XML)
    (tmp_path / "rig.yaml").write_text(rig)
    with pytest.raises(InputError) as error:
        open_rig(tmp_path / "rig.yaml")
    assert message in str(error.value)


def test_a_rig_file_says_classes_and_how_to_export(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(XML)
    (tmp_path / "rig.yaml").write_text(
        "model: m.xml\nclasses: {rack: [rack_1, rack_2]}\nexport: {exr_compression: piz, point_layout: ouster}\n"
        "sensors: [{name: a, type: lidar, mount: {}, elevation_deg: [0], columns: 4}]\n"
    )
    config, _ = open_rig(tmp_path / "rig.yaml")
    assert {name: list(names) for name, names in config.classes.items()} == {"rack": ["rack_1", "rack_2"]}
    assert (config.export.exr_compression, config.export.point_layout) == ("piz", "ouster")
