"""`rigcast check`: correct rigs pass, broken casters fail, and wrong rays can be replayed."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rigcast import DepthCamera, Filter, HeightScan, InputError, Lidar, Mount, Rig, check, oracle
from rigcast.checking import Report
from rigcast.cli.check import as_json
from rigcast.cli.check import check as command
from rigcast.sensors.rig.mounted import Sensor
from rigcast.sensors.specs.lens import KannalaBrandt
from rigcast.sensors.specs.mount import Alignment

pytestmark = pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")

WORLD = """<mujoco>
  <option timestep="0.01"/>
  <asset><hfield name="hill" nrow="3" ncol="3" elevation="0 0 0 0 1 0 0 0 0" size="1 1 .5 .25"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="hill" type="hfield" hfield="hill" pos="3 0 .1"/>
    <geom name="post" type="cylinder" size=".2 1" pos="-2 1 1" contype="0" conaffinity="0"/>
    <body name="falling" pos="2 2 2"><freejoint/><geom name="falling" type="box" size=".3 .4 .5"/></body>
    <body name="robot" pos="0 0 1"><joint type="slide" axis="1 0 0"/><geom name="robot" type="sphere"
    size=".2"/></body>
  </worldbody>
  <keyframe><key name="start" qvel="0 0 0 1 2 0 .5"/></keyframe>
</mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(WORLD)
OUTSIDE = Filter(exclude_bodies=("robot",))
SENSORS: list[Sensor] = [
    Lidar(name="lidar", mount=Mount(body="robot"), elevation_deg=[-30, -10, 0, 10], columns=60, filter=OUTSIDE),
    DepthCamera(name="eye", mount=Mount(body="robot"), resolution=(16, 12), fov_y_deg=60.0, max_range=2.0),
    HeightScan(name="feet", mount=Mount(body="robot"), size=(2.0, 2.0), spacing=0.5, filter=OUTSIDE),
]


def checked(rig: Rig, **given: Any) -> Report:
    data = mujoco.MjData(rig.model)
    mujoco.mj_resetDataKeyframe(rig.model, data, 0)
    return check(rig, data, **{"rays": 1500, "states": 3, "duration": 0.5, **given})


def test_a_rig_agrees_with_mj_ray_in_every_state() -> None:
    report = checked(Rig(MODEL, SENSORS))
    assert report.wrong == 0
    assert report.times == pytest.approx((0, 0.25, 0.5))
    counts = {spec.name: sum(row.rays for row in report.rows if row.sensor == spec.name) for spec in SENSORS}
    assert counts == {"lidar": 3 * 166, "eye": 3 * 166, "feet": 3 * 25}
    assert {row.geom_type for row in report.rows if row.sensor == "lidar"} >= {"plane", "hfield", "none"}
    assert report.rays == report.agree + report.edge + report.wrong == 3 * (166 + 166 + 25)
    for row in report.rows:
        assert row.rays == row.agree + row.edge + row.wrong
        assert row.p999_error <= row.worst_error < 1e-4
        assert 0 <= row.worst_of_bound <= 1
    assert max(row.worst_error for row in report.rows) > 0


def test_height_scans_of_every_alignment_agree_on_a_body_that_tumbles() -> None:
    grid: dict[str, Any] = {"mount": Mount(body="falling"), "size": (1, 1), "spacing": 0.25}
    grid["filter"] = Filter(exclude_bodies=["falling"])
    alignments: list[Alignment] = ["base", "yaw", "world"]
    report = checked(Rig(MODEL, [HeightScan(name=each, alignment=each, **grid) for each in alignments]))
    assert {row.sensor for row in report.rows if row.agree} == set(alignments)
    assert report.wrong == 0


def test_the_same_seed_checks_the_same_rays() -> None:
    first, second, other = (checked(Rig(MODEL, SENSORS), rays=90, seed=seed) for seed in (0, 0, 1))
    assert first == second
    assert first != other


class Broken(Rig):
    """A rig whose every hit on the cylinder is 1 % too far."""

    def cast(self, data: mujoco.MjData, names: Any = None) -> Any:
        post = self.model.geom("post").id
        return {name: _stretched(hits, post) for name, hits in super().cast(data, names).items()}


def _stretched(hits: Any, geom: int) -> Any:
    distance = hits.distance.numpy()
    hits.distance.assign(np.where(hits.geom_id.numpy() == geom, np.float32(1.01) * distance, distance))
    return hits


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rays": 0}, "check: rays: got 0, expected a whole number from 1 on"),
        ({"rays": -5}, "check: rays: got -5, "),
        ({"rays": 1e4}, "check: rays: got 10000.0, "),
        ({"rays": True}, "check: rays: got True, "),
        ({"rays": "many"}, "check: rays: got 'many', "),
        ({"states": 0}, "check: states: got 0, "),
        ({"seed": -1}, "check: seed: got -1, expected a whole number from 0 on"),
        ({"duration": -1.0}, "check: duration: got -1.0, expected a number of seconds from 0 on"),
        ({"duration": np.nan}, "check: duration: got nan, "),
        ({"duration": None}, "check: duration: got None, "),
    ],
)
def test_numbers_that_are_not_such_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        checked(Rig(MODEL, SENSORS), **given)
    assert str(caught.value).startswith(message)


def test_wrong_rays_are_counted_where_they_are_and_can_be_replayed() -> None:
    report = checked(Broken(MODEL, SENSORS), rays=6000)
    assert {row.geom_type for row in report.rows if row.wrong} == {"cylinder"}
    assert 0 < len(report.wrong_rays) <= 5
    for wrong in report.wrong_rays:
        data = mujoco.MjData(MODEL)
        mujoco.mj_resetDataKeyframe(MODEL, data, 0)
        for _ in range(wrong.step):
            mujoco.mj_step(MODEL, data)
        assert data.time == wrong.time
        mujoco.mj_kinematics(MODEL, data)
        spec = next(spec for spec in SENSORS if spec.name == wrong.sensor)
        again = oracle.Oracle(MODEL, data, spec.filter).cast(wrong.origin, [wrong.direction])
        assert again.distance[0] == wrong.expected.distance
        assert (wrong.expected.kind, wrong.expected.id) == ("geom", again.geom_id[0])
        assert wrong.expected.name == "post"
        assert wrong.got.distance == pytest.approx(1.01 * again.distance[0], rel=1e-5)
        rays = Rig(MODEL, [spec]).rays(data)[spec.name]
        np.testing.assert_allclose(rays.directions[wrong.ray], wrong.direction, atol=1e-12)


def test_errors_are_those_of_their_row() -> None:
    class Off(Rig):
        """Its distances to the cylinder are 3 um too long."""

        def cast(self, data: mujoco.MjData, names: Any = None) -> Any:
            found = super().cast(data, names)
            for hits in found.values():
                is_post = hits.geom_id.numpy() == self.model.geom("post").id
                hits.distance.assign(hits.distance.numpy() + np.float32(3e-6) * is_post)
            return found

    rows = {row.geom_type: row for row in checked(Off(MODEL, SENSORS[:1])).rows}
    assert set(rows) > {"cylinder", "plane", "none"}
    for kind, row in rows.items():
        assert row.wrong == 0
        assert (row.worst_error > 2e-6) == (row.p999_error > 2e-6) == (kind == "cylinder"), row
        assert (row.worst_of_bound > 0.05) == (kind == "cylinder"), row


def test_json_is_strict_and_whole() -> None:
    report = checked(Broken(MODEL, SENSORS), rays=900)
    missed = replace(report.wrong_rays[0], got=replace(report.wrong_rays[0].got, distance=None, id=-1))
    read = json.loads(as_json(Path("rig.yaml"), replace(report, wrong_rays=(missed,))))
    assert set(read) == {"rig", "rays", "agree", "edge", "wrong", "rows", "wrong_rays", "times", "not_judged"}
    assert read["rays"] == sum(row["rays"] for row in read["rows"])
    assert read["wrong_rays"][0]["got"]["distance"] is None
    assert read["wrong_rays"][0]["expected"]["name"] == "post"
    assert set(read["rows"][0]) >= {"sensor", "geom_type", "worst_error", "p999_error", "worst_of_bound"}


RIG = """model: world.xml
keyframe: start
sensors:
  - name: lidar
    type: lidar
    mount: {body: robot}
    filter: {exclude_bodies: [robot]}
    elevation_deg: [-30, 0]
    columns: 90
"""


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    (tmp_path / "world.xml").write_text(WORLD)
    (tmp_path / "rig.yaml").write_text(RIG)
    return tmp_path / "rig.yaml"


def invoke(*arguments: str) -> Any:
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, list(arguments))


def test_the_command_prints_a_table_writes_json_and_succeeds(rig_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "check.json"
    result = invoke(str(rig_file), "--rays", "500", "--json", str(out))
    assert "|t - t_ref| [um] of rays that agree" in " ".join(result.output.split())
    rows = [line.split()[0] for line in result.output.splitlines() if re.search(r" \d+\.\d%$", line.rstrip())]
    assert len(rows) > 2
    assert [name for name in rows if name == "lidar"] == rows[:1], "a sensor is named in its first row alone"
    assert result.exit_code == 0, result.output
    assert ": 0 of 500 rays are wrong, in 5 states" in " ".join(result.output.split())
    assert json.loads(out.read_text())["wrong"] == 0


def test_the_command_names_wrong_rays_and_exits_with_1(rig_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigcast.sensors.rig.rig.Rig", Broken)
    result = invoke(str(rig_file), "--rays", "3000")
    assert result.exit_code == 1, result.output
    for word in ("wrong: ", "post", "expected", "got", "along", "after"):
        assert word in result.output


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ((np.inf, -1), "no hit"),
        ((np.inf, 2), "no distance, geom 2 'post', normal ["),
        ((1.5, -1), "1.5 m, id -1, normal ["),
        ((1.5, 0), "1.5 m, geom 0 'floor', normal ["),
    ],
)
def test_the_command_says_what_was_got_in_place_of_a_hit(
    rig_file: Path, monkeypatch: pytest.MonkeyPatch, answer: tuple[float, int], words: str
) -> None:
    class Same(Rig):
        """Has the same answer for every ray."""

        def cast(self, *given: Any, **how: Any) -> Any:
            found = super().cast(*given, **how)
            for hits in found.values():
                hits.distance.fill_(answer[0])
                hits.geom_id.fill_(answer[1])
            return found

    monkeypatch.setattr("rigcast.sensors.rig.rig.Rig", Same)
    result = invoke(str(rig_file), "--rays", "10")
    assert result.exit_code == 1, result.output
    assert f"  got      {words}" in result.output


def test_pixels_that_a_fisheye_leaves_dark_are_not_judged() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="2"/></worldbody></mujoco>')
    optics: dict[str, Any] = {"resolution": (80, 80), "fx": 10.0, "fy": 10.0, "cx": 40.0, "cy": 40.0}
    spec = DepthCamera(name="fish", mount=Mount(), distortion=KannalaBrandt(), **optics)
    report = check(Rig(model, [spec], "cpu"), mujoco.MjData(model), states=1)
    inside = np.hypot(*np.meshgrid(np.arange(80) - 39.5, np.arange(80) - 39.5)) <= 10 * np.pi
    assert (report.rays, report.wrong, report.not_judged) == (inside.sum(), 0, 0)
