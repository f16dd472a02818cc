"""A rig: sensors mounted on a MuJoCo model, read together."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.kernels.cast import Rays
from rigcast.kernels.packets.sorting import sort_into_packets
from rigcast.kernels.reading import read
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.faults import refuse
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.scene.hits import Hits
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan, yaw_only
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.mount import BoundMount
from rigcast.sensors.specs.pattern import Pattern
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec

from .frame import CameraFrame, Frame, LidarFrame
from .schedule import Schedule

Sensor = Lidar | DepthCamera | HeightScan


class WorldRays(NamedTuple):
    """The rays of one reading in the world, (*shape, 3) float64: origins [m] and unit directions."""

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]


class Rig:
    """Sensors on one model.

    Args:
        model: the model that carries the sensors.
        sensors: `Lidar`, `DepthCamera` and `HeightScan`, with different names.
        device: a Warp device; None takes CUDA if it is present, else "cpu".
        seed: of all random numbers of the rig.
        props: meshes that are not in the model, as for `Scene`.
        on_unsupported: "error" or "warn", as for `Scene`.

    Raises:
        InputError: two sensors of one name, a mount or filter that names what the model does not have, or
            geometry that rays cannot hit.

    >>> rig = rigcast.Rig(model, [rigcast.DepthCamera(name="front", mount=rigcast.Mount(camera="head"))])
    >>> for frame in rig.step(data):
    ...     frame.depth.numpy()
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        sensors: Iterable[Sensor],
        device: wp.DeviceLike = None,
        seed: int = 0,
        *,
        props: Sequence[Prop] = (),
        on_unsupported: Literal["error", "warn"] = "error",
    ) -> None:
        require_type("Rig: model", model, mujoco.MjModel)
        self.sensors = _as_sensors(sensors)
        self.props = tuple(props)
        self.seed = seed
        repeated = [name for name, n in Counter(s.name for s in self.sensors).items() if n > 1]
        if repeated:
            raise InputError(f"Rig: names must differ, got {', '.join(map(repr, repeated))} more than once")
        for sensor in self.sensors:
            refuse(f"sensor {sensor.name!r}", sensor.faults(model))
        self.model = model
        self.scene = Scene(model, device, self.props, on_unsupported=on_unsupported)
        self._data = mujoco.MjData(model)
        self._mounted = {s.name: _Mounted.on(self.scene, s) for s in self.sensors}
        self._schedules = {s.name: Schedule(s.rate_hz, model.opt.timestep) for s in self.sensors}

    def sense(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, Frame]:
        """One frame of each of these sensors (None: of all), of the world at `data.time`.

        Kinematics are worked out on a private copy; `data` is only read.
        """
        mounted = self._select(names)
        self._look(data)
        return {m.spec.name: self._frame(m, data.time) for m in mounted}

    def step(self, data: mujoco.MjData) -> Iterator[Frame]:
        """The frames that fell due since the last call, in the order of their times; call it after each `mj_step`.

        A sensor with `rate_hz` falls due at every multiple of 1 / rate_hz on the clock `data.time`, one without it
        at every call. Each frame is given out once, however many fall due in one step. It shows the world at
        `data.time`, less than a timestep after `frame.time`. When the clock goes backwards the schedule starts over.
        """
        self._require_own(data)
        due = [(time, m) for m in self._mounted.values() for time in self._schedules[m.spec.name].due(data.time)]
        if not due:
            return iter(())
        self._look(data)
        return iter([self._frame(m, time) for time, m in sorted(due, key=lambda item: item[0])])

    def rays(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, WorldRays]:
        """The rays that each of these sensors would cast now."""
        mounted = self._select(names)
        self._look(data)
        return {m.spec.name: m.world_rays(self._data) for m in mounted}

    def cast(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, Hits]:
        """What the rays of each of these sensors hit now, before any range limit: distances and world normals."""
        mounted = self._select(names)
        self._look(data)
        return {
            m.spec.name: self.scene.hits(self.scene.cast_rays(m.rays(self._data), m.visible(), np.inf), m.pattern.shape)
            for m in mounted
        }

    def _select(self, names: Sequence[str] | None) -> list["_Mounted"]:
        if names is None:
            return list(self._mounted.values())
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise InputError(f"Rig: names: got {names!r}, expected a list of names, such as [{str(names)!r}]")
        for name in names:
            require_type("Rig: name of a sensor", name, str)
            if name not in self._mounted:
                raise InputError(f"Rig: no sensor {name!r}, {expected_one_of(name, list(self._mounted))}")
        return [self._mounted[name] for name in names]

    def _look(self, data: mujoco.MjData) -> None:
        """Bring the scene to the world at data.time, whose poses mj_step has not worked out yet."""
        self._require_own(data)
        self._data.time = data.time
        self._data.qpos[:] = data.qpos
        self._data.mocap_pos[:] = data.mocap_pos
        self._data.mocap_quat[:] = data.mocap_quat
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        mujoco.mj_flex(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)
        self.scene.update(self._data)

    def _require_own(self, data: mujoco.MjData) -> None:
        require_type("Rig: data", data, mujoco.MjData)
        if data.signature != self.model.signature:
            raise InputError("Rig: data belongs to another model than the rig")

    def _frame(self, mounted: "_Mounted", time: float) -> Frame:
        spec, pattern = mounted.spec, mounted.pattern
        rays = mounted.rays(self._data)
        hits = self.scene.cast_rays(rays, mounted.visible(), spec.max_range)
        read(hits, rays, spec.min_range)
        tables = (self.scene.ids_in_use, self.scene.body_of_shape)
        common = (spec.name, time, mounted.pose(self._data), pattern.shape, hits, rays, *tables, pattern)
        if mounted.ring is not None and mounted.column is not None:
            return LidarFrame(*common, mounted.ring, mounted.column)
        if pattern.intrinsics is not None:
            return CameraFrame(*common, pattern.intrinsics)
        return Frame(*common)


def _as_sensors(sensors: object) -> tuple[Sensor, ...]:
    if isinstance(sensors, SensorSpec) or not isinstance(sensors, Iterable):
        raise InputError(f"Rig: sensors: got {type(sensors).__name__}, expected a list of sensors")
    listed = tuple(sensors)
    for k, sensor in enumerate(listed):
        require_type(f"Rig: sensors[{k}]", sensor, Lidar, DepthCamera, HeightScan)
    return listed


@dataclass(frozen=True, eq=False)
class _Mounted:
    """A sensor on a scene: its rays, on the device."""

    scene: Scene
    spec: Sensor
    mount: BoundMount
    pattern: Pattern
    fixed_rays: Rays
    ring: wp.array | None
    column: wp.array | None

    @staticmethod
    def on(scene: Scene, spec: Sensor) -> "_Mounted":
        pattern = spec.pattern(scene.model)
        origins = np.zeros((1, 3)) if pattern.origins is None else pattern.origins

        has_packets = pattern.origins is None and scene.device.is_cpu
        packets = sort_into_packets(pattern.directions.reshape(-1, 3)) if has_packets else None

        def upload(index: NDArray[np.int32] | None) -> wp.array | None:
            return None if index is None else wp.array(index, dtype=int, device=scene.device)

        return _Mounted(
            scene,
            spec,
            spec.mount.bind(scene.model),
            pattern,
            replace(scene.rays_in_frame(pattern.directions, origins, np.eye(4)), packets=packets),
            upload(pattern.ring),
            upload(pattern.column),
        )

    def pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """(4, 4) the sensor's frame in the world."""
        with np.errstate(invalid="ignore"):  # a pose with inf in it becomes NaN
            pose = self.mount.pose(data)
        if self.spec.yaw_aligned:
            pose = yaw_only(pose)
        pose[:3, :3] = pose[:3, :3] @ self.spec.frame_rotation
        return pose

    def visible(self) -> wp.array:
        return self.scene.visible(self.spec.filter)

    def rays(self, data: mujoco.MjData) -> Rays:
        return self.scene.in_pose(self.fixed_rays, self.pose(data))

    def world_rays(self, data: mujoco.MjData) -> WorldRays:
        pose = self.pose(data)
        directions = self.pattern.directions @ pose[:3, :3].T
        local = np.zeros(3) if self.pattern.origins is None else self.pattern.origins
        return WorldRays(np.broadcast_to(local @ pose[:3, :3].T + pose[:3, 3], directions.shape), directions)
