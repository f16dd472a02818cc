"""A MuJoCo model as something to cast rays against."""

from collections.abc import Sequence
from numbers import Real
from types import NoneType
from typing import Literal, NoReturn

import mujoco
import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from rigcast.kernels.shapes.triangle import CULL_BACK, CULL_FRONT, CULL_NONE
from rigcast.sensors.device import find_device
from rigcast.sensors.errors import InputError, require_type
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop
from rigcast.sensors.specs.surface import Surface
from rigcast.sensors.threads import require_thread_count

from .batch.per_world import PerWorld
from .batch.sources import Batch
from .batch.worlds import as_worlds, is_batch
from .hits import Hits
from .parts.model_geometry import refuse_unsupported
from .rays.given import take_rays
from .rays.placed import in_world, in_worlds, world_frame
from .same_model import SHAPES, require_posed, require_same_model
from .stage import Stage

Cull = Literal["none", "back", "front"]

_CULL: dict[str, int] = {"none": CULL_NONE, "back": CULL_BACK, "front": CULL_FRONT}
_NO_FILTER = Filter()


class Scene(Stage):
    """The geometry of a MuJoCo model, ready for casting rays.

    Args:
        model: the model. Its meshes are read now, everything else at every `update`.
        device: a Warp device; None takes CUDA if it is present, else "cpu".
        props: meshes that are not in the model, with different names.
        surfaces: reflectance instead of the model's colours, for sensors that measure intensity.
        on_unsupported: what to do about geometry that rays cannot hit (SDF geoms without a mesh): "error"
            raises InputError, "warn" warns and leaves it out.

    Raises:
        InputError: a device that does not exist, a prop or mesh that cannot be read, a mount or surface that names what
            the model does not have, a size that is not finite, or geometry that rays cannot hit.

    >>> scene = rigcast.Scene(model)
    >>> scene.update(data)
    >>> scene.cast((0, 0, 1), (1, 0, 0)).numpy().distance
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        device: wp.DeviceLike = None,
        props: Sequence[Prop] = (),
        *,
        surfaces: Sequence[Surface] = (),
        on_unsupported: Literal["error", "warn"] = "error",
    ) -> None:
        require_type("Scene: model", model, mujoco.MjModel)
        refuse_unsupported(model, on_unsupported)
        require_thread_count()
        super().__init__(model, find_device(device), props, surfaces)
        self._frame = world_frame(self.device)

    def __repr__(self) -> str:
        model = self.model
        counts = {"geoms": model.ngeom, "flexes": model.nflex, "skins": model.nskin, "props": len(self._props.mounts)}
        counts["worlds"] = self._worlds or 0
        of_each = ", ".join(f"{name}: {count}" for name, count in counts.items() if count)
        return f"Scene({of_each or 'empty'}; on {self.device})"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Scene holds memory of its device: make one of its model in each process")

    def update(self, data: mujoco.MjData | Batch) -> None:
        """Take the poses as they are in `data` (`geom_xpos`, `geom_xmat`), as `mj_ray` does.

        `data` may be a batch of worlds, a `Worlds` or anything that `Worlds` takes; these are then cast against
        together. Their `filters`, `mounts` and `active` are for the sensors of a rig and change nothing here.

        After `mj_step` poses lag `qpos` by one step. To see the world at `data.time`, run `mj_kinematics` first, and
        for flexes (`flexvert_xpos`) also `mj_comPos` and `mj_flex`.
        A geom whose pose is not finite is never hit, and is named in one warning.

        Edits of the model: sizes of geoms and height fields are read at every update, colours and groups at every
        update and `cast`, meshes after `refresh`. Edited poses of geoms in their bodies also need `mj_kinematics`.

        Raises:
            InputError: `data` belongs to another model, or to a copy with other shapes or colours, or has no poses yet,
                as it is made or reset; a size or an elevation is not finite; or a geom has another type, mesh or height
                field. If the model is at fault, casting is refused until an update succeeds.
        """
        with self._in_use:
            if is_batch(data):
                worlds = as_worlds(data)
                self.take_worlds(worlds)
                self.pose_worlds(worlds, worlds.all)
                return
            require_type("Scene.update: data", data, mujoco.MjData)
            if data.signature != self.model.signature:
                raise InputError(
                    f"Scene.update: data belongs to another model: got signature {data.signature:#x} with "
                    f"{len(data.geom_xpos)} geoms, expected {self.model.signature:#x} with {self.model.ngeom}"
                )
            require_same_model("Scene.update: data", data.model, self.model, SHAPES)
            require_posed("Scene.update: data", data)
            self.take(data)

    def refresh(self, name: str) -> None:
        """Say that a mesh (`mesh_vert`, `mesh_face`) or height field of this name has been edited in the model.

        The next `update` reads it again; casting is refused until then. Height fields need no `refresh`, because every
        update looks for changes in them.

        Raises:
            InputError: the model has neither a mesh nor a height field of this name.
        """
        with self._in_use:
            self._geoms.refresh(name)
            self._stale = f"{name!r} has been edited"

    def cast(
        self,
        origins: ArrayLike | wp.array,
        directions: ArrayLike | wp.array,
        max_distance: float = np.inf,
        cull: Cull = "none",
        filter: Filter | Sequence[Filter] | None = None,
        out: Hits | None = None,
    ) -> Hits:
        """The first hit of each ray.

        Args:
            origins: (..., 3) [m], in the world; (3,) is one for all rays.
            directions: (..., 3), of any length but 0, in the world. Origins and directions are broadcast as in numpy;
                after an update with many worlds, to (nworld, ..., 3).
            max_distance: greatest distance at which something is hit, inclusive [m].
            cull: "back" drops hits on surfaces that face along the ray (d . n > 0), "front" those that face it.
            filter: which geoms may be hit; None: all that are not transparent. With many worlds it may be a list, one
                per world.
            out: hits of an earlier cast of as many rays on this scene's device, which are overwritten. None allocates
                new arrays.

        Arrays on the host keep float64 and are checked (on the CPU by the cast itself, after it has written to `out`).
        Warp arrays (vec3 or vec3d, on the scene's device) are not checked: a ray that is not finite, has no direction
        or begins beyond 1e18 m gives NaN.

        Raises:
            InputError: no `update` before, a shape, device or dtype that does not fit, or a ray that is not finite, has
                no direction or begins beyond 1e18 m, with its index.
        """
        with self._in_use:
            require_type("Scene.cast: out", out, Hits, NoneType)
            if self._stale:
                raise InputError(f"Scene.cast: {self._stale}, expected scene.update(data) first")
            if not isinstance(cull, str) or cull not in _CULL:
                raise InputError(f"Scene.cast: no cull {cull!r}, {expected_one_of(str(cull), list(_CULL))}")
            wanted = self._wanted(filter)
            self._sight.update()
            require_type("Scene.cast: max_distance", max_distance, Real)
            if not max_distance >= 0:
                raise InputError(f"Scene.cast: max_distance must be at least 0 m, got {max_distance}")
            given = take_rays(origins, directions, self.device)
            room = None if out is None else out.room_for(given.shape, self.device)
            rays = in_world(given, self._frame) if self._worlds is None else in_worlds(given, self._worlds)
            hits = self.cast_rays(rays, self.visible(wanted), max_distance, _CULL[cull], room)
            given.refuse_lost(hits.distance)
            return self.hits(hits, given.shape)

    def _wanted(self, filter: Filter | Sequence[Filter] | None) -> Filter | PerWorld[Filter]:
        if isinstance(filter, list | tuple) and self._worlds is not None:
            return PerWorld.of("Scene.cast: filter", filter, Filter, self._worlds)
        require_type("Scene.cast: filter", filter, Filter, NoneType)
        return filter if isinstance(filter, Filter) else _NO_FILTER
