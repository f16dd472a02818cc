"""rigcast: rays of one origin cast as by a sensor, others by `Scene.cast`."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from types import SimpleNamespace

import mujoco
import numpy as np
import numpy.typing as npt

from rigcast.kernels.cast import launch
from rigcast.kernels.packing.sorting import sort_into_packets
from rigcast.oracle import Things
from rigcast.sensors.rig.arrays.pool import Pool
from rigcast.sensors.scene.hits import Hits
from rigcast.sensors.scene.parts.part import OWNERS
from rigcast.sensors.scene.rays.placed import rays_in_frame
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.prop import Prop

from .caster import EVERY_GROUP, Answer, Cast, Floats


class RigcastCaster:
    name = "rigcast"
    version = version("rigcast")

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        groups: Sequence[int] = EVERY_GROUP,
        props: Sequence[Prop] = (),
    ) -> None:
        self.scene = Scene(model, "cpu", props)
        self._data = data
        self._filter = Filter(geom_groups=tuple(groups))
        self._things = Things.of(model, props)
        self._ids = [f"{owner}_id" for owner in OWNERS if owner == "geom" or owner in self._things.kinds]

    def aim(self, origins: Floats, directions: Floats) -> Cast:
        return self._of_sensor(origins, directions) if origins.ndim == 1 else self._of_any(origins, directions)

    def _of_sensor(self, origin: Floats, directions: Floats) -> Cast:
        rays = rays_in_frame(directions, origin, np.eye(4), self.scene.device)
        rays = replace(rays, packets=sort_into_packets(directions))
        shape, pool, are_geoms = directions.shape[:-1], Pool(), self.scene.shape_ids.are_shapes("geom")

        def frame() -> Answer:
            self.scene.update(self._data)
            arrays = pool.take(shape, self.scene.device)
            launch([arrays.readings(self.scene, rays, self.scene.visible(self._filter), (0.0, np.inf))])
            numbers = arrays.shape_hit if are_geoms else self._numbers(self.scene.hits(arrays.hits, shape))
            return Answer(np.asarray(arrays.range), np.asarray(numbers), np.asarray(arrays.normal))

        return frame

    def _of_any(self, origins: Floats, directions: Floats) -> Cast:
        def frame() -> Answer:
            self.scene.update(self._data)
            hits = self.scene.cast(origins, directions, filter=self._filter)
            return Answer(np.asarray(hits.distance), self._numbers(hits), np.asarray(hits.normal))

        return frame

    def _numbers(self, hits: Hits) -> npt.NDArray[np.int32]:
        return self._things.numbers(SimpleNamespace(**{name: getattr(hits, name) for name in self._ids}))


CASTER = RigcastCaster
