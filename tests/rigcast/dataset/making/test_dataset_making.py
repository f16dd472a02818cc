"""A data set is the same in whatever way it is made, and no interruption loses or repeats a frame."""

import errno
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from small_datasets import MODULE_NAME, contents, controlled_by, edited, make

from rigcast.dataset.description.config import Unit, read_dataset
from rigcast.dataset.making.engines import InProcess, Make, Results
from rigcast.dataset.making.environment import environment, prepare_warp
from rigcast.dataset.making.episode import Job, Result, make_episode, open_episode
from rigcast.dataset.making.generate import make_dataset
from rigcast.dataset.reading import open_dataset
from rigcast.dataset.storage import manifest, shards
from rigcast.dataset.storage.manifest import write_manifest
from rigcast.rig_file import open_rig
from rigcast.sensors.errors import InputError


class Backwards:
    """Makes the last episode first."""

    workers = 1

    def run(self, make: Make, units: Sequence[Unit]) -> Results:
        yield from map(make, reversed(units))


def test_every_episode_has_its_shard(whole: dict[str, bytes]) -> None:
    files = ["entry.json", "frames.npz", "ids.json"]
    first = ["entry.json", "frames.npz", "front.png", "ids.json", "top.png"]
    expected = [
        f"{scene}/00000{k}/{name}" for scene in ("made", "room") for k in (0, 1) for name in (files, first)[k == 0]
    ]
    assert list(whole) == sorted([*expected, "dataset.json"])


@pytest.mark.parametrize("form", ["npz", "zarr"])
def test_it_is_the_same_in_any_order_and_any_parts(path: Path, form: str) -> None:
    path.write_text(path.read_text() + f"output: {{format: {form}, exr: true}}\n")
    make(path, "forwards")
    make(path, "backwards", engine=Backwards())
    for i in (2, 3, 1):
        make(path, "parts", part=(i, 3))
    expected = contents(path.parent / "forwards")
    assert any(name.endswith(".exr") for name in expected)
    assert contents(path.parent / "backwards") == expected
    assert contents(path.parent / "parts") == expected


def test_frames_are_those_of_the_rig_with_the_episode_s_seed(path: Path) -> None:
    edited(path, path.read_text().partition("randomise:")[2].partition("seed")[0], " {}\n")
    make(path)
    (*_, unit) = [unit for unit in read_dataset(path).units() if unit.scene == "room"]
    config, model = open_rig(path.parent / "rig.yaml")
    rig, data = config.build(model, "cpu", unit.seed), mujoco.MjData(model)
    expected = []
    for _ in range(10):
        data.ctrl[:] = unit.seed % 7 / 7 + data.time
        mujoco.mj_step(model, data)
        expected += [(f.sensor, f.time, f.range.numpy(), f.points.numpy()) for f in rig.step(data)]
    made = [f for f in open_dataset(path.parent / "out") if (f.scene, f.episode) == (unit.scene, unit.episode)]
    assert [(f.sensor, f.time, f.seed) for f in made] == [(name, time, unit.seed) for name, time, *_ in expected]
    for frame, (_, _, ranges, points) in zip(made, expected, strict=True):
        np.testing.assert_array_equal(frame["range"], ranges)
        np.testing.assert_array_equal(frame["points"], points)


def test_episodes_differ_by_what_is_drawn(path: Path) -> None:
    shards_made = make(path).manifest["shards"]
    for key in ("sensors.top.noise.range_std", "sensors.top.noise.dropout"):
        drawn = [entry["rig"][key] for entry in shards_made]
        assert len(set(drawn)) == 4
        assert all(0 <= value <= 0.5 for value in drawn)
    assert len({tuple(entry["poses"]["table"]) for entry in shards_made}) == 4
    by_scene = {scene: {e["scene_sha256"] for e in shards_made if e["scene"] == scene} for scene in ("room", "made")}
    assert {scene: len(digests) for scene, digests in by_scene.items()} == {"room": 1, "made": 2}


@pytest.mark.parametrize("body", ["table", "sign", "ball"])
def test_a_body_is_moved_wherever_mujoco_keeps_its_pose(path: Path, body: str) -> None:
    edited(path, path.read_text().partition("poses:")[2].partition("\n")[0], f" {{{body}: {{pos: [0.5, 0, 0]}}}}")
    config = read_dataset(path)
    places = []
    for unit in config.units()[:2]:
        episode = open_episode(config, unit, "cpu")
        mujoco.mj_kinematics(episode.rig.model, episode.data)
        places.append(episode.data.body(body).xpos.copy())
        expected = open_rig(path.parent / "rig.yaml")[1].body(body).pos + episode.about["poses"][body][:3]
        np.testing.assert_allclose(places[-1], expected, atol=1e-12)
    assert places[0][0] != places[1][0]


def test_a_function_that_returns_one_model_again_gives_every_episode_the_same(path: Path) -> None:
    edited(path, path.read_text().partition("poses:")[2].partition("\n")[0], " {table: {pos: [0.5, 0, 0]}}")
    module = path.parent / f"{MODULE_NAME}.py"
    edited(module, "def room(seed):", "from functools import cache\n@cache\ndef fixed(seed):")
    edited(module, "def push", "def room(seed):\n    return fixed(0)\n\ndef push")
    shards_made = [entry for entry in make(path).manifest["shards"] if entry["scene"] == "made"]
    assert len({entry["scene_sha256"] for entry in shards_made}) == 1


def test_a_recorded_motion_is_played_back(path: Path) -> None:
    model = open_rig(path.parent / "rig.yaml")[1]
    rows = np.tile(mujoco.MjData(model).qpos, (3, 1))
    rows[:, model.joint("slide").qposadr[0]] = [0, 1, 3]
    np.save(path.parent / "walk.npy", rows)
    controlled_by(path, "type: recorded, file: walk.npy, rate_hz: 20")
    make(path)
    poses = {f.time: f["pose"][0, 3] for f in open_dataset(path.parent / "out").of("top") if f.episode == 0}
    expected = {0.02: 0.4, 0.04: 0.8, 0.06: 1.4, 0.08: 2.2, 0.1: 3.0}
    np.testing.assert_allclose(list(poses), list(expected), atol=1e-12)
    np.testing.assert_allclose(list(poses.values()), list(expected.values()), atol=1e-9)


def test_a_free_body_is_moved_from_where_a_motion_has_it(path: Path) -> None:
    model = open_rig(path.parent / "rig.yaml")[1]
    rows = np.tile(mujoco.MjData(model).qpos, (3, 1))
    ball = slice(*(model.jnt_qposadr[model.body("ball").jntadr[0]] + [0, 3]))
    rows[:, ball] += [[0, 0, 0], [1, 0, 0], [1, 2, 0]]
    np.save(path.parent / "walk.npy", rows)
    controlled_by(path, "type: recorded, file: walk.npy, rate_hz: 20")
    edited(path, "ball: {euler_deg: [9, 9, 9]}", "ball: {pos: [3, 3, 0], euler_deg: [0, 0, 90]}")
    config = read_dataset(path)
    for unit in config.units():
        episode = open_episode(config, unit, "cpu")
        x, y, _, _, _, turn = episode.about["poses"]["ball"]
        for share in (0.0, 0.4, 0.8):  # two steps of 10 ms are 0.4 rows
            pose = episode.data.body("ball")
            mujoco.mj_kinematics(episode.rig.model, episode.data)
            np.testing.assert_allclose(pose.xpos, [1 + share + x, y, 3], atol=1e-9, err_msg=unit.name)
            np.testing.assert_allclose(pose.xmat[0], np.cos(np.deg2rad(turn)), atol=1e-9, err_msg=unit.name)
            episode.step()
            episode.step()


def test_an_entry_that_was_damaged_is_named(path: Path) -> None:
    make(path)
    shard = path.parent / "out/room/000001"
    (shard / "entry.json").write_text('{"scene"')
    with pytest.raises(InputError, match=f"^{shard}/entry.json: not as it was written: .*; remove {shard}, and"):
        make(path)
    shutil.rmtree(shard)
    make(path)
    assert open_dataset(path.parent / "out").verify() == []


def test_random_actions_stay_within_limits(path: Path) -> None:
    config = read_dataset(controlled_by(path, "type: random, hold: 0.05"))
    episode = open_episode(config, config.units()[0], "cpu")
    actions = []
    for _ in range(episode.steps):
        episode.step()
        actions.append(float(episode.data.ctrl[0]))
    assert len(set(actions)) == 2
    assert actions[:5] == actions[:1] * 5
    assert all(-1 <= action <= 1 for action in actions)


FAILURES = {
    "worldbdy": ("room.xml", "<worldbody>", "<worldbdy>"),
    "the simulation diverged at t = 0": ("room.xml", 'damping="1"', 'stiffness="-1e9" springref="1"'),
    "OSError: no weights": ("set.yaml", ":push", ":broken"),
}


@pytest.mark.parametrize("reason", FAILURES)
def test_an_episode_that_fails_is_listed_with_its_reason(path: Path, reason: str) -> None:
    name, old, new = FAILURES[reason]
    edited(path.parent / name, old, new)
    done = make(path)
    assert len(done.manifest["failed"]) == 4
    assert done.manifest["missing"] == 0
    assert all(reason in failure["reason"] for failure in done.manifest["failed"]), done.manifest["failed"]
    assert json.loads((path.parent / "out/dataset.json").read_text()) == done.manifest


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("table", "no body 'table' that can be moved, expected one of tables, sign, ball, cart"),
        ("cart", "sensors[0].mount.body: no body 'cart' in the model, expected one of world, table, sign, ball, carts"),
    ],
)
def test_a_body_that_a_function_does_not_make_fails_its_episodes(path: Path, body: str, reason: str) -> None:
    edited(path.parent / f"{MODULE_NAME}.py", "read_text()\n", f"read_text().replace('{body}', '{body}s')\n")
    failed = make(path).manifest["failed"]
    assert [failure["scene"] for failure in failed] == ["made", "made"]
    assert all(reason in failure["reason"] for failure in failed), failed


def test_one_scene_that_fails_does_not_keep_others_from_being_made(path: Path, whole: dict[str, bytes]) -> None:
    (path.parent / "bad.xml").write_text("<mujoco><bad/></mujoco>")
    edited(path, "  - {name: made,", "  - {name: bad, file: bad.xml}\n  - {name: made,")
    done = make(path)
    assert [failure["scene"] for failure in done.manifest["failed"]] == ["bad", "bad"]
    made = {name: text for name, text in contents(path.parent / "out").items() if name in whole and "/" in name}
    assert made == {name: text for name, text in whole.items() if "/" in name}


@pytest.mark.parametrize("after", [1, 3])
def test_ctrl_c_keeps_what_is_finished(path: Path, whole: dict[str, bytes], after: int) -> None:
    seen: list[Result] = []

    def press(result: Result) -> None:
        seen.append(result)
        if len(seen) == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(path, report=press)
    manifest = json.loads((path.parent / "out/dataset.json").read_text())
    assert (len(manifest["shards"]), manifest["missing"]) == (after, 4 - after)
    assert make(path).episodes == 4 - after
    assert contents(path.parent / "out") == whole


def test_a_full_disk_stops_the_run_and_keeps_what_is_finished(
    path: Path, whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    frames_before_full: Iterator[int] = iter(range(10))

    def require_disk_space(_folder: Path, _size: int) -> None:
        if next(frames_before_full, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(shards, "require_disk_space", require_disk_space)
        with pytest.raises(InputError, match="No space left on device; finished episodes are kept"):
            make(path)
    manifest = json.loads((path.parent / "out/dataset.json").read_text())
    assert (len(manifest["shards"]), manifest["failed"], manifest["missing"]) == (1, [], 3)
    assert not (path.parent / "out" / shards.UNFINISHED_NAME).exists()
    make(path)
    assert contents(path.parent / "out") == whole


def test_what_a_killed_worker_leaves_is_swept_away(path: Path, whole: dict[str, bytes]) -> None:
    half = path.parent / "out" / shards.UNFINISHED_NAME / "room-000001.0123abcd"
    half.mkdir(parents=True)
    (half / "frames.npz").write_text("half")
    make(path)
    assert contents(path.parent / "out") == whole


def test_what_another_job_sweeps_away_fails_that_episode(
    path: Path, whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    sweeps = iter([shards.sweep])

    def require_disk_space(folder: Path, _size: int) -> None:
        for sweep in sweeps:
            sweep(path.parent / "out", [folder.name.rpartition(".")[0].replace("-", "/")])

    with monkeypatch.context() as patched:
        patched.setattr(shards, "require_disk_space", require_disk_space)
        (failure,) = make(path).manifest["failed"]
    assert "unfinished was removed while the episode was written to it; if another job makes" in failure["reason"]
    make(path)
    assert contents(path.parent / "out") == whole


def test_a_shard_without_its_entry_is_made_anew(path: Path, whole: dict[str, bytes]) -> None:
    """A truncated copy or a power cut leaves such a shard."""
    make(path)
    shard = path.parent / "out/room/000001"
    (shard / "entry.json").unlink()
    (shard / "frames.npz").write_text("half")
    assert make(path).episodes == 1
    assert contents(path.parent / "out") == whole


def test_a_shard_made_twice_at_once_is_there_once(path: Path, whole: dict[str, bytes]) -> None:
    make(path)
    config = read_dataset(path)
    (unit, *_) = config.units()
    made_with = environment(config.file, "cpu")
    assert make_episode(Job(config, path.parent / "out", "cpu", made_with), unit).failed is None
    assert contents(path.parent / "out") == whole


def test_more_episodes_and_scenes_may_come_later(path: Path) -> None:
    make(path)
    before = contents(path.parent / "out")
    edited(path, "count: 2", "count: 3")
    assert make(path).episodes == 2
    after = contents(path.parent / "out")
    assert {name: after[name] for name in before if "/" in name} == {n: text for n, text in before.items() if "/" in n}


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("set.yaml", "seed: 3", "seed: 4", "config.seed: got 4, there it was 3"),
        ("rig.yaml", "columns: 36", "columns: 72", "sources.rig.yaml"),
        ("room.xml", 'size="20 20 0.1"', 'size="10 20 0.1"', "sources.room.xml"),
    ],
)
def test_a_folder_with_another_data_set_is_refused(path: Path, name: str, old: str, new: str, message: str) -> None:
    make(path)
    before = contents(path.parent / "out")
    edited(path.parent / name, old, new)
    with pytest.raises(InputError) as caught:
        make(path)
    assert "holds another data set" in str(caught.value)
    assert message in str(caught.value)
    assert contents(path.parent / "out") == before


def test_a_mistake_that_failed_every_episode_can_be_mended(path: Path) -> None:
    edited(path, ":push", ":broken")
    assert make(path).episodes == 0
    edited(path, ":broken", ":push")
    done = make(path)
    assert (done.episodes, done.manifest["failed"], done.manifest["missing"]) == (4, [], 0)
    assert not (path.parent / "out" / "failed").exists()


def test_a_worker_of_another_kind_makes_nothing(path: Path) -> None:
    config = read_dataset(path)
    made_with = environment(config.file, "cpu") | {"mujoco": "3.4.0"}
    result = make_episode(Job(config, path.parent / "out", "cpu", made_with), config.units()[0])
    assert result.stops, "it would go through all episodes, and none would be made"
    assert "this machine is of another kind" in str(result.failed)
    assert "for 3.4.0" in str(result.failed)


def test_a_file_that_changes_meanwhile_stops_the_run(path: Path) -> None:
    config = read_dataset(path)
    edited(path.parent / "rig.yaml", "columns: 36", "columns: 72")
    with pytest.raises(InputError, match=r"rig\.yaml has changed since"):
        make_dataset(config, path.parent / "out", InProcess(), device="cpu")
    assert json.loads((path.parent / "out/dataset.json").read_text())["missing"] == 4


def test_jobs_that_end_at_the_same_time_leave_nothing_out(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job collects before another's last shard exists, and writes its manifest after the other's."""
    make(path, part=(1, 2))
    config, folder = read_dataset(path), path.parent / "out"
    collect, others = manifest._collected, iter([(2, 2)])

    def collected(*arguments: Any) -> dict[str, Any]:
        found = collect(*arguments)
        for part in others:
            make(path, part=part)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(manifest, "_collected", collected)
        manifest.write_manifest(config, folder, environment(config.file, "cpu"))
    assert len(json.loads((folder / "dataset.json").read_text())["shards"]) == 4


def test_a_portable_data_set_uses_no_kernel_that_was_compiled_for_this_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    flags = getattr(wp.config, "cpu_compiler_flags", None)
    if flags is None:
        pytest.skip("this Warp has no such option")
    module = wp.get_module("rigcast.kernels.poses.mounts")
    with monkeypatch.context() as patched:
        patched.setattr(wp.config, "cpu_compiler_flags", flags)
        native = module.get_module_hash()
        prepare_warp(portable=True)
        portable = module.get_module_hash()
    module.mark_modified()
    assert native == module.get_module_hash() != portable


def test_a_lost_manifest_is_made_again_from_the_shards(path: Path, whole: dict[str, bytes]) -> None:
    manifest = make(path).manifest
    (path.parent / "out/dataset.json").unlink()
    assert write_manifest(read_dataset(path), path.parent / "out", manifest["made_with"]) == manifest
    assert contents(path.parent / "out") == whole
