"""A rig: sensors mounted on a MuJoCo model, read together."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np
import warp as wp

from rigcast.kernels.cast import HitArrays
from rigcast.kernels.effects.infrared import infrared
from rigcast.kernels.effects.random import RandomSource, random_source
from rigcast.kernels.reading import intensity, read
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.scene.batch.sources import BATCHES, Batch
from rigcast.sensors.scene.batch.worlds import as_worlds, is_batch
from rigcast.sensors.scene.hits import Hits
from rigcast.sensors.scene.props import as_props
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.depth_camera import DepthCamera
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidar import Lidar
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.surface import Surface

from .frame import CameraFrame, Frame, LidarFrame
from .mounted import Aim, Mounted, Sensor, WorldRays
from .room import require_room
from .schedule import Schedule
from .under_way import UnderWay

_STATE = ("qpos", "mocap_pos", "mocap_quat")
_KINEMATICS = (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_flex, mujoco.mj_camlight)
"""What poses are worked out by: those of bodies by the first alone, of flexes and cameras by all."""


class Rig:
    """Sensors on one model.

    Args:
        model: the model that carries the sensors.
        sensors: `Lidar`, `DepthCamera` and `HeightScan`, with different names.
        device: a Warp device; None takes CUDA if it is present, else "cpu".
        seed: of all random numbers of the rig, 0 to 2^63 - 1.
        props: meshes that are not in the model, as for `Scene`.
        surfaces: how some of the model and props reflects, as for `Scene`.
        on_unsupported: "error" or "warn", as for `Scene`.

    Raises:
        InputError: two sensors of one name, mounts or filters that name what the model does not have (all of
            them at once), or geometry that rays cannot hit.

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
        surfaces: Sequence[Surface] = (),
        on_unsupported: Literal["error", "warn"] = "error",
    ) -> None:
        require_type("Rig: model", model, mujoco.MjModel)
        self.sensors = _as_sensors(sensors)
        self.props = as_props(props)
        self.seed = _as_seed(seed)
        repeated = [name for name, n in Counter(s.name for s in self.sensors).items() if n > 1]
        if repeated:
            raise InputError(f"Rig: names must differ, got {', '.join(map(repr, repeated))} more than once")
        faults = [f"sensor {s.name!r}: {fault}" for s in self.sensors for fault in s.faults(model)]
        if faults:
            raise InputError("\n".join(faults))
        self.model = model
        self.scene = Scene(model, device, self.props, surfaces=surfaces, on_unsupported=on_unsupported)
        self._data = mujoco.MjData(model)
        self._state = [getattr(self._data, name) for name in _STATE]
        self._kinematics = _KINEMATICS if model.ncam or model.nflex else _KINEMATICS[:1]
        self._mounted = {s.name: Mounted.on(self.scene, s) for s in self.sensors}
        self._schedules = {s.name: _schedule(s, model.opt.timestep, self.seed) for s in self.sensors}
        rounding = {name: schedule.rounding for name, schedule in self._schedules.items()}
        self._under_way = UnderWay(self.scene, [m for m in self._mounted.values() if m.spec.moves], rounding)
        self._undelivered: list[_Delivery] = []
        self._clock = math.nan

    def sense(self, data: mujoco.MjData | Batch, names: Sequence[str] | None = None) -> dict[str, Frame]:
        """One frame of each of these sensors (None: of all).

        Of an MjData: of the world at `data.time`. Kinematics are worked out on a private copy; `data` is only read.
        The world stands still for it, with `motion` and rolling shutters too: only `step` knows how it moves.

        Of a batch of worlds, which is whatever `Worlds` takes, or a `Worlds`: frames of all of them, with a first axis
        for the world. Poses are taken as they stand, as `mj_ray` does: after a step they lag `qpos` by that step.

        Raises:
            InputError: no sensor of this name, data of another model, or more than memory holds.
        """
        mounted = self._select(names)
        if is_batch(data):
            worlds = as_worlds(data)
            worlds.require_sensors(self._mounted)
            needs = {m.spec.name: m.bytes_per_world(worlds) for m in mounted}
            needs = {"scene": self.scene.bytes_per_world(worlds), **needs}
            require_room(worlds.count, needs, self.scene.device)
            standing = self.scene.update_worlds(worlds)
            return {m.spec.name: self._read(*m.in_worlds(standing)) for m in mounted}
        if not isinstance(data, mujoco.MjData):
            raise InputError(f"Rig: data: got {type(data).__name__}, expected MjData, or many worlds: {BATCHES}")
        self._look(data)
        return {m.spec.name: self._frame(m, data.time) for m in mounted}

    def step(self, data: mujoco.MjData) -> Iterator[Frame]:
        """The frames that came in since the last call, in the order in which they did; call it after each `mj_step`.

        A sensor with `rate_hz` falls due at phase + k / rate_hz for every k on the clock `data.time`, one without it
        at every call; the frame comes in `latency` later. Each is given out once, however many come in in one step,
        and is whole whatever the timestep. It shows the world at the step that reached `frame.time`, less than a
        timestep after it. One of a sensor with `motion` or a rolling shutter shows the world as it moves between the
        steps that it spans, and comes in once its last ray is fired. When the clock goes backwards the schedule starts
        over, and frames that are under way or have not come in are discarded.
        """
        self._require_own(data)
        if not data.time >= self._clock:
            self._undelivered.clear()
            self._under_way.start_over()
        self._clock = data.time
        due = [(time, m) for m in self._mounted.values() for time in self._schedules[m.spec.name].due(data.time)]
        still = [(time, m) for time, m in due if not m.spec.moves]
        if still:
            self._look(data)
        for time, m in still:
            self._deliver(m, time, self._frame(m, time))
        if self._under_way.moving:
            self._move_on(data, [(time, m) for time, m in due if m.spec.moves])
        arrived = [each for each in self._undelivered if each.time <= data.time + each.rounding]
        self._undelivered = [each for each in self._undelivered if each not in arrived]
        return iter([each.frame for each in sorted(arrived, key=lambda each: each.time)])

    def _move_on(self, data: mujoco.MjData, due: list[tuple[float, Mounted]]) -> None:
        """Begin readings of sensors that move; take those whose last ray has been fired."""
        self._work_out_poses(data)
        over = self._under_way.step(self._data, [(time, m.at(time)) for time, m in due])
        for begun in over:
            self._deliver(begun.mounted, begun.end, self._read(begun.mounted, self._under_way.aim(begun)))
        if over:
            self.scene.update(self._data)  # which was swept

    def _deliver(self, mounted: Mounted, taken: float, frame: Frame) -> None:
        """Keep a frame, the last ray of which was fired at `taken` [s], for when it comes in."""
        rounding = self._schedules[mounted.spec.name].rounding
        self._undelivered.append(_Delivery(max(frame.time + mounted.spec.latency, taken), rounding, frame))

    def rays(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, WorldRays]:
        """The rays that each of these sensors would cast now."""
        mounted = self._select(names)
        self._look(data)
        return {m.spec.name: m.at(data.time).world_rays(self._data) for m in mounted}

    def cast(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, Hits]:
        """What the rays of each of these sensors hit now, before any range limit: distances and world normals."""
        mounted = self._select(names)
        self._look(data)
        return {
            m.spec.name: self.scene.hits(
                self.scene.cast_rays(m.at(data.time).rays(self._data), m.visible(), np.inf), m.pattern.shape
            )
            for m in mounted
        }

    def _select(self, names: Sequence[str] | None) -> list[Mounted]:
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
        """Bring the scene to the world at data.time."""
        self._require_own(data)
        self._work_out_poses(data)
        self.scene.update(self._data)

    def _work_out_poses(self, data: mujoco.MjData) -> None:
        """Those at data.time, into the private copy: mj_step has not done so yet."""
        self._data.time = data.time
        for own, name in zip(self._state, _STATE, strict=True):
            own[:] = getattr(data, name)
        for work_out in self._kinematics:
            work_out(self.model, self._data)

    def _require_own(self, data: mujoco.MjData) -> None:
        require_type("Rig: data", data, mujoco.MjData)
        if data.signature != self.model.signature:
            raise InputError("Rig: data belongs to another model than the rig")

    def _frame(self, mounted: Mounted, time: float) -> Frame:
        """What a sensor reads in the world as it stands."""
        fired = mounted.at(time)
        return self._read(fired, Aim(time, fired.pose(self._data), fired.rays(self._data)))

    def _read(self, mounted: Mounted, aim: Aim) -> Frame:
        spec, rays = mounted.spec, aim.rays
        if isinstance(spec, Lidar):
            return self._read_lidar(mounted, spec, aim)
        if isinstance(spec, DepthCamera):
            return self._read_camera(mounted, spec, aim)
        hits = self.scene.cast_rays(rays, mounted.visible(), spec.max_range)
        read(hits, rays, spec.min_range)
        return Frame(**self._common(mounted, aim, hits))

    def _read_lidar(self, mounted: Mounted, spec: Lidar, aim: Aim) -> LidarFrame:
        rays, visible = aim.rays, mounted.visible()
        if mounted.physics is None:
            hits = self.scene.cast_rays(rays, visible, spec.max_range)
            read(hits, rays, spec.min_range)
            bright = partial(intensity, hits, rays, self.scene.looks().surfaces)
        else:
            reading = mounted.physics.read(rays, visible, self._random(mounted, aim))
            hits, bright = reading.hits, partial(wp.array.flatten, reading.intensity)
        common = self._common(mounted, aim, hits)
        return LidarFrame(**common, ring=mounted.ring, column=mounted.column, _intensity=bright)

    def _read_camera(self, mounted: Mounted, spec: DepthCamera, aim: Aim) -> CameraFrame:
        pattern, rays, visible = mounted.pattern, aim.rays, mounted.visible()
        if mounted.depth_physics is None:
            hits = seen = self.scene.cast_rays(rays, visible, spec.max_range)
            read(hits, rays, spec.min_range)
        else:
            reading = mounted.depth_physics.read(rays, visible, self._random(mounted, aim))
            hits, seen = reading.hits, reading.seen
        assert pattern.intrinsics is not None
        return CameraFrame(
            **self._common(mounted, aim, hits),
            intrinsics=pattern.intrinsics,
            lens=pattern.lens,
            depth_scale=spec.depth_scale,
            _intensity=partial(infrared, seen, rays.directions, self.scene.looks().reflectivity),
        )

    def _random(self, mounted: Mounted, aim: Aim) -> RandomSource:
        """The random numbers of the next reading of a sensor."""
        rays = math.prod(mounted.pattern.shape)
        return random_source(self.seed, mounted.spec.name, next(mounted.frames), aim.worlds, rays)

    def _common(self, mounted: Mounted, aim: Aim, hits: HitArrays) -> dict[str, Any]:
        """What every frame is made with."""
        return {
            "sensor": mounted.spec.name,
            "time": aim.time,
            "pose": aim.pose,
            "shape": mounted.frame_shape if aim.worlds is None else (aim.worlds.size, *mounted.frame_shape),
            "_hits": hits,
            "_rays": aim.rays,
            "_ids_of_shape": self.scene.ids_in_use,
            "_body_of_shape": self.scene.body_of_shape,
            "_firing_times": mounted.firing_times,
            "_pattern": mounted.pattern,
        }


class _Delivery(NamedTuple):
    """A frame that comes in at `time` [s], or when the clock is `rounding` short of it."""

    time: float
    rounding: float
    frame: Frame


def _schedule(spec: Sensor, timestep: float, seed: int) -> Schedule:
    return Schedule(
        spec.rate_hz,
        timestep,
        phase=spec.phase,
        jitter=spec.jitter,
        frame_loss=spec.frame_loss,
        key=(seed, spec.name),
    )


def _as_sensors(sensors: object) -> tuple[Sensor, ...]:
    if isinstance(sensors, SensorSpec) or not isinstance(sensors, Iterable):
        raise InputError(f"Rig: sensors: got {type(sensors).__name__}, expected a list of sensors")
    listed = tuple(sensors)
    for k, sensor in enumerate(listed):
        require_type(f"Rig: sensors[{k}]", sensor, Lidar, DepthCamera, HeightScan)
    return listed


def _as_seed(seed: object) -> int:
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"Rig: seed: got {seed!r}, expected a whole number from 0 to 2^63 - 1")
    return int(seed)
