"""Small data sets on disk: files that make them, and what is in their folders."""

from collections.abc import Callable
from pathlib import Path

from rigcast.dataset.description.config import read_dataset
from rigcast.dataset.making.engines import Engine, InProcess
from rigcast.dataset.making.episode import Result
from rigcast.dataset.making.generate import Done, make_dataset

ROOM = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <body name="table" pos="2 1 0.4"><geom type="box" size="0.3 0.3 0.4"/></body>
    <body name="sign" mocap="true" pos="2 -1 1"><geom type="box" size="0.1 0.3 0.3"/></body>
    <body name="ball" pos="1 0 3"><freejoint/><geom size="0.2"/></body>
    <body name="cart" pos="0 0 0.5">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom type="box" size="0.2 0.2 0.2"/>
    </body>
  </worldbody>
  <actuator><motor joint="slide" gear="20" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""

RIG = """\
model: room.xml
sensors:
  - name: top
    type: lidar
    mount: {body: cart, pos: [0, 0, 0.5]}
    elevation_deg: [-20, 0]
    columns: 36
    rate_hz: 50
    noise: {range_std: 0.01}
  - name: front
    type: depth_camera
    mount: {body: cart, pos: [0.3, 0, 0]}
    resolution: [8, 6]
    fov_y_deg: 60
    rate_hz: 25
"""

SECOND_MACHINE = "RIGCAST_TEST_SECOND_MACHINE"  # environment variable of the machine that `lost` kills

# A user's module beside a data set. `unlucky` kills its process once, and always in the episode with the seed in the
# file `deadly`; `lost` kills the second machine once.
MODULE = f"""\
import os, signal
from pathlib import Path
import mujoco

HERE = Path(__file__).parent

def room(seed):
    text = (HERE / "room.xml").read_text()
    return mujoco.MjModel.from_xml_string(text.replace('pos="4 0 1"', f'pos="{{4 + seed % 100 / 100}} 0 1"'))

def push(model, seed):
    def control(data):
        data.ctrl[:] = seed % 7 / 7 + data.time
    return control

def unlucky(model, seed):
    def control(data):
        if data.time > 0.05 and not (HERE / "killed").exists():
            (HERE / "killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if (HERE / "deadly").exists() and (HERE / "deadly").read_text() == str(seed):
            os.kill(os.getpid(), signal.SIGKILL)
    return control

def lost(model, seed):
    def control(data):
        if data.time > 0.05 and "{SECOND_MACHINE}" in os.environ and not (HERE / "killed").exists():
            (HERE / "killed").touch()
            os.kill(os.getppid(), signal.SIGKILL)  # the machine's Ray process
            os.kill(os.getpid(), signal.SIGKILL)
    return control

def broken(model, seed):
    raise OSError("no weights")

number = 3
"""

MODULE_NAME = "users_functions"

DATASET = """\
rig: rig.yaml
scenes:
  - {name: room, file: room.xml}
  - {name: made, python: "users_functions:room"}
episodes: {count: 2, duration: 0.1, controller: {type: python, function: "users_functions:push"}}
randomise:
  poses: {table: {pos: [0.5, 0.5, 0], euler_deg: [0, 0, 180]}, sign: {pos: [0, 1, 0]}, ball: {euler_deg: [9, 9, 9]}}
  rig: {sensors.top.noise.range_std: [0, 0.05], sensors.top.noise.dropout: [0, 0.5]}
seed: 3
"""


def write_files(folder: Path) -> Path:
    """Write the files of a data set to `folder`; return the path of its description."""
    files = {"room.xml": ROOM, "rig.yaml": RIG, f"{MODULE_NAME}.py": MODULE, "set.yaml": DATASET}
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder / "set.yaml"


def edited(path: Path, old: str, new: str) -> Path:
    """Replace text in the file; return its path."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def controlled_by(path: Path, controller: str) -> Path:
    """Replace the controller in a data set's file; return its path."""
    return edited(path, path.read_text().partition("controller: {")[2].partition("}")[0], controller)


def make(
    path: Path,
    name: str = "out",
    engine: Engine | None = None,
    part: tuple[int, int] = (1, 1),
    report: Callable[[Result], None] = lambda _result: None,
) -> Done:
    """Make the missing episodes of the data set in the folder `name` beside its file."""
    folder, engine = path.parent / name, engine or InProcess()
    return make_dataset(read_dataset(path), folder, engine, device="cpu", part=part, report=report)


def contents(folder: Path) -> dict[str, bytes]:
    """The bytes of every file of a folder by its relative path."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
