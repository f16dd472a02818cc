"""`rigcast watch` draws again when a file is saved, and goes on after mistakes in it."""

import io
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

from rigcast.cli import app
from rigcast.cli.watch import draw_once, keep_drawing
from rigcast.sensors.errors import InputError

MODEL = '<mujoco><worldbody><geom type="plane" size="0 0 1"/><body name="torso"/></worldbody></mujoco>'
BASE = """\
model: robot.xml
sensors:
  - {name: eye, type: depth_camera, mount: {body: torso, pos: [0, 0, 1]}, resolution: [8, 6], fov_y_deg: 60}
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    (tmp_path / "robot.xml").write_text(MODEL)
    (tmp_path / "base.yaml").write_text(BASE)
    (tmp_path / "rig.yaml").write_text("extends: base.yaml\n")
    return tmp_path / "rig.yaml"


def test_it_draws_every_sensor_and_knows_its_files(rig: Path) -> None:
    screen = io.StringIO()
    files = draw_once(Console(file=screen, width=300), rig, None, rig.parent, "cpu", ["sensors.eye.fov_y_deg=30"])
    assert sorted(path.name for path in files) == ["base.yaml", "rig.yaml", "robot.xml"]
    assert f"{rig}: 1 picture in {rig.parent}" in screen.getvalue()
    with Image.open(rig.parent / "eye.png") as picture:
        assert picture.width == 1200


@pytest.mark.parametrize(("out", "folder"), [((), "out/rig"), (("--out", "there"), "there")])
def test_pictures_are_in_the_folder_when_ctrl_c_ends_it(
    rig: Path, monkeypatch: pytest.MonkeyPatch, out: Sequence[str], folder: str
) -> None:
    def press(_period: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.chdir(rig.parent)
    monkeypatch.setattr("rigcast.cli.watch.time.sleep", press)
    done = CliRunner().invoke(app, ["watch", "rig.yaml", "--device", "cpu", *out])
    assert (done.exit_code, done.output.splitlines()[-1]) == (0, "stopped"), done.output
    assert [path.name for path in (rig.parent / folder).iterdir()] == ["eye.png"]


class Stop(Exception):
    pass


def watched(rig: Path, monkeypatch: pytest.MonkeyPatch, saves: Sequence[Callable[[], None]]) -> tuple[int, str]:
    """How often it draws, and its output, when files are saved one after another while it waits."""
    left, drawn, screen = iter(saves), 0, io.StringIO()

    def save_next(_period: float) -> None:
        action = next(left, None)
        if action is None:
            raise Stop
        action()

    def draw() -> Sequence[Path]:
        nonlocal drawn
        drawn += 1
        if not rig.is_file() or "bad" in rig.read_text():
            raise InputError("a mistake")
        return (rig, rig.parent / "base.yaml")

    monkeypatch.setattr("rigcast.cli.watch.time.sleep", save_next)
    with pytest.raises(Stop):
        keep_drawing(Console(file=screen), rig, draw)
    return drawn, screen.getvalue()


def save(path: Path, text: str, at: int) -> Callable[[], None]:
    def action() -> None:
        path.write_text(text)
        os.utime(path, ns=(at, at))

    return action


def test_it_draws_again_when_a_file_is_saved(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saves = [save(rig, "one", 1000), lambda: None, save(rig.parent / "base.yaml", "two", 2000)]
    assert watched(rig, monkeypatch, saves)[0] == 3


def test_it_waits_until_a_mistake_is_mended(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saves = [save(rig, "bad", 1000), save(rig, "bad too", 2000), save(rig, "good", 3000)]
    assert watched(rig, monkeypatch, saves) == (4, "a mistake\na mistake\n")


def test_a_file_that_is_gone_for_a_moment_is_waited_for(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert watched(rig, monkeypatch, [rig.unlink, save(rig, "back", 3000)]) == (3, "a mistake\n")
