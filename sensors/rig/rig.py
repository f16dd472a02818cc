"""A rig: sensors mounted on a MuJoCo model, read together."""

import math
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Literal, NamedTuple, NoReturn

import mujoco
import numpy as np
import warp as wp

from rigcast.sensors.errors import InputError, require_type, warn_user
from rigcast.sensors.fixed import fixed
from rigcast.sensors.names import expected_one_of, require_different
from rigcast.sensors.scene.batch.sources import BATCHES, Batch
from rigcast.sensors.scene.batch.worlds import Worlds, as_worlds, is_batch
from rigcast.sensors.scene.hits import Hits
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.enclosed import enclosed
from rigcast.sensors.specs.height_scan import HeightScan
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.prop import Prop, as_props
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.surface import Surface

from .capacity import require_out
from .frame import Frame
from .kinematics import Kinematics
from .mounted import Mounted, Sensor, WorldRays
from .of_worlds import sense_worlds
from .reading import read_frames
from .timing.one_state import missed, reads_too_often, times_of_one_state, too_often
from .timing.schedule import Schedule
from .under_way import UnderWay

_CHECKED = 2
"""How many readings of a list of MjData are checked for poses of before: one to begin with, and one within a loop."""


class Rig:
    """Sensors on one model.

    Args:
        model: the model that carries the sensors.
        sensors: any of `Lidar`, `DepthCamera` and `HeightScan`, with different names.
        device: a Warp device; None takes CUDA if it is present, else "cpu".
        seed: of all random numbers of the rig, 0 to 2^63 - 1.
        props: meshes that are not in the model, as for `Scene`.
        surfaces: reflectance of parts of the model and of props, as for `Scene`.
        on_unsupported: "error" or "warn", as for `Scene`.

    A sensor inside or on a geom of its own body, or of a body fixed to that, sees little else: a warning names it.

    Attributes: `model`, `sensors`, `props` and `seed` as given, and `scene`, on which the rig casts. None can be
    assigned: others need a new rig, another seed `reset`.

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
        self._sensors = _as_sensors(sensors)
        self._props = as_props(props)
        seed = _as_seed(seed)
        require_different("Rig", [s.name for s in self._sensors])
        faults = [f"sensor {s.name!r}: {fault}" for s in self._sensors for fault in s.faults(model)]
        if faults:
            raise InputError("\n".join(faults))
        self._model = model
        self._scene = Scene(model, device, self._props, surfaces=surfaces, on_unsupported=on_unsupported)
        self._in_use = self._scene.in_use
        self._mounted = {s.name: Mounted.on(self._scene, s) for s in self._sensors}
        optics = [m for m in self._mounted.values() if isinstance(m.spec, DepthCamera) and m.spec.takes_optics]
        self._kinematics = Kinematics(model, [m.mount.id for m in optics])
        # once, here: where sensors are in their own bodies is the same in every frame
        odd = (enclosed(model, self._kinematics.data, self._sensors), too_often(self._sensors, model.opt.timestep))
        for sentence in chain(*odd):
            warn_user(sentence, UserWarning)
        self._unchecked = _CHECKED
        self._has_missed: set[str] = set()  # sensors of which a warning has said so
        self._begin(seed)

    def _begin(self, seed: int) -> None:
        self._seed = seed
        self._schedules = {s.name: _schedule(s, self._model.opt.timestep, seed) for s in self._sensors}
        rounding = {name: schedule.rounding for name, schedule in self._schedules.items()}
        self._under_way = UnderWay(self._scene, [m for m in self._mounted.values() if m.spec.moves], rounding)
        self._undelivered: list[_Delivery] = []
        self._clock = math.nan
        self._stepped: Callable[[], mujoco.MjData | None] = lambda: None  # of the last step, unless it is gone by now

    @fixed
    def model(self) -> mujoco.MjModel:
        return self._model

    @fixed
    def sensors(self) -> tuple[Sensor, ...]:
        return self._sensors

    @fixed
    def props(self) -> tuple[Prop, ...]:
        return self._props

    @fixed
    def scene(self) -> Scene:
        return self._scene

    @property
    def seed(self) -> int:
        """The seed of all random numbers of the rig; `reset` can change it."""
        return self._seed

    def reset(self, seed: int | None = None) -> None:
        """Start again with this seed (None: the same): what follows is, bit for bit, what a new rig gives.

        Readings are counted from the first again; those under way or not yet returned are discarded. Without a reset,
        a clock that goes backwards restarts the schedule, but random numbers continue.

        Raises:
            InputError: the seed is not from 0 to 2^63 - 1.
        """
        with self._in_use:
            seed = self._seed if seed is None else _as_seed(seed)
            self._mounted = {name: m.afresh() for name, m in self._mounted.items()}
            self._begin(seed)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Rig holds memory of its device: make one of its model and sensors in each process")

    def __repr__(self) -> str:
        sensors = ", ".join(f"{sensor.name}: {sensor.type}" for sensor in self._sensors)
        return f"Rig({sensors}; on {self._scene.device})"

    def sense(
        self,
        data: mujoco.MjData | Batch,
        names: Sequence[str] | None = None,
        out: Mapping[str, Frame] | None = None,
    ) -> dict[str, Frame]:
        """One frame of each of these sensors (None: of all).

        With an MjData the frames show the world at `data.time`. Kinematics are computed on a private copy; `data` is
        only read. The world stands still, also for `motion` and rolling shutters: only `step` knows how it moves.

        With a batch of worlds (a `Worlds`, or anything that `Worlds` takes) frames have a first axis for the world.
        Poses are taken as they are, as `mj_ray` does: after a step they lag `qpos` by that step.

        out: frames of an earlier reading of as many worlds. Their arrays are overwritten and belong to the returned
        frames; with an MjData only the returned frames have the new `time` and `pose`. Fields that have been asked for
        are computed again. After an error their contents are undefined. None reuses arrays of released frames of the
        sensor, or allocates new ones.

        Raises:
            InputError: no sensor of this name, data of another model or of an edited copy of it, an MJCF camera whose
                optics were edited since a sensor took them, no room in `out`, or more than memory holds.
        """
        with self._in_use:
            mounted = self._select(names)
            if isinstance(data, mujoco.MjData):
                if out is not None:
                    require_out(out, {m.spec.name: m.pattern.frame_shape for m in mounted}, self._scene.device)
                self._look(data)
                frames = self._frames([(data.time, m) for m in mounted], out)
                return {m.spec.name: frame for m, frame in zip(mounted, frames, strict=True)}
            if not is_batch(data):
                raise InputError(f"Rig: data: got {type(data).__name__}, expected MjData, or many worlds: {BATCHES}")
            self._kinematics.require_same_optics()
            worlds = as_worlds(data)
            worlds.require_sensors(self._mounted)
            of_worlds = sense_worlds(self._scene, mounted, worlds, out, self.seed)
            if self._unchecked:
                self._check_poses(worlds)
            return of_worlds

    def _check_poses(self, worlds: Worlds) -> None:
        """Warn once where poses of MjData, which are read as they stand, are not of now."""
        data = worlds.first_data
        if data is None:
            return
        self._unchecked -= 1
        if not self._kinematics.are_of(data):
            self._unchecked = 0
            warn_user(
                "Rig.sense: a list of MjData is read with the poses that they have, and those of world 0 are not of "
                "its qpos; mj_step leaves them a step behind: expected mujoco.mj_kinematics, or mj_forward, of each "
                "before",
                RuntimeWarning,
            )

    def step(self, data: mujoco.MjData) -> list[Frame]:
        """The frames that are due since the last call, in order of arrival; call this after each `mj_step`.

        A sensor with `rate_hz` is due at phase + k / rate_hz of `data.time` for every k, one without it at every call;
        its frame is returned `latency` later, once. It is complete whatever the timestep, and shows the world at the
        step that reached `frame.time`, less than a timestep later. With `motion` or a rolling shutter it shows the
        world as it moves between the steps that it spans, and is returned once its last ray is fired. When the clock
        goes backwards the schedule restarts, and frames under way or not yet returned are discarded.

        Calls that skip steps see one state where several readings fell due. Of a sensor that stands still, those due
        within the last timestep are read; if there are none but earlier ones, one is, and its `time` is `data.time`.
        A RuntimeWarning says so, once for each sensor, if that is fewer than fell due.

        Raises:
            InputError: data as `sense` refuses it, or another MjData than before without `reset` between, unless the
                first is gone or the other's clock is behind.
        """
        with self._in_use:
            if is_batch(data):
                got = f"got many worlds ({type(data).__name__})"
                raise InputError(f"Rig.step: data: {got}, expected one MjData; sense reads many worlds when you ask")
            self._kinematics.require_own(data)
            self._require_one_clock(data)
            if not data.time >= self._clock:
                self._undelivered.clear()
                self._under_way.start_over()
            self._clock = data.time
            due = [(time, m) for m in self._mounted.values() for time in self._due(m.spec, data.time)]
            still = [(time, m) for time, m in due if not m.spec.moves]
            if still:
                self._look(data)
                for (time, m), frame in zip(still, self._frames(still), strict=True):
                    self._deliver(m, time, frame)
            if self._under_way.moving:
                self._move_on(data, [(time, m) for time, m in due if m.spec.moves])
            arrived = [each for each in self._undelivered if each.time <= data.time + each.rounding]
            self._undelivered = [each for each in self._undelivered if each not in arrived]
            return [each.frame for each in sorted(arrived, key=lambda each: each.time)]

    def _require_one_clock(self, data: mujoco.MjData) -> None:
        """Raise InputError where two MjData take turns: the clock of one would be taken for that of the other.

        Another one whose clock is behind is a new episode, as the same one is whose clock goes back.
        """
        stepped = self._stepped()
        if stepped is data:
            return
        if stepped is not None and data.time >= self._clock:
            raise InputError(
                f"Rig.step: data: got another MjData than in the call before, which was at {self._clock:g} s, expected "
                "one rig for each MjData, or rig.reset() before another one"
            )
        self._stepped = weakref.ref(data)

    def _due(self, sensor: Sensor, now: float) -> list[float]:
        """The times [s] of the readings that there are now, of what fell due since the last call."""
        due = self._schedules[sensor.name].due(now)
        if not due or sensor.moves:
            return due
        timestep = self._model.opt.timestep
        given = times_of_one_state(sensor, due, now, timestep)
        is_told = sensor.name in self._has_missed or reads_too_often(sensor, timestep)
        if len(given) < len(due) and not is_told:
            self._has_missed.add(sensor.name)
            warn_user(missed(sensor, len(due), len(given)), RuntimeWarning)
        return given

    def _move_on(self, data: mujoco.MjData, due: list[tuple[float, Mounted]]) -> None:
        """Begin readings of moving sensors, and make those whose last ray has been fired."""
        self._kinematics.update(data)
        over = self._under_way.step(self._kinematics.data, [(time, m.at(time)) for time, m in due])
        for begun in over:
            m = begun.mounted
            aim = self._under_way.aim(begun, m.next_arrays(m.pattern.frame_shape))
            self._deliver(m, begun.end, *read_frames([(m, aim)], self.seed))
        if over:
            # the scene was swept, and sensors that stand still need it as it is now
            self._scene.take(self._kinematics.data)

    def _deliver(self, mounted: Mounted, taken: float, frame: Frame) -> None:
        """Keep a frame, whose last ray was fired at `taken` [s], until it arrives."""
        rounding = self._schedules[mounted.spec.name].rounding
        self._undelivered.append(_Delivery(max(frame.time + mounted.spec.latency, taken), rounding, frame))

    def rays(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, WorldRays]:
        """The rays that each of these sensors would cast at `data.time`, in the world: origins [m] and unit directions.

        Both are (*shape, 3) float64, with one ray for all of its returns; angular noise and sub-rays are left out, and
        all rays are fired at once. Pixels that a lens leaves dark have NaN directions. Raises InputError as `sense`
        does.
        """
        with self._in_use:
            mounted = self._select(names)
            self._look(data)
            return {m.spec.name: m.at(data.time).world_rays(self._kinematics.data) for m in mounted}

    def cast(self, data: mujoco.MjData, names: Sequence[str] | None = None) -> dict[str, Hits]:
        """The first hits of the `rays` of each of these sensors, as `Scene.cast` gives them.

        Sensors' filters apply; range limits and measurement effects do not. Raises InputError as `sense` does.
        """
        with self._in_use:
            mounted = self._select(names)
            self._look(data)
            return {
                m.spec.name: self._scene.hits(
                    self._scene.cast_rays(m.at(data.time).rays(self._kinematics.data), m.visible(), np.inf),
                    m.pattern.shape,
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
        """Update the scene to the world at data.time."""
        self._kinematics.require_own(data)
        self._kinematics.update(data)
        self._scene.take(self._kinematics.data)

    def _frames(self, due: Iterable[tuple[float, Mounted]], out: Mapping[str, Frame] | None = None) -> list[Frame]:
        """Frames of sensors in the world as it stands, each with its time."""
        aimed = []
        for time, mounted in due:
            fired = mounted.at(time)
            arrays = fired.next_arrays(fired.pattern.frame_shape, out)
            aimed.append((fired, fired.aim(self._kinematics.data, time, arrays)))
        return read_frames(aimed, self.seed)


class _Delivery(NamedTuple):
    """A frame that arrives at `time` [s]; the clock may be `rounding` [s] short of it."""

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
