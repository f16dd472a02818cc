"""Commands print tables, or one message with exit code 2, never a traceback."""

import errno
import io
import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

import pytest
import warp as wp
from rich.console import Console
from rich.table import Table
from shell_calls import call_on_one_line as call
from small_datasets import edited

import rigcast.cli.presets
from rigcast.cli.common.options import show
from rigcast.rig_file import RigConfig

COMMANDS = ("init", "run", "check", "validate", "watch", "view", "publish", "presets", "schema", "dataset", "bench")


def test_version() -> None:
    assert call("--version") == (0, f"rigcast {version('rigcast')}")


@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help_lists_the_commands(option: str) -> None:
    code, output = call(option)
    assert code == 0
    assert "--set KEY=VALUE" in call("run", option)[1]
    assert [command for command in COMMANDS if f" {command} " in output] == list(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_shows_it_used(command: str) -> None:
    code, output = call(command, "--help")
    assert code == 0
    assert f" Examples: rigcast {command} " in output


def test_help_loads_no_command() -> None:
    shown = "from rigcast.cli import app; app(['--help'], standalone_mode=False)"
    program = f"import sys; {shown}; print('modules:', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    modules = done.stdout.partition("modules:")[2].split()
    assert "rigcast.cli" in modules
    assert not {f"rigcast.cli.{command}" for command in COMMANDS} & set(modules)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("model:", "modl:", ":1:1: modl: unknown key 'modl'"),
        ("robot.xml", "rig.yaml", "rig.yaml: a YAML file, expected a MuJoCo model"),
        ("torso", "torsoo", ":3:68: sensors[0].mount.body: no body 'torsoo'"),
        ("[64, 48]", "[0, 48]", ":4:63: sensors[1].resolution[0]: must be greater than or equal to 1, got 0"),
        ("58", "!!float 58", ":4:83: got the tag !!float"),
        ("front", "top", ":4:12: sensors[1].name: 'top' is the name of sensors[0] already"),
        ("sensors:", "sensors: [", "not valid YAML"),
        ("58", ".nan", "sensors[1].fov_y_deg: must be"),
    ],
)
def test_bad_rigs_exit_with_2(rig: Path, old: str, new: str, message: str) -> None:
    edited(rig, old, new)
    code, output = call("validate", rig)
    assert code == 2
    assert message in output


def test_bad_input_goes_to_stderr_without_a_traceback(tmp_path: Path) -> None:
    arguments = ["validate", str(tmp_path / "no.yaml")]
    main = "import sys; from rigcast.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", main, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == f"{tmp_path / 'no.yaml'}: cannot be read: No such file or directory\n"


def test_a_fault_of_rigcast_itself_is_no_wrong_ray(rig: Path) -> None:
    faulty = "import rigcast.cli.validate as v; v.open_rig = lambda *_: 1 / 0; from rigcast.cli import main; main()"
    command = [sys.executable, "-c", faulty, "validate", str(rig)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (70, "")
    assert done.stderr.endswith("ZeroDivisionError: division by zero\n")


LONG = "a_sensor_with_a_name_of_some_length_which_is_not_cut"


def test_names_in_tables_are_not_cut(rig: Path) -> None:
    edited(rig, "name: front", f"name: {LONG}")
    assert f"│ {LONG} │ depth_camera │" in call("validate", rig)[1]
    narrow = Console(file=io.StringIO(), width=40, force_terminal=True, color_system=None)
    table = Table("sensor", "type")
    table.add_row(LONG, "depth_camera")
    show(narrow, table)
    lines = narrow.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= 40
    assert "".join(line.split("│")[1].strip() for line in lines if "│" in line) == LONG


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["vaildate", "rig.yaml"], "no command 'vaildate', expected one of init, run, "),
        (["vaildate", "rig.yaml"], "did you mean 'validate'?"),
        (["run", "robot.xml"], "robot.xml: a MuJoCo model, expected a rig file; `rigcast init robot.xml` writes one"),
        (["watch", "robot.xml"], "robot.xml: a MuJoCo model, expected a rig file; `rigcast init robot.xml` writes one"),
        (["watch", "gone.yaml"], "gone.yaml: no such file, expected a rig"),
        (
            ["validate", "Velodyne_VLP16"],
            "the name of a device, expected a rig file; `rigcast presets velodyne_vlp16` shows it, and a sensor of a "
            "rig names it: `preset: velodyne_vlp16`",
        ),
        (
            ["watch", "livox_mid360.yaml"],
            "livox_mid360.yaml: the name of a device, expected a rig file; `rigcast presets",
        ),
        (
            ["validate", "own.yaml"],
            "own.yaml:1:1: a preset, expected a rig; `rigcast presets own.yaml` shows it",
        ),
        (["dataset", "own.yaml"], "own.yaml:1:1: a preset, expected a data set; `rigcast presets own.yaml` shows it"),
        (["presets", "rig.yaml"], "rig.yaml:1:1: a rig, expected a preset; `rigcast validate rig.yaml` shows it"),
        (["presets", "set.yaml"], "set.yaml:1:1: a data set, expected a preset; `rigcast dataset set.yaml` makes it"),
        (["presets", "half.yaml"], "preset 'half.yaml': elevation_deg: required where no preset gives it"),
        (["init", "rig.yaml"], "rig.yaml: a YAML file, expected a MuJoCo model: MJCF, URDF or MJB"),
        (["presets", "VLP-16"], "did you mean 'velodyne_vlp16'?"),
        (["presets", "Mid-360"], "did you mean 'livox_mid360'?"),
    ],
)
def test_what_newcomers_mistype_is_put_right(
    rig: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(rig.parent)
    Path("own.yaml").write_text("type: lidar\ndescription: our own\nsource: measured\n")
    Path("half.yaml").write_text("type: lidar\ndescription: our own\nsource: measured\nsensor: {columns: 4}\n")
    Path("set.yaml").write_text("rig: rig.yaml\nscenes: [{name: a, file: robot.xml}]\n")
    code, output = call(*arguments)
    assert code == 2
    assert message in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "plu"], "no format 'plu', expected any of exr, .* did you mean 'ply'?"),
        (["--format", "exr"], "sensor 'top' is a lidar, but format exr is for depth cameras only"),
        (["--out", "robot.xml"], "robot.xml: the output folder cannot be written: File exists"),
        (["--duration", "nan"], "--duration: got nan, expected a positive number of seconds"),
    ],
)
def test_what_a_run_cannot_write_is_told_before_anything_is_compiled(
    rig: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(rig.parent)
    monkeypatch.setattr(RigConfig, "build", pytest.fail)
    code, output = call("run", "rig.yaml", *arguments)
    assert code == 2
    assert re.search(message.replace("?", "[?]"), output), output


@pytest.mark.parametrize("command", ["check", "bench"])
def test_a_file_for_json_that_cannot_be_written_is_told_at_once(rig: Path, command: str) -> None:
    code, output = call(command, *([rig] if command == "check" else []), "--json", rig / "sub" / "answer.json")
    assert (code, "│" in output or "rays" in output) == (2, False), output
    assert "rig.yaml/sub: the output folder cannot be written" in output


@pytest.mark.parametrize(
    "arguments",
    [
        ["check", "rig.yaml", "--json", "folder.png"],
        ["check", "rig.yaml", "--json", "."],
        ["init", "robot.xml", "--out", "folder.png", "--force"],
        ["init", "robot.xml", "--out", ".", "--force"],
        ["presets", "velodyne_vlp16", "--picture", "folder.png"],
        ["view", "rig.yaml", "--save", "folder.html"],
    ],
    ids=" ".join,
)
def test_a_folder_in_place_of_a_file_is_told_at_once(
    rig: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.chdir(rig.parent)
    for name in ("folder.png", "folder.html"):
        Path(name).mkdir()
    name = next(name for name in arguments if Path(name).is_dir())
    assert call(*arguments) == (2, f"{name}: is a folder, expected the name of a file")


@pytest.mark.parametrize("command", ["run", "check"])
def test_kernels_that_cannot_be_written_are_told_with_their_folder(
    rig: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(rig.parent)

    def full(*_arguments: object) -> NoReturn:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(RigConfig, "build", full)
    code, output = call(command, rig)
    assert code == 2
    assert f"{wp.config.kernel_cache_dir}: kernels cannot be written there: No space left on device; WARP_" in output


@pytest.mark.parametrize(
    "error", [Exception("Failed to load CPU module 'it' (device='cpu')"), json.JSONDecodeError("Unterminated", "", 0)]
)
def test_damaged_kernels_are_told_with_their_folder(
    rig: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """Errors that Warp raises for a truncated file of its cache."""

    folder, wp.config.kernel_cache_dir = wp.config.kernel_cache_dir, None

    def load(*_arguments: object) -> NoReturn:
        wp.config.kernel_cache_dir = folder  # as Warp does when it starts
        raise error

    monkeypatch.setattr(RigConfig, "build", load)
    code, output = call("check", rig)
    told = f"{wp.config.kernel_cache_dir}: a kernel there is damaged: {error}; delete the folder, and kernels are"
    assert (code, told in output) == (2, True), output


@pytest.mark.parametrize("arguments", [["validat"], ["validate"], ["presets", "--bogus"]])
def test_bad_usage_exits_with_2(arguments: list[str]) -> None:
    assert call(*arguments)[0] == 2


def test_ctrl_c_exits_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(rigcast.cli.presets, "presets", interrupted)
    assert call("presets") == (130, "interrupted")
