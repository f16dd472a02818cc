"""The shell: overrides, JSON for programs, completion, help."""

import json
from pathlib import Path
from typing import Any

import pytest
from shell_calls import call
from typer.testing import CliRunner

from rigcast.cli import app

CONFIGS = Path(__file__).resolve().parents[3] / "configs"


def test_values_are_set_from_the_shell() -> None:
    code, output = call("validate", CONFIGS / "minimal.yaml", "--set", "sensors.top.rate_hz=5", "--set", "seed=3")
    assert code == 0, output
    assert "5 Hz" in output


def test_a_wrong_value_is_shown_with_a_caret() -> None:
    code, output = call("validate", CONFIGS / "minimal.yaml", "--set", "sensors.top.rate_hz=fast")
    assert code == 2
    place, line, caret = output.splitlines()
    assert place.startswith("--set:1:21: sensors[0].rate_hz: must be a number, got 'fast'")
    assert (line, caret) == ("    sensors.top.rate_hz=fast", "                        ^")


@pytest.mark.parametrize(
    "arguments", [["validate", CONFIGS / "minimal.yaml"], ["presets"], ["presets", "velodyne_vlp16"]]
)
def test_json_on_standard_output_stands_alone(arguments: list[Any]) -> None:
    code, output = call(*arguments, "--json", "-")
    assert code == 0
    assert json.loads(output, parse_constant=pytest.fail), "Infinity and NaN are Python's, and no JSON"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("rigcast va", ["validate"]),
        ("rigcast presets vel", ["velodyne_vlp16"]),
        ("rigcast run --du", ["--duration"]),
        ("rigcast run --se", ["--seed", "--set"]),
    ],
)
def test_the_shell_completes(words: str, expected: list[str]) -> None:
    asked = {"_RIGCAST_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    found = CliRunner().invoke(app, env=asked, prog_name="rigcast").stdout.split()
    assert set(expected) <= set(found)
    assert all(word.startswith(words.rpartition(" ")[2]) for word in found)


@pytest.mark.parametrize(
    "command", ["init", "run", "check", "validate", "watch", "view", "presets", "schema", "dataset", "bench"]
)
def test_help_has_examples(command: str) -> None:
    code, output = call(command, "--help")
    assert code == 0
    assert f"rigcast {command}" in output.partition("Examples:")[2]


def test_help_tells_the_exit_codes() -> None:
    assert "Exit codes: 0 done, 1 a ray is wrong" in " ".join(call("--help")[1].split())
