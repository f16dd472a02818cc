"""Users' presets and files of rays are found beside their rigs, and their faults are shown in their files."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from rigcast import InputError, Lidar, Mount
from rigcast.rig_file import load_rig, open_rig, read_rig

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")
OWN = """\
type: lidar
description: a lidar of mine
source: measured with a ruler
assumed:
  max_range: guessed
sensor:
  elevation_deg: [-1, 0, 1]
  columns: 90
  max_range: 20
"""
RIG = "sensors: [{name: a, type: lidar, preset: own/lidar.yaml, mount: {}}]"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rigs" / "own").mkdir(parents=True)
    (tmp_path / "rigs" / "own" / "lidar.yaml").write_text(OWN)
    (tmp_path / "outside.yaml").write_text(OWN)
    (tmp_path / "outside.csv").write_text("0,0,0\n")
    return tmp_path / "rigs"


def sensor(folder: Path, text: str = RIG) -> Any:
    (folder / "rig.yaml").write_text(text)
    return read_rig(folder / "rig.yaml").sensors[0]


def error(folder: Path, text: str = RIG) -> str:
    (folder / "rig.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        open_rig(folder / "rig.yaml", MODEL)
    return str(caught.value)


def test_a_preset_beside_the_rig_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    spec = sensor(folder)
    assert (spec.elevation_deg, spec.columns, spec.max_range) == ((-1, 0, 1), 90, 20)
    assert spec.preset == "own/lidar.yaml"


def test_a_copy_keeps_its_preset_wherever_that_is(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    spec = sensor(folder)
    copy = spec.model_copy(update={"columns": 7})
    assert (copy.columns, copy.max_range, copy.preset) == (7, 20, "own/lidar.yaml")
    assert copy.model_copy(update={"columns": 90}) == spec
    with pytest.raises(InputError, match=r"Lidar 'a': preset: got another, expected 'own/lidar\.yaml'"):
        spec.model_copy(update={"preset": "velodyne_vlp16"})


def test_keys_of_the_rig_win(folder: Path) -> None:
    spec = sensor(folder, RIG.replace("mount", "columns: 7, elevation_deg: [5], mount"))
    assert (spec.elevation_deg, spec.columns, spec.max_range) == ((5,), 7, 20)


def test_python_finds_it_from_where_it_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    for name in ("own/lidar.yaml", str(folder / "own" / "lidar.yaml"), "../outside.yaml"):
        assert Lidar(name="a", mount=Mount(), preset=name).columns == 90


def test_presets_extend_each_other(folder: Path) -> None:
    (folder / "own" / "mine.yaml").write_text(
        "{extends: lidar.yaml, description: x, source: y, sensor: {columns: 45, rate_hz: 5}}"
    )
    (folder / "own" / "vlp.yaml").write_text(
        "{extends: velodyne_vlp16, description: x, source: y, sensor: {columns: 900, max_range: 30}}"
    )
    mine = sensor(folder, RIG.replace("lidar.yaml", "mine.yaml"))
    assert (mine.columns, mine.rate_hz, mine.max_range, len(mine.elevation_deg)) == (45, 5, 20, 3)
    vlp = sensor(folder, RIG.replace("lidar.yaml", "vlp.yaml"))
    assert (vlp.columns, vlp.column_period_us, vlp.max_range, len(vlp.firing_time_us)) == (900, None, 30, 16)


def test_a_file_of_rays_is_beside_what_names_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    (folder / "own" / "rays.csv").write_text("0,10,0\n0.001,20,5\n")
    (folder / "own" / "file.yaml").write_text(
        "{type: lidar, description: x, source: y, sensor: {ray_file: {path: rays.csv}}}"
    )
    for text in (
        RIG.replace("lidar.yaml", "file.yaml"),
        "sensors: [{name: a, type: lidar, ray_file: {path: own/rays.csv}, mount: {}}]",
    ):
        spec = sensor(folder, text)
        assert spec.pattern(MODEL).shape == (2,)
        frame = load_rig(folder / "rig.yaml", MODEL, device="cpu").sense(mujoco.MjData(MODEL))["a"]
        np.testing.assert_array_equal(frame.stamp.numpy(), [0, 0.001])


def test_files_are_beside_the_layer_that_names_them(folder: Path) -> None:
    (folder / "own" / "rays.csv").write_text("0,10,0\n0.001,20,5\n")
    (folder / "own" / "base.yaml").write_text(
        "sensors:\n"
        "  - {name: a, type: lidar, preset: lidar.yaml, mount: {}}\n"
        "  - {name: b, type: lidar, ray_file: {path: rays.csv}, mount: {}}\n"
    )
    (folder / "rig.yaml").write_text(
        "extends: own/base.yaml\nsensors: [{name: a, rate_hz: 2}, {name: b, max_range: 9}]"
    )
    preset, rays = load_rig(folder / "rig.yaml", MODEL, device="cpu").sensors
    assert (preset.rate_hz, preset.max_range) == (2, 20)
    assert rays.pattern(MODEL).shape == (2,)
    with pytest.raises(InputError, match=r"sensors\[1\].ray_file.path: .*rays.csv: cannot be read"):
        load_rig(folder / "rig.yaml", MODEL, device="cpu", overrides=["sensors.b.ray_file.path=rays.csv"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (RIG.replace("own/lidar", "own/lidr"), "sensors[0].preset: {}/own/lidr.yaml: cannot be read: No such file"),
        (RIG.replace("own/lidar", "../outside"), "sensors[0].preset: preset '../outside.yaml' is outside of the rig"),
        (
            "sensors: [{name: a, type: lidar, ray_file: {path: ../outside.csv}, mount: {}}]",
            "sensors[0].ray_file.path: '../outside.csv' is outside of the rig file's folder, expected a file in it",
        ),
        (
            "sensors: [{name: a, type: lidar, ray_file: {path: none.csv}, mount: {}}]",
            "sensors[0].ray_file.path: {}/none.csv: cannot be read: No such file",
        ),
        (
            "sensors: [{name: a, type: lidar, ray_file: {path: none.csv, rate: 3}, mount: {}}]",
            "sensors[0].ray_file.rate: unknown key 'rate', expected one of path, sample_rate_hz",
        ),
        (
            RIG.replace("type: lidar", "type: height_scan, size: [1, 1], spacing: 1"),
            "is a lidar, expected a height_scan",
        ),
    ],
)
def test_faults_of_the_rig_have_their_place(folder: Path, text: str, message: str) -> None:
    first = error(folder, text).splitlines()[0]
    assert first.startswith(f"{folder / 'rig.yaml'}:1:"), first
    assert message.format(folder) in first


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("columns: 90", "colums: 90", "8:3: sensor.colums: unknown key 'colums'"),
        ("columns: 90", "columns: -90", "8:12: sensor.columns: must be greater than or equal to 1, got -90"),
        ("  max_range: 20", "  max_range: x", "9:14: sensor.max_range: must be a number, got 'x'"),
        ("source:", "sauce:", "3:1: sauce: unknown key 'sauce'"),
        ("type: lidar", "type: lidr", "'own/lidar.yaml' is a lidr, expected a lidar"),
        ("type: lidar\n", "", "expected type or extends, got neither"),
        ("type: lidar", "extends: lidar.yaml", "lidar.yaml: extends itself"),
        ("type: lidar", "extends: ../../outside.yaml", "expected a file in the same folder"),
        ("type: lidar", "extends: nobody", "unknown preset 'nobody'"),
        ("sensor:", "sensor: 3\nx:", "6:9: sensor: must be a mapping, got 3"),
        ("  columns", "\tcolumns", "not valid YAML"),
    ],
)
def test_faults_of_a_preset_are_shown_in_its_file(folder: Path, old: str, new: str, message: str) -> None:
    (folder / "own" / "lidar.yaml").write_text(OWN.replace(old, new, 1))
    text = error(folder)
    assert text.startswith(f"{folder / 'rig.yaml'}:1:42: sensors[0].preset: "), text
    assert message in text


def test_a_preset_need_not_be_whole(folder: Path) -> None:
    (folder / "own" / "lidar.yaml").write_text(
        "{type: lidar, description: x, source: y, sensor: {max_range: 5, rate_hz: 4}}"
    )
    spec = sensor(folder, RIG.replace("mount", "columns: 7, elevation_deg: [5], mount"))
    assert (spec.max_range, spec.rate_hz, spec.columns) == (5, 4, 7)
    assert "elevation_deg and columns: required where no preset gives them" in error(folder)
