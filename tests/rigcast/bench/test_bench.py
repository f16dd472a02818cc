"""`rigcast bench`: what it compares, and the form of its results; no speeds."""

import json
import sys
from functools import partial
from pathlib import Path
from weakref import WeakSet

import mujoco
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from rigcast import InputError
from rigcast.bench import casting, preparing, stepping, workloads
from rigcast.bench.casters import CASTERS, Floats, load_casters
from rigcast.bench.casters.tessellation import merged_triangles
from rigcast.bench.race import Result, in_turns, race
from rigcast.bench.report.charts import draw_results
from rigcast.bench.scaling import scaling
from rigcast.bench.workloads import View, Workload
from rigcast.cli import app
from rigcast.oracle import Oracle

# The ball is seen by mj_ray alone: mj_multiRay looks for a body where its colliding geoms are, here above the ball.
MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <geom name="wall" type="box" size=".1 9 9" pos="5 0 0"/>
  <body name="ball" pos="2 0 0"><geom size=".1" pos="0 0 5"/>
    <geom type="sphere" size=".8" contype="0" conaffinity="0"/></body>
  <geom type="sphere" size=".5" group="5"/>
</worldbody></mujoco>""")
MUJOCO_ONLY = ("rigcast", "mj_multiRay", "mj_ray")


def fan(rows: int, columns: int) -> Floats:
    grid = np.stack(np.meshgrid([1.0], np.linspace(-0.6, 0.6, columns), np.linspace(-0.5, 0.5, rows)), axis=-1)
    directions: Floats = grid[:, 0].transpose(1, 0, 2)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def small_workload() -> Workload:
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    views = View("eye", np.zeros(3), fan(8, 12)), View("lidar", np.array([0.0, 0.0, 0.1]), fan(3, 30))
    return Workload("small", MODEL, data, views, groups=(0, 1, 2, 3, 4))


def small_race() -> list[Result]:
    casters, missing = load_casters(MUJOCO_ONLY)
    assert not missing
    return race(small_workload(), casters, rounds=2, sample=50)


def test_an_answer_is_dropped_once_the_next_is_there() -> None:
    class Answer: ...

    held: WeakSet[Answer] = WeakSet()
    most = 0

    def run() -> Answer:
        nonlocal most
        answer = Answer()
        held.add(answer)
        most = max(most, len(held))
        return answer

    in_turns({"answers": run}, rounds=2)
    assert most == 2


def test_casters_take_turns_in_either_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigcast.bench.race.TURN", 0.0)
    runs: list[str] = []
    times = in_turns({name: partial(runs.append, name) for name in "abc"}, rounds=3)
    assert "".join(runs) == "abc" + "abc" + "cba" + "abc", "one run each that does not count, and three rounds"
    assert [times[name].shape for name in "abc"] == [(2, 3)] * 3


def width_of(picture: Path) -> int:
    with Image.open(picture) as image:
        return int(image.size[0])


def test_casters_are_compared_on_the_same_rays_and_rightness_is_shown() -> None:
    results = small_race()
    assert [(result.sensor, result.shape) for result in results] == [("eye", (8, 12)), ("lidar", (3, 30))]
    for result in results:
        assert [speed.caster for speed in result.speeds] == list(MUJOCO_ONLY)
        ours, multi, reference = result.speeds
        assert ours.agree == ours.close == reference.agree == 1
        assert multi.close < 1  # it misses the ball: fast but wrong
        assert ours.ratio.lowest == ours.ratio.highest == 1
        for speed in result.speeds:
            assert speed.rays == np.prod(result.shape)
            assert 0 < speed.mrays.lowest <= speed.mrays.median <= speed.mrays.highest
            assert speed.ratio.lowest <= ours.mrays.highest / speed.mrays.lowest * (1 + 1e-9)


def test_a_caster_that_is_not_installed_is_named_and_one_that_is_not_known_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rigcast.bench.casters.caster._MODULES", {"Open3D": "with_nothing"})
    assert load_casters(("Open3D",))[0] == []
    assert "Open3D: No module named" in load_casters(("Open3D",))[1][0]
    with pytest.raises(InputError, match="no caster 'Embree', expected one of rigcast, Open3D"):
        load_casters(("Embree",))


@pytest.mark.parametrize("name", CASTERS)
def test_every_caster_that_is_installed_hits_the_same(name: str) -> None:
    casters, missing = load_casters((name,))
    if missing:
        pytest.skip(missing[0])
    workload = small_workload()
    directions = fan(8, 12).reshape(-1, 3)
    caster = casters[0](workload.model, workload.data, workload.groups)
    expected = Oracle(MODEL, workload.data).cast(np.array([0.0, 0.0, 0.6]), directions).distance
    if name == "mj_multiRay":  # see above
        expected = np.full(len(directions), np.nan)
    for origins in (np.array([0.0, 0.0, 0.6]), np.tile([0.0, 0.0, 0.6], (len(directions), 1))):
        answer = caster.aim(origins, directions)()
        assert answer.distance.shape == (len(directions),)
        right = np.isnan(expected) | (np.abs(answer.distance - expected) < 0.02) | (answer.distance == expected)
        assert right.all(), (name, origins.shape, answer.distance[~right], expected[~right])


def test_merged_triangles_lie_on_the_geoms_and_name_them() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco>
      <asset><mesh name="cube" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"/>
        <hfield name="hill" nrow="3" ncol="4" size="1 1 .5 2" elevation="0 .2 0 .1 .3 1 .4 0 0 .7 .1 0"/></asset>
      <worldbody>
        <geom type="plane" size="3 2 1" pos="0 0 -9"/>     <geom type="sphere" size=".5" pos="4 0 0"/>
        <geom type="capsule" size=".5 1" pos="8 0 0"/>     <geom type="ellipsoid" size=".5 .25 1" pos="12 0 0"/>
        <geom type="cylinder" size=".5 1" pos="16 0 0"/>   <geom type="box" size=".5 .25 1" pos="20 0 0" euler="0 0 9"/>
        <geom type="mesh" mesh="cube" pos="24 0 0"/>       <geom type="hfield" hfield="hill" pos="28 0 0"/>
        <geom type="box" size="9 9 9" group="3"/>          <geom type="box" size="9 9 9" rgba="1 1 1 0"/>
      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    vertices, faces, geom_of_face = merged_triangles(model, data, groups=(0, 1, 2))
    assert set(geom_of_face.tolist()) == set(range(8))
    oracle = Oracle(model, data)
    corners = vertices[faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    assert (area[geom_of_face < 7] > 0).all(), "no triangle of a solid is without area"
    with np.errstate(invalid="ignore"):
        normals /= area[:, None]
    for geom in range(8):
        of_geom = (geom_of_face == geom) & (area > 0)  # a height field of height 0 has sides without area
        starts = corners[of_geom].mean(axis=1) + 0.1 * normals[of_geom]
        hits = oracle.cast_at(starts, -normals[of_geom], np.full(of_geom.sum(), geom, np.int32))
        np.testing.assert_allclose(hits.distance, 0.1, atol=0.006, err_msg=f"geom {geom}")


def test_json_has_all_that_was_measured_and_what_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(workloads.WORKLOADS, "warehouse", small_workload)
    monkeypatch.setenv("RIGCAST_THREADS", "1")
    arguments = ["bench", "warehouse", "update", "--caster", "mj_multiRay", "--rounds", "1", "--threads", "2"]
    out, chart = tmp_path / "bench.json", tmp_path / "bench.png"
    done = CliRunner().invoke(app, [*arguments, "--json", str(out), "--chart", str(chart)])
    assert done.exit_code == 0, done.output
    read = json.loads(out.read_text())
    assert set(read) == {
        *("machine", "processor", "cores", "threads", "rounds", "load", "versions"),
        *("results", "figures", "scaling", "worlds"),
    }
    assert read["threads"] == 2
    assert {"rigcast", "mujoco", "warp-lang", "numpy"} <= set(read["versions"])
    eye, lidar = read["results"]
    assert (eye["workload"], eye["sensor"], eye["shape"]) == ("small", "eye", [8, 12])
    assert (lidar["sensor"], lidar["shape"], lidar["geoms"], lidar["triangles"]) == ("lidar", [3, 30], 4, 0)
    assert [speed["caster"] for speed in eye["speeds"]] == ["rigcast", "mj_multiRay"]
    assert set(eye["speeds"][0]) == {"caster", "rays", "mrays", "ratio", "cpu_ratio", "agree", "close"}
    assert eye["speeds"][0]["close"] == 1
    assert [figure["key"] for figure in read["figures"]] == ["update_130", "update_1600"]
    assert set(read["figures"][0]) == {"key", "what", "unit", "value"}
    assert set(read["figures"][0]["value"]) == {"median", "lowest", "highest"}
    assert width_of(chart) > 500


def test_parts_that_are_not_known_are_refused() -> None:
    done = CliRunner().invoke(app, ["bench", "warehose"])
    assert done.exit_code == 2
    assert "bench: no part 'warehose', expected one of g1, warehouse, " in done.output
    assert "did you mean 'warehouse'?" in done.output


@pytest.mark.parametrize("measure", [casting.outputs, stepping.small])
def test_figures_are_positive_and_have_keys(measure: object) -> None:
    assert callable(measure)
    figures = list(measure(1))
    assert len({figure.key for figure in figures}) == len(figures) >= 1
    for figure in figures:
        assert 0 < figure.value.lowest <= figure.value.median <= figure.value.highest


def test_trees_and_memory_are_measured_small(monkeypatch: pytest.MonkeyPatch) -> None:
    measure = preparing._child

    def only_height_field(module: str, kind: str, *rest: str, **environment: str) -> dict[str, float]:
        """Skip that of a mesh, which test_no_growth measures."""
        return measure(module, kind, *rest, **environment) if kind == "hfield" else {"bytes_per_triangle": 1.0}

    monkeypatch.setattr(preparing, "_child", only_height_field)
    of_trees, of_memory = (list(measured(1, triangles=5000)) for measured in (preparing.trees, preparing.memory))
    assert [figure.key for figure in of_trees] == ["tree_build", "tree_read", "tree_hfield"]
    assert all(figure.value.median > 0 for figure in of_trees)
    on_linux = ["memory_built", "memory_read", "memory_hfield"]
    assert [figure.key for figure in of_memory] == (on_linux if sys.platform == "linux" else [])


def test_scaling_has_a_speed_for_every_size() -> None:
    found = {series.varies: series for series in scaling(1, most_triangles=10_000, most_geoms=50, most_worlds=4)}
    assert list(found) == ["rays", "triangles", "geoms", "threads", "worlds"]
    assert found["worlds"].sizes == (1, 4)
    assert found["triangles"].sizes == (10_082,)
    assert found["geoms"].sizes == (15, 55)
    assert found["rays"].sizes == (4800, 19200, 76800, 307200)
    assert found["threads"].sizes[0] == 1
    for series in found.values():
        assert len(series.mrays) == len(series.sizes)


def test_a_camera_looks_at_its_target_and_a_lidar_all_around() -> None:
    camera, lidar = workloads.hills(2000).views
    rows, columns, _ = camera.directions.shape
    middle = camera.directions[rows // 2 - 1 : rows // 2 + 1, columns // 2 - 1 : columns // 2 + 1].mean(axis=(0, 1))
    target = np.array([20.0, 5.0, 2.0]) - camera.origin
    np.testing.assert_allclose(middle, target / np.linalg.norm(target), atol=1e-5)
    down, across = (
        camera.directions[-1, 0] - camera.directions[0, 0],
        camera.directions[0, -1] - camera.directions[0, 0],
    )
    assert down[2] < 0, "rows from the top"
    assert np.cross(target, across)[2] < 0, "columns from the left"
    assert abs(across[2]) < 1e-12, "level"
    elevation = np.rad2deg(np.arcsin(lidar.directions[..., 2]))
    np.testing.assert_allclose(elevation, np.broadcast_to(np.linspace(25, -25, 64)[:, None], (64, 1024)), atol=1e-9)


@pytest.mark.parametrize("option", ["--chart", "--scaling-chart", "--worlds-chart"])
def test_a_chart_is_a_png(option: str) -> None:
    done = CliRunner().invoke(app, ["bench", option, "chart.svg"])
    assert done.exit_code == 2
    assert f"{option}: got 'chart.svg', expected a name that ends in .png" in done.output


def test_chart_of_results_is_drawn(tmp_path: Path) -> None:
    draw_results(small_race(), tmp_path / "chart.png")
    assert width_of(tmp_path / "chart.png") > 500


def test_workload_that_cannot_be_had_says_why_and_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> Workload:
        raise workloads.Unavailable("no network")

    monkeypatch.setitem(workloads.WORKLOADS, "g1", missing)
    done = CliRunner().invoke(app, ["bench", "g1"])
    assert done.exit_code == 0
    assert "left out: g1: no network" in done.output
