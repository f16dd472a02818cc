"""Motion of the robot in `rigcast run`: by a user's controller, or by recorded positions."""

from pathlib import Path

import numpy as np
import pytest
from shell_calls import call

MODEL = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <geom name="wall" type="box" pos="4 0 0" size="0.1 3 1"/>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom type="box" size="0.2 0.2 0.2" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="slide"/></actuator>
  <keyframe><key name="late" time="7"/></keyframe>
</mujoco>
"""
RIG = """\
model: cart.xml
seed: 3
sensors:
  - {name: ahead, type: lidar, mount: {body: cart}, elevation_deg: [0], columns: 4, rate_hz: 50,
     filter: {exclude_bodies: [cart]}}
"""
PUSHING = """\
def push(model, seed):
    def control(data):
        data.ctrl[0] = seed
    return control

def nothing(model, seed):
    pass

def raising(model, seed):
    def control(data):
        1 / 0
    return control

def interrupting(model, seed):
    def control(data):
        if data.time > 0.05:
            raise KeyboardInterrupt
    return control
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the rig; another one is the current folder."""
    (tmp_path / "rig").mkdir()
    for name, text in {"cart.xml": MODEL, "cart.yaml": RIG, "pushing.py": PUSHING}.items():
        (tmp_path / "rig" / name).write_text(text)
    np.save(tmp_path / "motion.npy", [[0.0], [1.0], [1.5]])
    np.save(tmp_path / "two.npy", [[0.0], [1.0]])
    np.save(tmp_path / "one.npy", [[0.0]])
    np.save(tmp_path / "other.npy", np.zeros((3, 2)))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> tuple[int, str]:
    return call("run", "rig/cart.yaml", "--out", "o", *arguments, "--device", "cpu")


def positions() -> dict[float, float]:
    """The x coordinate of the sensor [m] by the time of each frame [s]."""
    with np.load("o/frames.npz") as index:
        return dict(zip(index["time"].round(6).tolist(), index["pose"][:, 0, 3].tolist(), strict=True))


@pytest.mark.parametrize(("keyframe", "began"), [((), 0.0), (("--set", "keyframe=late"), 7.0)])
def test_recorded_positions_are_played_back_for_as_long_as_they_last(keyframe: tuple[str, ...], began: float) -> None:
    code, output = run("--motion", "motion.npy", "--motion-rate", "20", *keyframe)
    assert code == 0, output
    assert "0.1 s on" in output
    expected = {0.02: 0.4, 0.04: 0.8, 0.06: 1.1, 0.08: 1.3, 0.1: 1.5}
    assert positions() == pytest.approx({round(began + time, 6): place for time, place in expected.items()})


def test_a_slow_motion_is_played_back_slowly() -> None:
    code, output = run("--motion", "two.npy", "--motion-rate", "0.5", "--duration", "0.04")
    assert code == 0, output
    assert positions() == pytest.approx({0.02: 0.01, 0.04: 0.02})


def test_after_ctrl_c_the_frames_from_before_are_told() -> None:
    code, output = run("--controller", "pushing:interrupting", "--duration", "1")
    assert (code, output.splitlines()[-2:]) == (130, ["2 frames from before Ctrl-C are in o", "interrupted"])
    assert list(positions()) == [0.02, 0.04]


@pytest.mark.parametrize(("seed", "force"), [((), 3.0), (("--seed", "5"), 5.0)])
def test_a_controller_drives_the_robot_by_the_seed(seed: tuple[str, ...], force: float) -> None:
    """x = F (t - 1 + exp(-t)) of a mass of 1 kg with a damping of 1 N s/m."""
    code, output = run("--controller", "pushing:push", "--duration", "0.4", *seed)
    assert code == 0, output
    reached = positions()[0.4]
    assert reached == pytest.approx(force * (0.4 - 1 + np.exp(-0.4)), rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--motion", "motion.npy"), "--motion and --motion-rate: expected both"),
        (("--motion-rate", "20"), "--motion and --motion-rate: expected both"),
        (("--motion", "motion.npy", "--motion-rate", "0"), "--motion-rate: got 0, expected a positive number"),
        (("--motion", "motion.npy", "--motion-rate", "inf"), "--motion-rate: got inf, expected a positive number"),
        (("--motion", "other.npy", "--motion-rate", "9"), "other.npy: got rows of 2 numbers, expected nq = 1"),
        (
            ("--motion", "one.npy", "--motion-rate", "9"),
            "one.npy: got an array of shape (1, 1), expected 2 rows or more",
        ),
        (("--motion", "absent.npy", "--motion-rate", "9"), "absent.npy: not an NPY file"),
        (
            ("--motion", "motion.npy", "--motion-rate", "20", "--duration", "0.2"),
            "--duration: got 0.2 s, but the motion lasts 0.1 s",
        ),
        (
            ("--motion", "motion.npy", "--motion-rate", "20", "--controller", "pushing:push"),
            "--controller and --motion: expected one of them",
        ),
        (("--controller", "pushing"), "--controller: got 'pushing', expected MODULE:FUNCTION"),
        (("--controller", "pushing:pull"), "pushing:pull cannot be imported: AttributeError"),
        (("--controller", "pushing:nothing"), "pushing.py:6: pushing:nothing: got NoneType, expected a function"),
        (("--controller", "pushing:raising"), "pushing.py:11: pushing:raising: ZeroDivisionError"),
    ],
)
def test_what_cannot_move_it_is_refused(arguments: tuple[str, ...], message: str) -> None:
    code, output = run(*arguments)
    assert code == 2
    assert message in " ".join(output.split()), output
