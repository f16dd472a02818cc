"""Many worlds of a robot on a landscape, with a different place and posture in each world."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import numpy.typing as npt
import warp as wp

from rigcast.bench.casters import Floats
from rigcast.bench.workloads import Workload
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

ROWS, COLUMNS = 16, 64
G1_HEAD = Mount(body="torso_link", pos=(0.0, 0.0, 0.55))
"""A mount above the head of a G1, from which its shoulders, arms and feet are visible."""
_FIELDS = {"geom_xpos": wp.vec3, "geom_xmat": wp.mat33, "xpos": wp.vec3, "xmat": wp.mat33}


@dataclass(frozen=True, eq=False)
class Crowd:
    """A robot in each of many worlds, with a lidar on it.

    poses: by MuJoCo's names, float32 as mujoco_warp has them: geom_xpos (nworld, ngeom, 3), geom_xmat (nworld, ngeom,
    3, 3), and those of bodies, xpos and xmat.
    """

    workload: Workload
    lidar: Lidar
    poses: dict[str, npt.NDArray[np.float32]]

    def on_device(self, worlds: int, device: wp.Device) -> dict[str, wp.array]:
        """The poses of the first `worlds` worlds."""
        return {
            name: wp.array(self.poses[name][:worlds], dtype=dtype, device=device) for name, dtype in _FIELDS.items()
        }

    def data(self, world: int) -> mujoco.MjData:
        """One world with the device's poses, rounded as they are there."""
        data = mujoco.MjData(self.workload.model)
        for name, values in self.poses.items():
            getattr(data, name)[:] = values[world].reshape(len(values[world]), -1)
        return data

    @cached_property
    def directions(self) -> Floats:
        """Directions (n, 3) of the lidar's rays in its own frame."""
        return self.lidar.pattern(self.workload.model).directions.reshape(-1, 3)


def crowd(workload: Workload, mount: Mount, worlds: int, seed: int = 0) -> Crowd:
    """Return `worlds` worlds of a model of one robot, whose first joint is free, on a height field at the origin.

    It is placed at random within the middle 60 % of the field along each axis, with random heading and joint angles.
    """
    model, rng = workload.model, np.random.default_rng(seed)
    data = mujoco.MjData(model)
    kept: dict[str, list[npt.NDArray[np.float32]]] = {name: [] for name in _FIELDS}
    for _ in range(worlds):
        data.qpos[:] = _posture(model, rng)
        mujoco.mj_kinematics(model, data)
        for name, values in kept.items():
            values.append(getattr(data, name).astype(np.float32))
    axes = {name: (3, 3) if name.endswith("mat") else (3,) for name in _FIELDS}
    poses = {name: np.stack(values).reshape(worlds, -1, *axes[name]) for name, values in kept.items()}
    lidar = Lidar(
        name="lidar",
        mount=mount,
        elevation_deg=np.linspace(10, -65, ROWS).tolist(),
        columns=COLUMNS,
        filter=Filter(geom_groups=workload.groups),
    )
    return Crowd(workload, lidar, poses)


def _posture(model: mujoco.MjModel, rng: np.random.Generator) -> Floats:
    """Return a random qpos (nq,)."""
    field = int(np.argmax(model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD))
    size = model.hfield_size[model.geom_dataid[field]]
    qpos = model.qpos0 + rng.normal(scale=0.25, size=model.nq)
    for joint in range(1, model.njnt):
        if model.jnt_limited[joint]:
            at = model.jnt_qposadr[joint]
            qpos[at] = np.clip(qpos[at], *model.jnt_range[joint])
    x, y = rng.uniform(-0.6, 0.6, 2) * size[:2]
    turn = rng.uniform(-np.pi, np.pi) / 2
    qpos[:7] = x, y, model.qpos0[2] + _ground(model, field, x, y), np.cos(turn), 0, 0, np.sin(turn)
    return qpos


def _ground(model: mujoco.MjModel, geom: int, x: float, y: float) -> float:
    """Return the height [m] of the field at the sample next to a place."""
    field = model.geom_dataid[geom]
    rows, columns, begin = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
    across, along, high, _ = model.hfield_size[field]
    column = round((x + across) / (2 * across) * (columns - 1))
    row = round((y + along) / (2 * along) * (rows - 1))
    return float(model.geom_pos[geom, 2] + high * model.hfield_data[begin + row * columns + column])
