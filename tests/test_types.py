"""Users' code passes a type checker, which finds its errors.

mypy sees rigcast as installed, with its rooms in one folder; faults that it reports in rigcast are not counted.
"""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import rigcast

pytestmark = pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")

CHECKOUT = Path(__file__).resolve().parent.parent
PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
SETTINGS = """[mypy]
strict = true
follow_imports = silent
ignore_missing_imports = true

[mypy-torch.*]
follow_imports = skip

[mypy-pages.*]
disallow_untyped_defs = false
disallow_untyped_calls = false
"""
# each line that a type checker is to object to ends in # wrong
USER = """
from pathlib import Path
from typing import assert_type

import mujoco
import numpy as np
import numpy.typing as npt
import rigcast

rigcast.Lidarr(name="top")  # wrong
rigcast.__version__.split(".")
rng = np.random.default_rng(0)
mount = rigcast.Mount(pos=[0, 0, 1], quat=np.array([1, 0, 0, 0]))
mount = rigcast.Mount(pos=rng.normal(size=3), euler_deg=(0, 0, 90))
assert_type(mount.pos, tuple[float, float, float])
rigcast.Mount(pos="left")  # wrong
rigcast.Mount(po=[0, 0, 1])  # wrong
lidar = rigcast.Lidar(name="top", mount=mount, elevation_deg=np.linspace(-15, 15, 16), columns=100)
rigcast.Lidar(name="top", columns=100)  # wrong
rigcast.Lidar(name="top", mount={"body": "base"}, elevation_deg=range(-15, 15), columns=100, noise={"range_std": 0.1})
rigcast.Lidar(name="top", mount=mount, ray_file={"path": Path("rays.csv")})
rigcast.Lidar(name="top", mount=mount, noise=0.1)  # wrong
camera = rigcast.DepthCamera(name="front", mount=mount, resolution=[640, 480], fov_y_deg=58)
rigcast.DepthCamera(name="front", mount=mount, resolution=640)  # wrong
scan = rigcast.HeightScan(name="feet", mount=mount, size=[1, 1], spacing=0.1)
rigcast.Filter(geom_groups=[0, 1], exclude_bodies=["base"])
rigcast.Prop(name="box", file="box.stl", scale=[1, 1, 2])
model = mujoco.MjModel.from_xml_path("scene.xml")
rig = rigcast.Rig(model, [lidar, camera, scan, *rigcast.from_model(model, resolution=[64, 48])])
frame = rig.sense(mujoco.MjData(model))["front"]
ranges: npt.NDArray[np.float32] = frame.range.numpy()
frame.depth.numpy(), frame.depth_16bit.numpy(), frame.intrinsics[0, 0], frame.lens, frame.intensity.shape
frame.ring.numpy(), frame.column.numpy(), frame.time.shape, frame.time + 0.1, frame.pose[:3, 3]
frame.deepth  # wrong
hits = rigcast.Scene(model).cast((0, 0, 1), [[1, 0, 0], [0, 1, 0]], filter=rigcast.Filter())
hits.distance.numpy(), hits.numpy().geom_id
assert rigcast.check(rig, mujoco.MjData(model)).wrong == 0
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the package as installed, a user's settings, and the Python of each page as a file."""
    package = tmp_path / "site" / "rigcast"
    package.mkdir(parents=True)
    rooms = [CHECKOUT / room for room in ("sensors", "kernels", "configs")]
    for path in [*(CHECKOUT / "rigcast").iterdir(), *rooms]:
        (package / path.name).symlink_to(path)
    (tmp_path / "mypy.ini").write_text(SETTINGS)
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / "__init__.py").touch()
    for page in PAGES:
        blocks = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
        (tmp_path / "pages" / f"{page.stem}.py").write_text("".join(blocks))
    return tmp_path


def test_a_type_checker_objects_to_what_is_wrong_and_to_nothing_else(folder: Path) -> None:
    user = USER + "".join(f"rigcast.{name}\n" for name in rigcast.__all__)
    (folder / "user.py").write_text(user)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=mypy.ini", "user.py", "pages"],
        cwd=folder,
        env={"MYPYPATH": "site"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    found = re.findall(r"^(\S+\.py):(\d+): error", done.stdout, re.MULTILINE)
    wrong = [("user.py", str(k)) for k, line in enumerate(user.splitlines(), start=1) if line.endswith("# wrong")]
    assert sorted(set(found)) == sorted(wrong), done.stdout + done.stderr
