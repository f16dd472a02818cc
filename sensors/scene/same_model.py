"""Checks that data belong to a model, or to a copy of it that rays cannot tell apart."""

import mujoco
import numpy as np

from rigcast.sensors.errors import InputError

SHAPES = (
    *("geom_type", "geom_dataid", "geom_size", "geom_group", "geom_contype", "geom_conaffinity", "geom_matid"),
    *("geom_rgba", "mat_rgba", "mat_reflectance", "hfield_size", "hfield_data"),
)
"""Fields of a model, not in MjData, on which hits depend. Vertices are left out, as there are too many to check."""

PLACES = (
    *("qpos0", "jnt_pos", "jnt_axis", "body_pos", "body_quat", "geom_pos", "geom_quat"),
    *("site_pos", "site_quat", "cam_pos", "cam_quat"),
)
"""Fields of a model on which poses depend, besides MjData."""


def require_same_model(what: str, other: mujoco.MjModel, model: mujoco.MjModel, fields: tuple[str, ...]) -> None:
    """Raise InputError if `other`, a copy of the model to which `what` belongs, differs in one of these fields."""
    if other is model:
        return
    for name in fields:
        if not np.array_equal(getattr(other, name), getattr(model, name)):
            raise InputError(
                f"{what} is of a copy of the model that has another {name}; expected the model of the rig or scene to "
                "have it too, as rays are cast on that one"
            )


def require_posed(what: str, data: mujoco.MjData) -> None:
    """Raise InputError for data whose poses have not been computed since they were made or reset."""
    rotation = data.geom_xmat
    if len(rotation) and not (rotation[0].any() or rotation.any()):
        raise InputError(f"{what}: poses have not been computed, expected mj_forward or mj_kinematics first")
