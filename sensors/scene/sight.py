"""Visibility and optical properties of a scene's shapes, by the current colours, materials and groups of its model."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

from rigcast.sensors.captured import require_as_before
from rigcast.sensors.specs.filter import Filter

from .batch.per_world import PerWorld
from .looks import Looks, LooksTable
from .parts.part import Part

# Fields of a model that filters and surfaces depend on, besides the tree of its bodies.
_LOOKS = (
    *("geom_rgba", "geom_matid", "geom_group", "geom_contype", "geom_conaffinity", "mat_rgba"),
    *("flex_rgba", "flex_matid", "flex_group", "flex_contype", "flex_conaffinity"),
    *("skin_rgba", "skin_matid", "skin_group"),
    *("mat_reflectance", "mat_texid"),
)
_MOST_FILTERS = 64  # filters whose visible shapes are cached on the device


class Sight:
    """Visibility and optical properties of the shapes of these parts, by the model's state at the last `update`.

    They are cached on the device until something changes.
    """

    def __init__(self, model: mujoco.MjModel, parts: Sequence[Part], table: LooksTable, device: wp.Device) -> None:
        self._parts, self._table, self._device = parts, table, device
        # memory of the model, which shows whatever anybody writes there
        self._now = [values.data for name in _LOOKS if (values := getattr(model, name)).size]
        self._read: bytes | None = None
        self._visible: dict[Filter | PerWorld[Filter], wp.array] = {}
        self._recent: dict[int, tuple[object, wp.array]] = {}
        self._looks: Looks | None = None

    def update(self) -> None:
        """Take over the model's present colours, materials and groups."""
        now = b"".join(self._now)
        if now != self._read:
            require_as_before("Scene: colours, groups or materials of the model are others", self._device)
            self.forget_visible()
            self._read, self._looks = now, None

    def forget_visible(self) -> None:
        """Discard cached visibility, because other geoms are present now."""
        self._visible, self._recent = {}, {}

    def visible(
        self, filter: Filter | PerWorld[Filter], find_present: Callable[[], NDArray[np.bool_] | None]
    ) -> wp.array:
        """(shapes,) or (worlds * shapes,) bool on the device: what a filter lets rays hit.

        find_present: (nworld, ngeom), which geoms are there in each of many worlds, None where they all are; the same
        until `forget_visible` is called.
        """
        known = self._recent.get(id(filter))
        if known is None:  # by id(), as hashing a filter takes longer than all else here
            if len(self._recent) == _MOST_FILTERS:
                self._recent.clear()
            known = self._recent[id(filter)] = filter, self._visible_to(filter, find_present)
        return known[1]

    def _visible_to(
        self, filter: Filter | PerWorld[Filter], find_present: Callable[[], NDArray[np.bool_] | None]
    ) -> wp.array:
        visible = self._visible.get(filter)
        if visible is not None:
            return visible
        require_as_before("Scene: got another filter", self._device)
        if len(self._visible) == _MOST_FILTERS:
            self._visible.clear()
        seen = filter.each(self._seen_by) if isinstance(filter, PerWorld) else self._seen_by(filter)
        present = find_present()
        if present is not None:
            seen = np.broadcast_to(seen, (len(present), seen.shape[-1])).copy()
            seen[:, : present.shape[-1]] &= present
        return self._visible.setdefault(filter, wp.array(seen.reshape(-1), dtype=wp.bool, device=self._device))

    def looks(self) -> Looks:
        """The optical properties of the shapes."""
        if self._looks is None:
            require_as_before("Scene: colours are asked for", self._device)
            self._looks = self._table.read(self._device)
        return self._looks

    @property
    def on_device(self) -> list[object]:
        """Arrays of optical properties read so far; a CUDA graph that uses them must hold these."""
        return [self._looks]

    def _seen_by(self, filter: Filter) -> NDArray[np.bool_]:
        """Which shapes (shapes,) a filter lets rays hit."""
        return np.concatenate([part.visible(filter) for part in self._parts])
