"""`rigcast bench worlds`: worlds, rays and casters, and the form of its results; no speeds."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import floor
import mujoco
import numpy as np
import pytest
import warp as wp
from floor import Visits, visits_in_worlds
from in_worlds import OnGpu, bars, of_worlds, on_gpu
from PIL import Image
from typer.testing import CliRunner

from rigcast import InputError
from rigcast.bench import workloads
from rigcast.bench.figure import Figure, Spread
from rigcast.bench.race import spread_over
from rigcast.bench.report.record import Record
from rigcast.bench.workloads import Workload
from rigcast.bench.worlds.contenders import Rigcast, captured
from rigcast.bench.worlds.crowd import G1_HEAD, Crowd, crowd
from rigcast.bench.worlds.limits import limits
from rigcast.bench.worlds.measure import OnDevice
from rigcast.cli import app

MODEL = mujoco.MjModel.from_xml_string("""<mujoco>
  <asset><hfield name="ground" nrow="9" ncol="5" size="4 3 2 1"/></asset>
  <worldbody>
    <geom type="hfield" hfield="ground" pos="0 0 -0.5"/>
    <geom type="box" size=".3 .3 3"/>
    <body name="torso_link" pos="0 0 .9"><freejoint/><geom type="box" size=".1 .1 .5"/>
      <body><joint axis="0 1 0" range="-10 10"/><geom type="capsule" fromto="0 0 0 .8 0 0" size=".05"/></body></body>
  </worldbody></mujoco>""")
CPU = wp.get_device("cpu")
SIZES = [3, 5]


def small_workload() -> Workload:
    MODEL.hfield_data[:] = np.random.default_rng(0).random(MODEL.hfield_data.shape)
    return Workload("small", MODEL, mujoco.MjData(MODEL), (), groups=(0, 2))


def small_crowd(worlds: int = 5, seed: int = 0) -> Crowd:
    return crowd(small_workload(), G1_HEAD, worlds, seed)


@pytest.fixture(scope="module")
def run_of_bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, str]:
    """The JSON file of a run on the CPU, its chart, and what it printed."""
    out = tmp_path_factory.mktemp("worlds")
    file, chart = out / "worlds.json", out / "worlds.png"
    sizes = [part for size in SIZES for part in ("--worlds", str(size))]
    arguments = ["bench", "worlds", "--caster", "mujoco_warp", "--rounds", "2", "--device", "cpu", *sizes]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(workloads.WORKLOADS, "g1", small_workload)
        done = CliRunner().invoke(app, [*arguments, "--json", str(file), "--worlds-chart", str(chart)])
    assert done.exit_code == 0, done.output
    return file, chart, " ".join(done.output.split())


@pytest.fixture(scope="module")
def written(run_of_bench: tuple[Path, Path, str]) -> tuple[Path, Path]:
    """The JSON file and the chart."""
    return run_of_bench[:2]


def test_json_has_every_way_in_every_batch(written: tuple[Path, Path]) -> None:
    pytest.importorskip("mujoco_warp")
    found = json.loads(written[0].read_text())["worlds"]
    assert set(found) == {"device", "workload", "geoms", "triangles", "batches", "limits"}
    assert (found["device"], found["workload"], found["geoms"], found["limits"]) == ("CPU", "small", 4, [])
    assert [(batch["worlds"], batch["rays"]) for batch in found["batches"]] == [(n, 1024 * n) for n in SIZES]
    for batch in found["batches"]:
        assert set(batch) == {"worlds", "rays", "ways", "parts", "right", "same", "seen"}
        assert [way["name"] for way in batch["ways"]] == ["rigcast", "mujoco_warp", "mujoco_warp, no refit"]
        for way in batch["ways"]:
            assert set(way) == {"name", "ms", "mrays", "ratio"}
            ms, mrays = way["ms"], way["mrays"]
            assert 0 < ms["lowest"] <= ms["median"] <= ms["highest"]
            assert mrays["highest"] == pytest.approx(1e-3 * batch["rays"] / ms["lowest"])
        assert [part["key"] for part in batch["parts"]] == ["update", "cast", "points", "host"]
        assert sum(batch["seen"].values()) == pytest.approx(1)
        assert all(share > 0 for share in batch["seen"].values()), batch["seen"]


def test_casters_are_held_to_mj_ray_and_to_each_other(written: tuple[Path, Path]) -> None:
    pytest.importorskip("mujoco_warp")
    for batch in json.loads(written[0].read_text())["worlds"]["batches"]:
        ours, theirs = batch["right"]
        assert (ours["caster"], theirs["caster"]) == ("rigcast", "mujoco_warp")
        assert ours["agree"] == ours["close"] == ours["geom"] == 1
        assert theirs["close"] > 0.99
        assert batch["same"] > 0.99


def test_all_that_is_in_the_json_is_printed(run_of_bench: tuple[Path, Path, str]) -> None:
    pytest.importorskip("mujoco_warp")
    found, printed = json.loads(run_of_bench[0].read_text())["worlds"], run_of_bench[2]
    assert f"worlds on CPU: small, 4 geoms, {found['triangles']} triangles" in printed
    for batch in found["batches"]:
        where = str(batch["worlds"])
        for way in batch["ways"]:
            ms, speed, ratio = way["ms"], way["mrays"]["median"], way["ratio"]["median"]
            of_ms = f"{ms['median']:.3g} ({ms['lowest']:.3g} to {ms['highest']:.3g})"
            assert f" {where} {way['name']} {of_ms} {speed:.3g} {ratio:.2f} ".replace("  ", " ") in printed
            where = ""
        for caster in batch["right"]:
            assert (
                f"{batch['worlds']} worlds: {caster['caster']}: as mj_ray: distance {caster['agree']:.2%}, " in printed
            )
        assert f"{batch['worlds']} worlds: both casters alike to 1 cm, geom and all: {batch['same']:.3%}" in printed


@pytest.mark.parametrize(("device", "sizes"), [("cpu", (16, 64)), ("cuda:0", (64, 256, 1024, 4096, 16384))])
def test_a_gpu_is_given_more_worlds(device: str, sizes: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, ...]] = []

    def measured(_robots: Crowd, worlds: tuple[int, ...], *_rest: object) -> OnDevice:
        asked.append(worlds)
        raise InputError("enough")

    monkeypatch.setattr("rigcast.cli.bench.measure_worlds", measured)
    monkeypatch.setattr("rigcast.cli.bench.find_device", lambda name: SimpleNamespace(is_cuda=name == "cuda:0"))
    monkeypatch.setattr("rigcast.cli.bench.crowd", lambda _workload, _head, most: asked.append((most,)))
    monkeypatch.setitem(workloads.WORKLOADS, "g1", small_workload)
    assert CliRunner().invoke(app, ["bench", "worlds", "--device", device]).exit_code == 2
    assert asked == [(max(sizes),), sizes]


def test_chart_is_drawn(written: tuple[Path, Path]) -> None:
    with Image.open(written[1]) as image:
        assert image.size[0] > 500


def test_robots_stand_on_the_ground_each_its_own_way_and_a_seed_repeats_them() -> None:
    robots, again, others = small_crowd(50), small_crowd(50), small_crowd(50, seed=1)
    for name, poses in robots.poses.items():
        assert poses.dtype == np.float32
        np.testing.assert_array_equal(poses, again.poses[name])
    torso = robots.poses["xpos"][:, MODEL.body("torso_link").id]
    assert (np.abs(torso[:, :2]) <= 0.6 * MODEL.hfield_size[0, :2]).all()
    assert len(np.unique(torso, axis=0)) == 50
    assert not np.isin(torso[:, 0], others.poses["xpos"][:, MODEL.body("torso_link").id, 0]).any()
    # straight down from a torso 0.9 m above the sample next to it, of which the steepest slope is known
    rise = MODEL.hfield_size[0, 2] * np.ptp(MODEL.hfield_data)
    data, geom = robots.data(0), np.zeros(1, np.int32)
    only_ground = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    MODEL.geom_group[1:] = 1
    for world, place in enumerate(torso):
        data = robots.data(world)
        down = mujoco.mj_ray(MODEL, data, place.astype(float), np.array([0.0, 0, -1]), only_ground, 1, -1, geom)
        assert 0.9 - rise < down < 0.9 + rise, world
    MODEL.geom_group[1:] = 0


def test_worlds_are_judged_evenly_spread() -> None:
    assert list(spread_over(4096, 3)) == [0, 2047, 4095]
    assert list(spread_over(2, 16)) == [0, 1]


def test_limits_of_a_device_are_measured() -> None:
    found = list(limits(1, CPU))
    assert [limit.key for limit in found] == ["memory", "cache", "operations"]
    assert all(limit.value.median > 0 for limit in found)


@pytest.mark.cuda
def test_a_graph_reads_what_sense_reads() -> None:
    robots, device = small_crowd(), wp.get_device("cuda:0")
    ours = Rigcast(robots, 5, device)
    expected = ours.answer()
    replay = captured(ours.sense, device)
    ours._frame.range.zero_()
    replay()
    np.testing.assert_array_equal(ours.answer().distance, expected.distance)
    of_cpu = Rigcast(robots, 5, CPU).answer()
    np.testing.assert_array_equal(expected.geom_id, of_cpu.geom_id)


def test_rays_of_a_warp_share_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(floor, "g1", small_workload)
    counted = visits_in_worlds()
    alone = counted.nodes, counted.blocks, counted.patches
    assert counted.nodes > 1
    assert counted.patches > 0
    for shared, each in zip(counted.in_warp, alone, strict=True):
        assert each / 32 <= shared <= each
    assert counted.bytes_in_warp < counted.bytes


def of_gpu(found: OnDevice) -> OnDevice:
    """The results as those of a GPU: with graphs and limits."""
    batches = [
        replace(batch, ways=tuple(replace(way, name=way.name + end) for way in batch.ways for end in ("", ", graph")))
        for batch in found.batches
    ]
    limits = [Figure(key, key, "G/s", Spread.of(1e3)) for key in ("memory", "cache", "operations")]
    return replace(found, device="Some GPU", batches=tuple(batches), limits=tuple(limits))


def test_page_says_what_a_gpu_did_or_that_there_was_none(
    written: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco_warp")
    run = Record.read(written[0])
    cpu = run.worlds
    assert cpu is not None
    monkeypatch.setattr("in_worlds.ON_GPU", tmp_path / "on_gpu.json")
    counted = [Visits("a G1 in many worlds, lidar", 9.0, 0.5, 0.5, (1.0, 0.1, 0.1))]
    run_there = replace(run, worlds=of_gpu(cpu), versions={"rigcast": "9", "numpy": "8"})
    known = OnGpu(of_gpu(cpu), "rigcast 9, numpy 8")
    assert on_gpu(run) is None
    assert on_gpu(run_there) == known
    (tmp_path / "on_gpu.json").write_text(run_there.as_json())
    assert on_gpu(run) == known
    without = "\n".join(of_worlds(cpu, None, counted, tmp_path))
    assert "On a GPU: not measured" in without
    assert "Some GPU" not in without
    assert not (tmp_path / "worlds.png").exists()
    with_one = "\n".join(of_worlds(cpu, known, counted, tmp_path))
    assert "not measured" not in with_one
    assert "Some GPU, rigcast 9, numpy 8. M rays/s" in with_one
    assert "| worlds | rigcast | rigcast, graph | mujoco_warp |" in with_one
    assert "| operations | " in with_one
    assert (tmp_path / "worlds.png").exists()
    assert list(bars(None)) == []
    assert [bar for _, bar, _, _ in bars(known)] == [">= 1.5 G/s", ">= 3", ">= 3"]
