"""Workloads: a model in one state, and the rays of a depth camera and a lidar in it.

Two of the models are third-party: the Unitree G1 of mjlab, whose wheel is fetched from PyPI as data, and the aloha_pot
scene of mujoco_warp.
"""

import importlib.util
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import trimesh
import warp as wp

from rigcast.rig_file import open_rig
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

from .casters.caster import EVERY_GROUP, Floats

HIDDEN_GROUP = 5


@dataclass(frozen=True, eq=False)
class View:
    """The rays of a sensor: origin (3,) [m], unit directions (*shape, 3), in the world."""

    sensor: str
    origin: Floats
    directions: Floats


@dataclass(frozen=True, eq=False)
class Workload:
    """A model in one state with computed poses; the geoms of `groups` are visible."""

    name: str
    model: mujoco.MjModel
    data: mujoco.MjData
    views: tuple[View, ...]
    groups: tuple[int, ...] = EVERY_GROUP


class Unavailable(Exception):
    """A model that is not available here; the message gives the reason."""


def warehouse() -> Workload:
    """The demo, its camera and its lidar of 64 x 1024, without the robot, which their filters exclude."""
    config, model = open_rig(demo_rig())
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.keyframe(config.keyframe).id)
    rig = Rig(model, [sensor for sensor in config.sensors if sensor.name in ("front", "lidar_top")], "cpu")
    views = []
    for name, rays in rig.rays(data).items():
        views.append(View("depth" if name == "front" else "lidar", rays.origins.reshape(-1, 3)[0], rays.directions))
    model.geom_group[~rig.sensors[0].filter.visible(model)] = HIDDEN_GROUP
    return _workload("warehouse", model, data, *views)


def demo_rig() -> Path:
    return Path(str(files("rigcast.configs"))) / "demo.yaml"


def room(geoms: int = 1600) -> Workload:
    """A hall, 40 m square, with `geoms` boxes, cylinders and meshes at random places, each a body of its own."""
    rng = np.random.default_rng(0)
    spec = mujoco.MjSpec()
    for k in range(4):
        ball = trimesh.creation.icosphere(subdivisions=3)
        points = ball.vertices * (1 + 0.2 * rng.random((len(ball.vertices), 1)))
        spec.add_mesh(name=f"stone{k}", uservert=(0.3 * points).ravel(), userface=ball.faces.ravel())
    box, cylinder, mesh = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_MESH
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 1])
    for x, y in ((20, 0), (-20, 0), (0, 20), (0, -20)):
        spec.worldbody.add_geom(type=box, pos=[x, y, 2], size=[0.1 + abs(y), 0.1 + abs(x), 2])
    for kind in rng.choice(3, size=geoms, p=[0.5, 0.44, 0.06]):
        place = np.array([*rng.uniform(-19, 19, 2), rng.uniform(0, 2)])
        place[0] += 3 * np.sign(place[0]) * (np.hypot(place[0], place[1]) < 2)  # a place for the sensors
        body = spec.worldbody.add_body(pos=place, quat=rng.normal(size=4))
        if kind == 2:
            body.add_geom(type=mesh, meshname=f"stone{rng.integers(4)}")
        else:
            body.add_geom(type=(box, cylinder)[kind], size=rng.uniform(0.1, 0.4, 3))
    model = spec.compile()
    return _workload("room", model, mujoco.MjData(model), *_views((0.0, 0.0, 1.2), (5.0, 1.0, 0.8)))


def hills(triangles: int = 1_000_000) -> Workload:
    """A height field of about `triangles` triangles, 100 m square."""
    side = max(2, round((triangles / 2) ** 0.5)) + 1
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <asset><hfield name="hills" nrow="{side}" ncol="{side}" size="50 50 4 1"/></asset>
      <worldbody><geom type="hfield" hfield="hills"/></worldbody></mujoco>""")
    model.hfield_data[:] = _rough(side, 0).ravel()
    data = mujoco.MjData(model)
    return _workload("hills", model, data, *_views((0.0, 0.0, 6.0), (20.0, 5.0, 2.0)))


def g1() -> Workload:
    """A Unitree G1 (35 meshes, 393 k triangles) on a height field of 200 x 200 with 60 solids.

    Raises:
        Unavailable: the wheel with the robot could not be fetched.
    """
    spec = mujoco.MjSpec.from_file(str(_mjlab_folder() / "mjlab/asset_zoo/robots/unitree_g1/xmls/g1.xml"))
    rng = np.random.default_rng(0)
    terrain = _rough(200, 1)
    terrain -= terrain[100, 100]
    spec.add_hfield(name="terrain", nrow=200, ncol=200, size=[10, 10, 0.6, 1], userdata=terrain.ravel())
    height = 0.6 * np.clip(-terrain.min(), 0, None) / np.ptp(terrain)  # height of the middle, with data from 0 to 1
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="terrain", pos=[0, 0, -height])
    kinds = [getattr(mujoco.mjtGeom, f"mjGEOM_{name}") for name in ("SPHERE", "CAPSULE", "CYLINDER", "BOX")]
    for k in range(60):
        angle, far = rng.uniform(0, 2 * np.pi), rng.uniform(1.5, 9)
        place = [far * np.cos(angle), far * np.sin(angle), rng.uniform(0, 0.5)]
        body = spec.worldbody.add_body(pos=place, quat=rng.normal(size=4))
        body.add_geom(type=kinds[k % 4], size=rng.uniform(0.1, 0.3, 3))
    model = spec.compile()
    data = mujoco.MjData(model)
    lidar, camera = _views((0.0, 0.0, 1.6), (0.0, 0.0, 1.6))[1], _views((1.6, 0.9, 1.3), (0.0, 0.0, 0.7))[0]
    return _workload("g1", model, data, camera, lidar, groups=(0, 2))


def aloha_pot() -> Workload:
    """Two ALOHA arms and a pot on a table, from mujoco_warp's tests.

    Raises:
        Unavailable: mujoco_warp is not installed.
    """
    package = importlib.util.find_spec("mujoco_warp")
    if package is None or package.origin is None:
        raise Unavailable("mujoco_warp, which brings it, is not installed; pip install 'rigcast[benchmark]' does")
    path = Path(package.origin).parent / "test_data" / "aloha_pot" / "scene.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return _workload("aloha_pot", model, data, *_views((0.0, -0.9, 0.9), (0.0, 0.0, 0.2)))


WORKLOADS: dict[str, Callable[[], Workload]] = {
    "g1": g1,
    "warehouse": warehouse,
    "aloha_pot": aloha_pot,
    "room": room,
    "hills": hills,
}


def _workload(
    name: str,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    *views: View,
    groups: tuple[int, ...] = EVERY_GROUP[:HIDDEN_GROUP],
) -> Workload:
    mujoco.mj_forward(model, data)
    return Workload(name, model, data, views, groups)


def _views(eye: tuple[float, float, float], target: tuple[float, float, float]) -> tuple[View, View]:
    """Return a camera of 640 x 480 and 58 deg that looks at the target, and an upright lidar of 64 x 1024, +-25 deg."""
    nothing = mujoco.MjModel.from_xml_string("<mujoco/>")
    camera = DepthCamera(name="depth", mount=Mount(), resolution=(640, 480), fov_y_deg=58.0)
    lidar = Lidar(name="lidar", mount=Mount(), elevation_deg=np.linspace(25, -25, 64).tolist(), columns=1024)
    origin, towards = np.array(eye), np.array(target) - np.array(eye)
    towards /= np.linalg.norm(towards) or 1.0
    left = np.cross([0.0, 0.0, 1.0], towards)
    left /= np.linalg.norm(left) or 1.0
    looking = np.stack([towards, left, np.cross(towards, left)], axis=1) @ DepthCamera.frame_rotation
    return (
        View("depth", origin, camera.pattern(nothing).directions @ looking.T),
        View("lidar", origin, lidar.pattern(nothing).directions),
    )


def _rough(side: int, seed: int) -> npt.NDArray[np.float32]:
    """Return elevations (side, side) from 0 to 1: waves of all lengths, and a little noise."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 1, side)
    total = np.zeros((side, side))
    for octave in range(1, 7):
        a, b, c, d = rng.uniform(0, 2 * np.pi, 4)
        f = 2.0**octave * np.pi
        total += (np.sin(f * x + a)[:, None] * np.sin(f * x + b) + np.sin(f * x + c) * np.cos(f * x + d)[:, None]) / f
    total += rng.normal(scale=0.05 / side, size=total.shape)
    return ((total - total.min()) / np.ptp(total)).astype(np.float32)


def _mjlab_folder() -> Path:
    """Return the folder of mjlab's unpacked wheel, which is fetched once, beside Warp's kernels, and never run."""
    wp.init()
    folder = Path(wp.config.kernel_cache_dir).parent / "rigcast_bench"
    if not (folder / "mjlab").exists():
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(folder), "mjlab"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = (done.stderr.strip().splitlines() or ["pip says nothing"])[-1]
            raise Unavailable(f"the wheel of mjlab, which brings the robot, could not be fetched: {said}")
        wheel = next(folder.glob("mjlab-*.whl"))
        with zipfile.ZipFile(wheel) as archive:
            robot = [name for name in archive.namelist() if name.startswith("mjlab/asset_zoo/robots/unitree_g1/xmls/")]
            archive.extractall(folder, robot)
        wheel.unlink()
    return folder
