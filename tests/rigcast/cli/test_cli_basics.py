"""Commands print tables, or one message with exit code 2, never a traceback."""

import errno
import io
import json
import os
import re
import subprocess
import sys
import threading
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, NoReturn

import pytest
import warp as wp
from rich.console import Console
from rich.table import Table
from typer.testing import CliRunner

import rigcast.cli.presets
from rigcast.cli import app
from rigcast.cli.common import ready
from rigcast.cli.common.options import show
from rigcast.rig_file import RigConfig
from rigcast.rig_file.file import RigFile
from rigcast.sensors.specs.presets import load_preset, preset_names

COMMANDS = ("init", "run", "check", "validate", "watch", "view", "publish", "presets", "schema", "dataset", "bench")
MODEL = '<mujoco><worldbody><body name="torso"><geom size="0.1"/></body></worldbody></mujoco>'
RIG = """\
model: robot.xml
sensors:
  - {name: top, type: lidar, preset: velodyne_vlp16, mount: {body: torso}}
  - {name: front, type: depth_camera, mount: {}, resolution: [64, 48], fov_y_deg: 58}
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    (tmp_path / "robot.xml").write_text(MODEL)
    (tmp_path / "rig.yaml").write_text(RIG)
    return tmp_path / "rig.yaml"


def call(*arguments: str | Path) -> tuple[int, str]:
    """Exit code and what was printed, on one line: tables wrap at the width of the terminal."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, " ".join(result.output.split())


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


def test_validate_shows_the_sensors(rig: Path) -> None:
    code, output = call("validate", rig)
    assert code == 0, output
    assert "┃ sensor ┃ type ┃ rays ┃ view [deg] ┃ rate ┃ mount ┃" in output
    assert "│ top │ lidar │ 16 x 1808 │ 360 x 30 │ 10 Hz │ body torso │" in output
    assert "│ front │ depth_camera │ 48 x 64 │ 72.1 x 57 │ every step │ world │" in output


@pytest.mark.parametrize(
    ("sensor", "view"),
    [
        ("type: lidar, elevation_deg: [-0.26, 0.26], columns: 9, azimuth_deg: [-3.14, 3.14]", "6.28 x 0.52"),
        ("type: lidar, elevation_deg: [10], columns: 1", "0 x 0"),
        ("type: height_scan, size: [1, 1], spacing: 0.5", "down"),
        (
            "type: depth_camera, resolution: [9, 9], fx: 2, fy: 2, cx: 4.5, cy: 4.5, distortion: {type: "
            "kannala_brandt}",
            "331 x 172",
        ),
    ],
)
def test_validate_shows_how_far_a_sensor_sees_around(rig: Path, sensor: str, view: str) -> None:
    rig.write_text(f"model: robot.xml\nsensors: [{{name: s, mount: {{}}, {sensor}}}]\n")
    code, output = call("validate", rig)
    assert code == 0, output
    assert f" │ {view} │ " in output


def test_a_sensor_that_reads_more_often_than_the_model_steps_is_named(rig: Path) -> None:
    word = "sensor 'front' reads at 600 Hz, the model steps at 500 Hz: rig.step gives one frame of a step"
    for rate, moves, named in ((600, 0, True), (500, 0, False), (600, 0.001, False)):
        values = f"sensors.front.rate_hz={rate}", f"sensors.front.readout_time={moves}"
        code, output = call("validate", rig, "--set", values[0], "--set", values[1])
        assert (code, word in output) == (0, named), output


def test_a_sensor_within_a_geom_of_its_own_body_is_named(rig: Path) -> None:
    word = (
        "of body 'torso' or on its surface, which hides from it what is outside; "
        "exclude_bodies: [torso] in its filter leaves that out"
    )
    for command in (("validate", rig), ("check", rig, "--rays", "20")):
        code, output = call(*command)
        assert code == 0, output
        assert word in output
        assert word not in call(*command, "--set", "sensors.top.mount.pos=[0,0,9]")[1]


def test_validate_takes_another_model(rig: Path) -> None:
    (rig.parent / "other.xml").write_text(MODEL.replace("torso", "trunk"))
    code, output = call("validate", rig, "--model", rig.parent / "other.xml")
    assert code == 2
    assert f"{rig}:3:68: sensors[0].mount.body: no body 'torso' in the model, expected one of world, trunk" in output


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
    rig.write_text(RIG.replace(old, new))
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
    rig.write_text(RIG.replace("name: front", f"name: {LONG}"))
    assert f"│ {LONG} │ depth_camera │" in call("validate", rig)[1]
    narrow = Console(file=io.StringIO(), width=40, force_terminal=True, color_system=None)
    table = Table("sensor", "type")
    table.add_row(LONG, "depth_camera")
    show(narrow, table)
    lines = narrow.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= 40
    assert "".join(line.split("│")[1].strip() for line in lines if "│" in line) == LONG


def run_main(*arguments: str, stdout: int | IO[bytes]) -> tuple[int, str]:
    """Exit code and standard error of a process of its own."""
    main = "import sys; from rigcast.cli import main; main()"
    command = [sys.executable, "-c", main, *arguments]
    done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False)
    return done.returncode, done.stderr


LONG_ANSWERS = (["--help"], ["schema"], ["presets"], ["presets", "velodyne_vlp16", "--json", "-"])


@pytest.mark.parametrize("arguments", LONG_ANSWERS, ids=" ".join)
def test_a_pipe_that_nobody_reads_ends_a_command_without_a_word(arguments: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    try:
        assert run_main(*arguments, stdout=write) == (141, "")
    finally:
        os.close(write)


def test_a_run_whose_words_nobody_reads_is_recorded_whole(rig: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    out = rig.parent / "out"
    try:
        outside = "sensors.top.mount.pos=[0, 0, 9]"  # outside the torso, about which a warning would be printed before
        code, _ = run_main("run", str(rig), "--device", "cpu", "--out", str(out), "--set", outside, stdout=write)
    finally:
        os.close(write)
    assert code == 141
    assert sorted(path.name for path in out.iterdir()) == ["frames.npz", "front", "ids.json", "top"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this machine")
@pytest.mark.parametrize("arguments", LONG_ANSWERS, ids=" ".join)
def test_a_full_disk_at_standard_output_is_told_in_one_line(arguments: list[str]) -> None:
    with Path("/dev/full").open("wb") as full:
        code, words = run_main(*arguments, stdout=full)
    assert (code, words) == (1, "standard output: cannot be written: No space left on device\n")


def run_redirected(redirection: str, *arguments: str) -> int:
    """Exit code of `python -m rigcast` with a redirection of the shell's."""
    command = ["sh", "-c", f'exec "$@" {redirection}', "sh", sys.executable, "-m", "rigcast", *arguments]
    return subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this machine")
@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-", "2>&- >&- <&-"])
@pytest.mark.parametrize("arguments", [["validate", "gone.yaml"], ["validat"], ["presets", "--bogus"]], ids=" ".join)
def test_words_that_cannot_be_told_change_no_exit_code(redirection: str, arguments: list[str]) -> None:
    assert run_redirected(redirection, *arguments) == 2


@pytest.mark.parametrize(("redirection", "code"), [("2>&-", 0), (">&-", 1), (">&- 2>&-", 1), ("<&-", 0)])
def test_a_stream_that_is_closed_is_told_apart_from_an_answer_that_is_lost(redirection: str, code: int) -> None:
    assert run_redirected(redirection, "presets", "--json", "-") == code


def test_letters_that_the_terminal_does_not_have_are_escaped(rig: Path) -> None:
    rig = rig.rename(rig.with_name("r\u00e4der.yaml"))
    command = [sys.executable, "-m", "rigcast", "validate", str(rig)]
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, env=ascii_only, check=False)
    assert done.returncode == 0, done.stderr
    assert b"r\\xe4der.yaml: valid, 2 sensors" in done.stdout


def test_no_file_takes_the_number_of_a_closed_stream() -> None:
    """Else the output of libraries would be written to that file."""
    opens = "import os; from rigcast.cli.common.streams import prepare_streams; prepare_streams()"
    opens += "; os._exit(os.open(os.devnull, os.O_WRONLY))"
    command = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", sys.executable, "-c", opens]
    assert subprocess.run(command, check=False).returncode > 2


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


@pytest.mark.parametrize(
    ("angles", "told"),
    [
        ("[0, 0, 1.5708]", "euler_deg has 1.5708, which is pi / 2 to 4 digits: it is in degrees"),
        ("[-3.14159, 0, 0]", "euler_deg has -3.14159, which is -pi to 4 digits: it is in degrees"),
        ("[0.785398, 0, 90]", "euler_deg has 0.785398, which is pi / 4 to 4 digits: it is in degrees"),
        ("[0, 1.5, 90]", None),
        ("[0, 0, 0]", None),
    ],
)
def test_angles_that_seem_to_be_radians_are_told(rig: Path, angles: str, told: str | None) -> None:
    rig.write_text(RIG.replace("mount: {}", f"mount: {{euler_deg: {angles}}}"))
    code, output = call("validate", rig)
    assert code == 0
    assert ("euler_deg" in output) == (told is not None)
    assert told is None or f"sensor 'front': {told}" in output


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


def test_presets_are_listed() -> None:
    code, output = call("presets")
    assert code == 0
    assert "┃ preset ┃ type ┃ device ┃ cited ┃" in output
    assert all(f"│ {name} │ {load_preset(name).type} │" in output for name in preset_names())


def test_the_list_counts_figures() -> None:
    code, output = call("presets", "--json", "-")
    assert code == 0
    entries = {entry["name"]: entry for entry in json.loads(output)}
    _, table = call("presets")
    for preset in map(load_preset, preset_names()):
        cited = entries[preset.name]["cited"]
        assert set(cited) == preset.cited()
        share = f"{len(cited)} of {len(preset.stated())}"
        assert re.search(rf"│ {preset.name} +│[^│]+│[^│]+│ +{share} │", table), preset.name


def test_unknown_preset_names_the_nearest() -> None:
    code, output = call("presets", "velodyne_vlp61")
    assert code == 2
    assert "unknown preset 'velodyne_vlp61'" in output
    assert "did you mean 'velodyne_vlp16'?" in output


def schema() -> dict[str, Any]:
    code, output = call("schema")
    assert code == 0

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is not JSON")

    return dict(json.loads(output, parse_constant=refuse))


def test_schema_knows_the_keys_and_explains_them() -> None:
    document = schema()
    definitions = document["$defs"]
    assert set(document["properties"]) == set(RigFile.model_fields)
    of_all = {"Mount", "Filter", "Prop", "Surface", "Export"}
    of_lidars = {
        "Lidar",
        "Rosette",
        "Wedge",
        "Nodding",
        "RayArrays",
        "RayFile",
        "Noise",
        "Detection",
        "Beam",
        "Weather",
    }
    of_cameras = {"DepthCamera", "BrownConrady", "KannalaBrandt", "Stereo", "TimeOfFlight"}
    assert set(definitions) == of_all | of_lidars | of_cameras | {"HeightScan"}
    for name, definition in {"RigFile": document, **definitions}.items():
        assert definition["additionalProperties"] is False
        unexplained = [key for key, field in definition["properties"].items() if "description" not in field]
        assert unexplained in ([], ["type"]), name


@pytest.mark.parametrize(
    ("sensor", "required"),
    [
        ("Lidar", {"type", "name", "mount"}),
        ("DepthCamera", {"type", "name", "mount"}),
        ("HeightScan", {"type", "name", "mount", "size", "spacing"}),
    ],
)
def test_schema_requires_what_no_preset_gives(sensor: str, required: set[str]) -> None:
    assert set(schema()["$defs"][sensor]["required"]) == required


@pytest.mark.parametrize("key", ["max_range", "columns", "elevation_deg"])
def test_schema_gives_no_default_that_a_file_could_not_hold(key: str) -> None:
    assert "default" not in schema()["$defs"]["Lidar"]["properties"][key]


class Full(io.StringIO):
    """A file on a full disk."""

    def write(self, _text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_word_of_compiling_that_cannot_be_written_is_left_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ready, "_PATIENCE", 0.0)
    before = set(threading.enumerate())
    with ready.word_if_compiling(Console(file=Full())):
        for thread in set(threading.enumerate()) - before:
            thread.join()
    assert capsys.readouterr().err == ""
