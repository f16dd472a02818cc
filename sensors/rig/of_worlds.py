"""Readings of many worlds, a part of them at a time."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, partial

import warp as wp

from rigcast.kernels.effects.random import random_source
from rigcast.kernels.hits.arrays import BYTES_PER_HIT
from rigcast.sensors.captured import is_captured
from rigcast.sensors.physics.physics import Brightness
from rigcast.sensors.scene.batch.posed_worlds import PosedWorlds
from rigcast.sensors.scene.batch.worlds import Worlds
from rigcast.sensors.scene.stage import Stage

from .arrays.frame_arrays import FrameArrays
from .capacity import require_countable, require_memory, require_out
from .frame import Frame
from .mounted import Aim, Mounted
from .reading import Request, frame_of, read

BYTES_AT_ONCE, BYTES_AT_ONCE_ON_CUDA = 2**24, 2**28
"""Memory for poses, trees and a sensor's errors of the worlds that are read at one time; at least one world is read. A
GPU needs more rays at a time than a CPU."""


def sense_worlds(
    scene: Stage, mounted: Sequence[Mounted], worlds: Worlds, out: Mapping[str, Frame] | None, seed: int
) -> dict[str, Frame]:
    """A frame of each of these sensors in all worlds, by name. Raises InputError if they do not fit into memory."""
    shapes = {m.spec.name: (worlds.count, *m.pattern.frame_shape) for m in mounted}
    if out is not None:
        require_out(out, shapes, scene.device)
    parts, room = _parts(scene, mounted, worlds, out)
    scene.take_worlds(worlds)
    readings = [ReadingOfWorlds(m, worlds, m.next_arrays(shapes[m.spec.name], out), seed) for m in mounted]
    for part in parts:
        read_worlds(readings, scene.pose_worlds(worlds, part))
    scene.had_room(room)
    return {m.spec.name: reading.frame() for m, reading in zip(mounted, readings, strict=True)}


def _parts(
    scene: Stage, mounted: Sequence[Mounted], worlds: Worlds, out: Mapping[str, Frame] | None
) -> tuple[list[slice], object]:
    """The parts of the worlds that are read at one time, and their memory needs. Raises InputError if they do not fit.

    If frames are overwritten and the previous reading needed as much, nothing is allocated, and how much memory is
    free is not asked for, which takes an eighth of the host's time.
    """
    rays = {m.spec.name: math.prod(m.pattern.frame_shape) for m in mounted}
    require_countable(worlds.count, rays)
    posed, errors = scene.bytes_per_posed_world(worlds), [m.bytes_per_posed_world for m in mounted]
    at_once = BYTES_AT_ONCE_ON_CUDA if scene.device.is_cuda else BYTES_AT_ONCE
    parts = worlds.parts(at_once // (posed + max(errors, default=0)))
    needs = {"scene": scene.bytes_per_world(worlds), **{m.spec.name: m.bytes_per_world(worlds) for m in mounted}}
    kept, meanwhile = _bytes_to_use(mounted, out), (posed + sum(errors)) * parts[0].stop
    room = worlds.count, needs, meanwhile
    if kept < BYTES_PER_HIT * worlds.count * sum(rays.values()) or room != scene.room:
        require_memory(worlds.count, needs, meanwhile, scene.device, kept)
    return parts, room


def _bytes_to_use(mounted: Sequence[Mounted], out: Mapping[str, Frame] | None) -> int:
    """Bytes of hits in arrays that will be overwritten: those of frames that nobody holds, and of frames in `out`."""
    given = [out[m.spec.name] for m in mounted if m.spec.name in out] if out else []
    return sum(m.pool.free_bytes for m in mounted) + BYTES_PER_HIT * sum(math.prod(frame.shape) for frame in given)


class ReadingOfWorlds:
    """A reading of one sensor, a part of the worlds at a time, into arrays for all of them.

    So poses, trees and errors need memory only for the worlds that are read at one time.
    """

    def __init__(self, mounted: Mounted, worlds: Worlds, arrays: FrameArrays, seed: int) -> None:
        self._mounted, self._worlds, self._arrays, self._seed = mounted, worlds, arrays, seed
        self._brightness: list[tuple[slice, Brightness]] = []

    @cached_property
    def _fired(self) -> tuple[Mounted, int]:
        """The sensor with its next pattern, and the number of the reading. Readings refused earlier are not counted."""
        return self._mounted.next_of_worlds(self._worlds), next(self._mounted.frames)

    def request(self, posed: PosedWorlds) -> Request:
        """A request to read the worlds at which the scene stands now. Reading a world again gives the same values."""
        arrays, (fired, number) = self._arrays.of_worlds(posed.part), self._fired
        rays = fired.aim_in_worlds(posed, arrays)
        name, of_each = fired.spec.name, math.prod(fired.pattern.shape)
        return Request(fired, rays, arrays, lambda: random_source(self._seed, name, number, posed.ids, of_each))

    def take(self, posed: PosedWorlds, brightness: Brightness | None, *used: object) -> None:
        """Take over the readings of these worlds, and hold what a CUDA graph that repeats them needs."""
        if brightness is not None:
            self._brightness.append((posed.part, brightness))
        fired = self._fired[0]
        if is_captured(fired.scene.device):
            self._arrays.keep(fired, posed, fired.visible(), *used, *fired.scene.on_device)

    def frame(self) -> Frame:
        """The frame of all worlds, after they have been read."""
        fired, arrays, device = self._fired[0], self._arrays, self._arrays.range.device
        time = arrays.fields.get("time", lambda _: arrays.frames.time)
        pose = arrays.fields.get("pose", lambda _: arrays.frames.pose)
        aim = Aim(time, pose, arrays.aim_in_worlds(fired.pattern.rays), arrays)
        brightness = partial(_joined, self._brightness, arrays.range.size, device) if self._brightness else None
        return frame_of(fired, aim, brightness)


def read_worlds(readings: Sequence[ReadingOfWorlds], posed: PosedWorlds) -> None:
    """Read the worlds at which the scene stands now."""
    requests = [reading.request(posed) for reading in readings]
    brightness, used = read(requests)
    for reading, each, bright in zip(readings, requests, brightness, strict=True):
        reading.take(posed, bright, each, used)


def _joined(parts: Sequence[tuple[slice, Brightness]], count: int, device: wp.Device, out: wp.array | None) -> wp.array:
    """The intensity of `count` rays, concatenated from parts of the worlds."""
    worlds = max(part.stop for part, _ in parts)
    out = wp.empty(count, dtype=float, device=device) if out is None else out
    for part, brightness in parts:
        brightness(out[part.start * count // worlds : part.stop * count // worlds])
    return out
