"""`rigcast check` judges SDF geoms, flexes, skins and props: correct ones pass, and a fault in any of them is found."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh

from rigcast import DepthCamera, Filter, Lidar, Mount, Prop, Rig, check
from rigcast.checking import Report
from rigcast.oracle.deformable import CAN_JUDGE
from rigcast.oracle.things import Things
from rigcast.sensors.rig.mounted import Sensor
from rigcast.sensors.scene.hits import NumpyHits

GRID = '<flexcomp name="{}" type="grid" count="{}" spacing=".2 .2 .2" pos="{}" dim="{}" radius="{}" mass="1">'
PLAIN = GRID + '<edge equality="true"/></flexcomp>'
WEIGHTS = 'vertid="0 1 2 3 4 5 6 7" vertweight="1 1 1 1 1 1 1 1"'
CUBE = 'vertex="0 0 0 0 0 .6 0 .6 0 0 .6 .6 .6 0 0 .6 0 .6 .6 .6 0 .6 .6 .6" '
FACES = 'face="0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"'
WORLD = f"""<mujoco>
<option timestep="0.005"/>
<extension><plugin plugin="mujoco.sdf.torus"><instance name="torus">
  <config key="radius1" value=".35"/><config key="radius2" value=".15"/>
</instance></plugin></extension>
<asset><mesh name="torus"><plugin instance="torus"/></mesh></asset>
<worldbody>
  <geom name="floor" type="plane" size="0 0 1" pos="0 0 -1" contype="0" conaffinity="0"/>
  <geom name="ring" type="sdf" mesh="torus" pos="2 0 .5" contype="0" conaffinity="0"><plugin instance="torus"/></geom>
  {PLAIN.format("rope", "8 1 1", "0 1.5 1", 1, 0.05)}
  {PLAIN.format("cloth", "5 5 1", "0 -1.5 0", 2, 0.02)}
  {PLAIN.format("soft", "3 3 3", "-1.5 1.5 .5", 3, 0.02)}
  <body name="bone" pos="-1.5 -1.5 0"><freejoint/><geom size=".05" contype="0" conaffinity="0"/></body>
  <body name="cart" pos="-2 0 .5"><joint type="slide" axis="0 1 0"/><geom size=".05" contype="0"
    conaffinity="0"/></body>
</worldbody>
<deformable><skin name="coat" {CUBE}{FACES}><bone body="bone" bindpos="0 0 0" bindquat="1 0 0 0" {WEIGHTS}/></skin>
</deformable></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(WORLD)
KINDS = ["sdf", "prop"] + ["flex", "skin"] * CAN_JUDGE
SENSORS: list[Sensor] = [
    Lidar(name="top", mount=Mount(pos=(0.013, 0.021, 0.017)), elevation_deg=list(range(-40, 50, 5)), columns=180),
    DepthCamera(name="eye", mount=Mount(pos=(-4, 0, 0.5)), resolution=(40, 30), fov_y_deg=60.0),
]


@pytest.fixture(scope="module")
def props(tmp_path_factory: pytest.TempPathFactory) -> list[Prop]:
    """A cone used twice, once on a body, and an open sheet of one triangle."""
    folder = tmp_path_factory.mktemp("props")
    trimesh.creation.cone(0.3, 0.6).export(folder / "cone.ply")
    trimesh.Trimesh([(0, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2)]).export(folder / "sheet.ply")
    return [
        Prop(name="load", file=folder / "cone.ply", mount=Mount(body="cart", euler_deg=(20, 30, 40)), scale=(-1, 1, 2)),
        Prop(name="spare", file=folder / "cone.ply", mount=Mount(pos=(1, 2, 0)), scale=(-1, 1, 2)),
        Prop(name="sheet", file=folder / "sheet.ply", mount=Mount(pos=(1.5, -1.5, 0))),
    ]


def checked(rig: Rig, rays: int = 4000) -> Report:
    return check(rig, mujoco.MjData(MODEL), rays=rays, states=2, duration=0.02)


def test_things_are_numbered_one_kind_after_another_and_two_at_once_are_none(props: list[Prop]) -> None:
    things = Things.of(MODEL, props)
    flex, skin, prop = MODEL.ngeom, MODEL.ngeom + MODEL.nflex, MODEL.ngeom + MODEL.nflex + MODEL.nskin
    ids = {
        "geom_id": [0, -1, -1, -1, -1, 0, 0, -1],
        "flex_id": [-1, 1, -1, -1, -1, 1, -1, -1],
        "skin_id": [-1, -1, 0, -1, -1, -1, -1, 0],
        "prop_id": [-1, -1, -1, 2, -1, -1, 2, 2],
    }
    numbers = things.numbers(SimpleNamespace(**ids))
    np.testing.assert_array_equal(numbers, [0, flex + 1, skin, prop + 2, -1, -2, -2, -2])
    assert things.types_of(numbers).tolist() == ["plane", "flex", "skin", "prop", *["none"] * 4]


def test_every_kind_is_judged_by_itself_and_is_right(props: list[Prop]) -> None:
    report = checked(Rig(MODEL, SENSORS, props=props))
    assert report.wrong == 0, report.wrong_rays
    seen = {row.geom_type: row.rays for row in report.rows if row.sensor == "top"}
    assert {kind for kind, rays in seen.items() if rays > 20} >= {*KINDS, "plane", "none"}
    assert (report.not_judged > 0) != CAN_JUDGE


Fault = Callable[[NumpyHits, np.ndarray[Any, np.dtype[np.bool_]]], dict[str, Any]]
FAULTS: dict[str, Fault] = {
    "1 % too far": lambda hits, of: {"distance": np.where(of, hits.distance * np.float32(1.01), hits.distance)},
    "missed": lambda hits, of: {
        "distance": np.where(of, np.inf, hits.distance),
        **{f"{kind}_id": np.where(of, -1, getattr(hits, f"{kind}_id")) for kind in ("geom", "flex", "skin", "prop")},
        "normal": np.where(of[..., None], 0, hits.normal),
    },
    "normal turned": lambda hits, of: {"normal": np.where(of[..., None], hits.normal[..., [1, 2, 0]], hits.normal)},
    "called a geom": lambda hits, of: {
        **{f"{kind}_id": np.where(of, -1, getattr(hits, f"{kind}_id")) for kind in ("flex", "skin", "prop")},
        "geom_id": np.where(of, 0, hits.geom_id),
    },
    "two things at once": lambda hits, of: {
        "geom_id": np.where(of, 0, hits.geom_id),
        "prop_id": np.where(of, 0, hits.prop_id),
    },
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_is_found_where_it_is(kind: str, fault: Fault, props: list[Prop]) -> None:
    class Faulty(Rig):
        def cast(self, data: mujoco.MjData, names: Any = None) -> Any:
            return {name: Stub(spoilt(hits.numpy())) for name, hits in super().cast(data, names).items()}

    class Stub:
        def __init__(self, hits: NumpyHits) -> None:
            self.hits = hits

        def numpy(self) -> NumpyHits:
            return self.hits

    def spoilt(hits: NumpyHits) -> NumpyHits:
        of = hits.geom_id == MODEL.geom("ring").id if kind == "sdf" else getattr(hits, f"{kind}_id") >= 0
        return hits._replace(**fault(hits, of))

    report = checked(Faulty(MODEL, SENSORS, props=props), 400)
    assert {row.geom_type for row in report.rows if row.wrong} == {kind}
    (row,) = (row for row in report.rows if row.sensor == "top" and row.geom_type == kind)
    assert row.wrong > 0.8 * row.rays
    assert {wrong.expected.kind for wrong in report.wrong_rays} == {"geom" if kind == "sdf" else kind}


def test_filters_hold_for_every_kind(props: list[Prop]) -> None:
    filters = [
        Filter(exclude_bodies=("cart", "bone")),
        Filter(static=False),
        Filter(geometry="collision"),
        Filter(geometry="visual", geom_groups=(1, 2)),
    ]
    sensors = [
        Lidar(name=f"l{k}", mount=Mount(), elevation_deg=[-20, -5, 0, 10, 20], columns=90, filter=filter)
        for k, filter in enumerate(filters)
    ]
    report = checked(Rig(MODEL, sensors, props=props))
    assert report.wrong == 0, report.wrong_rays
    seen = {name: {row.geom_type for row in report.rows if row.sensor == name} for name in ("l0", "l1", "l2", "l3")}
    assert len({frozenset(types) for types in seen.values()}) > 1, seen


def test_a_frame_tells_the_kinds_apart_as_a_cast_does(props: list[Prop]) -> None:
    rig, data = Rig(MODEL, SENSORS, props=props), mujoco.MjData(MODEL)
    frame, hits = rig.sense(data)["eye"], rig.cast(data)["eye"].numpy()
    for kind in ("geom", "flex", "skin", "prop"):
        ids = getattr(frame, f"{kind}_id").numpy()
        np.testing.assert_array_equal(ids, getattr(hits, f"{kind}_id"), err_msg=kind)
        assert (ids >= 0).any()
    assert (frame.body_id.numpy()[hits.prop_id == 0] == MODEL.body("cart").id).all()
    without = Rig(MODEL, SENSORS).sense(data)["eye"]
    assert without.prop_id is None
    assert without.flex_id is not None


def test_the_command_says_by_type_what_it_found(
    tmp_path: Path, props: list[Prop], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigcast.cli import main

    (tmp_path / "world.xml").write_text(WORLD)
    (tmp_path / "cone.ply").write_bytes(props[0].file.read_bytes())
    (tmp_path / "rig.yaml").write_text(
        "model: world.xml\nprops:\n  - {name: load, file: cone.ply, mount: {body: cart}}\nsensors:\n"
        "  - {name: top, type: lidar, mount: {}, elevation_deg: [-20, -10, 0, 10, 20], columns: 90}\n"
    )
    monkeypatch.setattr("sys.argv", ["rigcast", "check", str(tmp_path / "rig.yaml"), "--rays", "2000"])
    with pytest.raises(SystemExit) as ended:
        main()
    out = capsys.readouterr().out
    assert ended.value.code == 0, out
    for kind in KINDS:
        assert f" {kind} " in out
