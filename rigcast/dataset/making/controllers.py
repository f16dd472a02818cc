"""What takes an episode from one step to the next: physics under some controller, or a recorded motion."""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from rigcast.dataset.description.config import DatasetConfig
from rigcast.dataset.description.file import RandomActions, RecordedMotion, UserController
from rigcast.dataset.description.motion import read_motion
from rigcast.sensors.errors import InputError
from rigcast.sensors.rig.timing.schedule import uniform
from rigcast.simulation import divergence

from .randomise import of_free_bodies, place_bodies

Step = Callable[[], None]


def stepper(
    config: DatasetConfig, model: mujoco.MjModel, data: mujoco.MjData, seed: int, poses: Mapping[str, list[float]]
) -> Step:
    """What takes `data` one timestep further. poses: by how much bodies were moved, as `draw_poses` has it.

    Raises InputError, here or when it is called, where a motion is of another model or the simulation diverges.
    """
    controller = config.file.episodes.controller
    if isinstance(controller, RecordedMotion):
        return _playback(config, controller, model, data, of_free_bodies(model, poses))
    if isinstance(controller, RandomActions):
        return _physics(model, data, _random_actions(controller, model, seed))
    if isinstance(controller, UserController):
        return _physics(model, data, _users(config, controller.function, model, seed))
    return _physics(model, data, lambda _data: None)


def _physics(model: mujoco.MjModel, data: mujoco.MjData, control: Callable[[mujoco.MjData], object]) -> Step:
    def step() -> None:
        control(data)
        time = data.time
        mujoco.mj_step(model, data)
        reason = divergence(model, data, time)
        if reason is not None:
            raise InputError(reason)

    return step


def _users(config: DatasetConfig, name: str, model: mujoco.MjModel, seed: int) -> Callable[[mujoco.MjData], None]:
    function = config.function(name)
    control = function(model, seed)
    if not callable(control):
        raise function.wrong(f"got {type(control).__name__}, expected a function of the MjData")
    returned = function.returned(control)

    def controlled(data: mujoco.MjData) -> None:
        value = returned(data)
        if value is not None:
            raise returned.wrong(f"got {type(value).__name__} from the function of the MjData, which writes data.ctrl")

    return controlled


def _random_actions(actions: RandomActions, model: mujoco.MjModel, seed: int) -> Callable[[mujoco.MjData], None]:
    limited = model.actuator_ctrllimited.astype(bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], 1.0)
    begun = -1

    def control(data: mujoco.MjData) -> None:
        nonlocal begun
        number = int(data.time / actions.hold + 1e-9)
        if number != begun:
            begun = number
            shares = [uniform((seed, "action"), number, k) for k in range(model.nu)]
            data.ctrl[:] = low + (high - low) * np.array(shares)

    return control


def _playback(
    config: DatasetConfig,
    motion: RecordedMotion,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    moved: Mapping[str, list[float]],
) -> Step:
    """moved: by how much free bodies are away from where the recording has them."""
    rows = read_motion(config.folder / motion.file)
    if rows.shape[1] != model.nq:
        raise InputError(f"{motion.file}: got rows of {rows.shape[1]} numbers, expected nq = {model.nq} of the model")
    began = data.time
    data.qpos[:] = rows[0]
    place_bodies(model, data, moved)

    def step() -> None:
        data.time += model.opt.timestep
        at = (data.time - began) * motion.rate_hz
        row = min(int(at), len(rows) - 2)
        # on the manifold of qpos, where quaternions turn evenly
        velocity = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, velocity, 1.0, rows[row], rows[row + 1])
        data.qpos[:] = rows[row]
        mujoco.mj_integratePos(model, data.qpos, velocity, at - row)
        place_bodies(model, data, moved)

    return step
