"""`rigcast dataset` from the shell."""

import json
import re
import sys
from functools import partial
from pathlib import Path

import pytest
from shell_calls import call_on_one_line
from small_datasets import MODULE_NAME, contents, edited

from rigcast.dataset.description.config import read_dataset
from rigcast.sensors.errors import InputError


@pytest.fixture(autouse=True)
def folder(path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, as the default output is relative."""
    monkeypatch.chdir(path.parent)
    return path.parent


def call(*arguments: str) -> tuple[int, str]:
    return call_on_one_line("dataset", "set.yaml", *arguments)


def test_a_data_set_is_made_told_about_and_verified(folder: Path, whole: dict[str, bytes]) -> None:
    code, output = call("--device", "cpu")
    assert code == 0, output
    assert "4 of 4 episodes to make, 1 at a time" in output
    assert "4 of 4 episodes" in output
    assert "0 failed, 0 not made yet" in output
    assert "s left" in output
    manifest = json.loads(whole["dataset.json"])
    for name, one in manifest["statistics"].items():
        nearest, mean, farthest = one["range"]
        spans = f"{nearest:.2f} to {farthest:.2f}, mean {mean:.2f}"
        row = f"│ {name} │ {one['frames']} │ {one['rays']} │ {100 * one['hits'] / one['rays']:.0f} % │ {spans} │"
        assert row in output
    told = re.search(
        r"4 episodes in \S+ s: \S+ frames/s, .*/s; the limit is (\w+) \((.*) of the workers' time\)", output
    )
    assert told is not None, output
    shares = {name: int(share) for name, share in re.findall(r"(\w+) (\d+) %", told[2])}
    assert list(shares) == ["loading", "physics", "casting", "writing", "waiting"]
    assert shares[told[1]] == max(shares.values())
    assert abs(sum(shares.values()) - 100) <= 3, "but for rounding"
    assert contents(folder / "out/set") == whole
    code, output = call("--verify")
    assert (code, "all unchanged" in output) == (0, True)
    (folder / "out/set/room/000000/ids.json").write_text("{}")
    code, output = call("--verify")
    assert (code, "1 wrong" in output) == (1, True)


def test_parts_of_an_array_job_make_the_whole(folder: Path, whole: dict[str, bytes]) -> None:
    code, output = call("--device", "cpu", "--shard", "2/2")
    assert (code, "2 of 2 episodes to make" in output, "2 not made yet" in output) == (0, True, True)
    assert call("--device", "cpu", "--shard", "1/2")[0] == 0
    assert contents(folder / "out/set") == whole
    code, output = call("--device", "cpu")
    assert (code, "0 of 4 episodes to make" in output) == (0, True)


def test_a_shard_without_its_entry_is_told(folder: Path) -> None:
    shard = folder / "out/set/room/000001"
    shard.mkdir(parents=True)
    (shard / "frames.npz").write_text("half")
    code, output = call("--device", "cpu")
    assert (code, output.count("has no entry.json")) == (0, 1), output
    assert "room/000001: has no entry.json" in output
    assert "has no entry.json" not in call("--device", "cpu")[1]


def test_a_sensor_that_sees_only_its_own_body_is_told_once(folder: Path) -> None:
    edited(folder / "rig.yaml", "pos: [0, 0, 0.5]", "pos: [0, 0, 0.2]")
    code, output = call("--device", "cpu")
    assert code == 0
    assert output.count("sensor 'top' is within geom") == 1, "two scenes of two episodes"
    assert output.index("sensor 'top' is within geom") < output.index("simulated")
    assert "UserWarning" not in output


def test_an_episode_that_fails_is_told_with_its_reason(folder: Path) -> None:
    edited(folder / "set.yaml", "seed: 3", "seed: 3\noutput: {fields: {top: [range]}}")
    edited(folder / "room.xml", 'damping="1"', 'stiffness="-1e9" springref="1"')
    edited(folder / f"{MODULE_NAME}.py", "read_text()\n", "read_text().replace('-1e9', '0')\n")
    code, output = call("--device", "cpu")
    assert code == 1
    assert output.count("failed: ") == 1, "two failed for one reason"
    assert "failed: room, episode 0 (seed" in output
    assert ") and 1 other: the simulation diverged at t = 0" in output


# What is written below the module, and the line of it and the words that are told.
FUNCTION_FAULTS = {
    "raises": ("def push(model, seed):\n    raise OSError('no weights')", 2, "OSError: no weights"),
    "leaves": ("def push(model, seed):\n    raise SystemExit(3)", 2, "SystemExit: 3"),
    "step raises": (
        "def push(model, seed):\n    def act(data):\n        3 / 0\n    return act",
        3,
        "ZeroDivisionError",
    ),
    "takes too few": ("def push(model):\n    return print", 1, "TypeError: push() takes 1 positional argument but 2"),
    "step takes too few": (
        "def push(model, seed):\n    def act(): pass\n    return act",
        2,
        "TypeError: push.<locals>",
    ),
    "no function": ("def push(model, seed):\n    pass", 1, "got NoneType, expected a function of the MjData"),
    "value": (
        "def push(model, seed):\n    return lambda data: 3",
        2,
        "got int from the function of the MjData, expected None",
    ),
    "scene raises": ("def room(seed):\n    return 1 / 0", 2, "ZeroDivisionError: division by zero"),
    "no model": ("def room(seed):\n    return ''", 1, "got str, expected an MjModel"),
}


@pytest.mark.parametrize("kind", FUNCTION_FAULTS)
def test_a_function_with_which_every_episode_fails_is_told_before_any(folder: Path, kind: str) -> None:
    text, line, words = FUNCTION_FAULTS[kind]
    module = folder / f"{MODULE_NAME}.py"
    line += len(module.read_text().splitlines())
    module.write_text(f"{module.read_text()}{text}\n")
    code, output = call("--device", "cpu")
    assert (code, (folder / "out").exists()) == (2, False), output
    scene, name = ("made", "room") if "def room" in text else ("room", "push")
    assert f"set.yaml: scene '{scene}': {MODULE_NAME}.py:{line}: {MODULE_NAME}:{name}: {words}" in output


def test_a_folder_that_cannot_be_written_is_told_before_functions_are_tried(folder: Path) -> None:
    edited(folder / f"{MODULE_NAME}.py", "def room(seed):\n", "def room(seed):\n    1 / 0\n")
    (folder / "full").write_text("no folder")
    code, output = call("--out", "full/set", "--device", "cpu")
    told = f"{folder / 'full'}: the output folder cannot be written: File exists"
    assert (code, output.endswith(told)) == (2, True), output


def test_a_function_that_fails_with_one_seed_fails_that_episode(folder: Path) -> None:
    first = read_dataset(Path("set.yaml")).unit("made", 0).seed
    del sys.modules[MODULE_NAME]
    edited(folder / f"{MODULE_NAME}.py", "def room(seed):\n", f"def room(seed):\n    1 / (seed - {first})\n")
    for _ in range(2):  # what failed is tried again
        code, output = call("--device", "cpu")
        assert code == 1
        assert "failed: made, episode 0 (seed" in output
        assert f"{MODULE_NAME}.py:8: {MODULE_NAME}:room: ZeroDivisionError" in output


def test_what_a_function_s_model_lacks_is_told_before_its_episodes(folder: Path) -> None:
    edited(folder / f"{MODULE_NAME}.py", "read_text()\n", "read_text().replace('cart', 'carts')\n")
    code, output = call("--device", "cpu")
    assert code == 2
    assert (
        f"set.yaml: scene 'made': {folder}/rig.yaml:5:19: sensors[0].mount.body: no body 'cart' in the model" in output
    )


@pytest.mark.parametrize(
    ("arguments", "engine", "given"),
    [
        (["--engine", "processes"], "Processes", (None,)),
        (["--engine", "processes", "--workers", "3"], "Processes", (3,)),
        (["--engine", "ray", "--workers", "3"], "Ray", (None, 3)),
        (["--address", "auto"], "Ray", ("auto", None)),
    ],
)
def test_the_engine_is_the_one_that_was_asked_for(
    arguments: list[str], engine: str, given: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str, *asked: object) -> None:
        raise InputError(f"{name}{asked}")

    for name in ("InProcess", "Processes", "Ray"):
        monkeypatch.setattr(f"rigcast.cli.dataset.{name}", partial(refuse, name))
    assert call(*arguments) == (2, f"{engine}{given}")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--shard", "0/2"], "--shard: got 0/2, expected a part from 1/2 to 2/2"),
        (["--shard", "3/2"], "--shard: got 3/2, expected a part from 1/2 to 2/2"),
        (["--shard", "1/0"], "--shard: got '1/0', expected I/N, such as 1/8"),
        (["--shard", "half"], "--shard: got 'half', expected I/N, such as 1/8"),
        (["--device", "gpu"], "no device 'gpu', expected one of cpu"),
        (["--workers", "4"], "--workers: got 4 with --engine in-process, expected --engine processes or ray"),
        (["--set", "seed=-1"], "--set:1:6: seed: must be greater than or equal to 0"),
        (["--verify", "--out", "none"], "none/dataset.json: not the manifest of a data set: No such file or directory"),
    ],
)
def test_a_mistake_is_told(arguments: list[str], message: str) -> None:
    code, output = call(*arguments)
    assert (code, message in output) == (2, True), output
