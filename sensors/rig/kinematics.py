"""The poses of a model at `data.time`, computed on a private copy, because `mj_step` leaves them a step behind."""

from collections.abc import Iterable

import mujoco
import numpy as np

from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.scene.same_model import PLACES, SHAPES, require_same_model

_STATE = sum(getattr(mujoco.mjtState, f"mjSTATE_{part}").value for part in ("TIME", "QPOS", "MOCAP_POS", "MOCAP_QUAT"))
"""State components from which poses are computed."""
_SLEEP = mujoco.mjtEnableBit.mjENBL_SLEEP.value
_SAME = 1e-9  # absolute [m] and relative, for poses computed from the same state
_STAGES = (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_flex, mujoco.mj_camlight)
"""MuJoCo stages that compute poses; bodies need only the first, flexes and cameras all of them."""


class Kinematics:
    """The poses of a model; at construction those of its initial state.

    data: the private copy. cameras: ids of MJCF cameras whose optics sensors use.
    """

    def __init__(self, model: mujoco.MjModel, cameras: Iterable[int]) -> None:
        self.data = mujoco.MjData(model)
        self._model = model
        self._stages = _STAGES if model.ncam or model.nflex else _STAGES[:1]
        self._optics = {camera: _optics(model, camera) for camera in cameras}
        self._compute()

    def update(self, data: mujoco.MjData) -> None:
        """Take the poses at `data.time`; `data` is only read."""
        if self._model.opt.enableflags & _SLEEP:
            # else bodies that sleep or cannot move would keep poses from before an edit of the model
            mujoco.mj_resetData(self._model, self.data)
        mujoco.mj_copyState(self._model, data, self.data, _STATE)
        self._compute()

    def are_of(self, data: mujoco.MjData) -> bool:
        """Whether the poses of geoms in `data` are those at `data.time`, which are taken."""
        self.update(data)
        pairs = (data.geom_xpos, self.data.geom_xpos), (data.geom_xmat, self.data.geom_xmat)
        return all(np.allclose(got, own, rtol=_SAME, atol=_SAME, equal_nan=True) for got, own in pairs)

    def require_own(self, data: mujoco.MjData) -> None:
        """Raise InputError for data of another model or of an edited copy of it, and for edited camera optics."""
        require_type("Rig: data", data, mujoco.MjData)
        if data.signature != self._model.signature:
            raise InputError(
                "Rig: data belongs to another model than the rig; one that was compiled anew needs a new Rig"
            )
        require_same_model("Rig: data", data.model, self._model, SHAPES + PLACES)
        self.require_same_optics()

    def require_same_optics(self) -> None:
        """Raise InputError if an MJCF camera's optics were edited after sensors took them."""
        for camera, optics in self._optics.items():
            if _optics(self._model, camera) != optics:
                name = self._model.camera(camera).name
                raise InputError(f"Rig: the optics of camera {name!r} of the model have changed; make a new Rig")

    def _compute(self) -> None:
        for stage in self._stages:
            stage(self._model, self.data)


def _optics(model: mujoco.MjModel, camera: int) -> tuple[bytes, ...]:
    """The parameters of an MJCF camera that determine its intrinsics."""
    return tuple(getattr(model, name)[camera].tobytes() for name in ("cam_fovy", "cam_sensorsize", "cam_intrinsic"))
