"""Cards of presets, computed from their rays: for `rigcast presets NAME` and its picture."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.rig_file import sensor_of_preset
from rigcast.sensors.specs.pattern import Pattern, azimuth_elevation
from rigcast.sensors.specs.presets import Preset, load_preset
from rigcast.sensors.specs.sensor_spec import SensorSpec
from rigcast.sensors.specs.spec import Spec

_SHOWN = 8  # values of a list before it is cut short
_UNIT = re.compile(r"\[(.+?)\]")  # as the description of a key has it


@dataclass(frozen=True, eq=False)
class Card:
    """A preset and the rays of its first reading.

    azimuth_deg, elevation_deg: (n,) float64, to the left and up from where the sensor looks.
    """

    preset: Preset
    spec: SensorSpec
    pattern: Pattern
    azimuth_deg: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]

    @staticmethod
    def of(name: str) -> "Card":
        """The card of the preset of this name, or in this .yaml file. Raises InputError if there is none."""
        preset, spec = load_preset(name), sensor_of_preset(name)
        pattern = spec.pattern(mujoco.MjModel.from_xml_string("<mujoco/>"))
        return Card(preset, spec, pattern, *angles_deg(spec, pattern))

    @property
    def title(self) -> str:
        return f"{self.preset.name}: {self.preset.description}"

    def summary(self) -> list[str]:
        """Lines about its rays: number, directions, times of firing."""
        shape, rate = " x ".join(map(str, self.pattern.shape)), self.spec.rate_hz
        pace = "as often as asked"
        if rate is not None:
            pace = f"{rate:g} readings/s, {rate * self.azimuth_deg.size:,.0f} rays/s"
        firing = "all at once"
        if self.pattern.firing_times is not None:
            firing = f"over {self.pattern.duration * 1e3:.3f} ms"
        if self.pattern.later is not None:
            firing += ", other rays in each reading; the first one is shown"
        return [f"rays: {shape} in a reading, {pace}", f"field of view: {self._view()}", f"firing: {firing}"]

    def figures(self) -> Iterator[tuple[str, str]]:
        """The keys of the sensor that the preset gives, and its other figures, with values as text."""
        given = {key for preset in self.preset.lineage() for key in preset.sensor}
        for key in type(self.spec).model_fields:
            if key in given and getattr(self.spec, key) is not None:
                yield key, _with_unit(type(self.spec), key, getattr(self.spec, key))
        for key, value in self.preset.all_figures().items():
            yield key, _shown(value)

    def _view(self) -> str:
        low, high = self.elevation_deg.min(), self.elevation_deg.max()
        width = arc_deg(self.azimuth_deg)
        return f"{width:.4g} deg across, elevation {low:.4g} to {high:.4g} deg, between the outermost rays"


def angles_deg(spec: SensorSpec, pattern: Pattern) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Azimuth to the left and elevation up, (n,) float64 [deg] each, from the viewing direction; without NaN rays."""
    directions = pattern.directions.reshape(-1, 3)
    azimuth, elevation = azimuth_elevation(directions[np.isfinite(directions).all(axis=1)] @ spec.frame_rotation.T)
    return np.rad2deg(azimuth), np.rad2deg(elevation)


def arc_deg(azimuth_deg: NDArray[np.float64]) -> float:
    """The shortest arc [deg] that contains all azimuths; 360 if they leave no gap of more than 5 deg."""
    around = np.sort(np.unique(azimuth_deg.round(3)))
    gap = float(np.diff(around, append=around[0] + 360).max())
    return 360.0 if gap <= 5 else 360.0 - gap


def _with_unit(spec: type[Spec], key: str, value: Any) -> str:
    """A value as text, with the unit of its key unless the key itself ends in it."""
    unit = _UNIT.search(spec.model_fields[key].description or "")
    return _shown(value) if unit is None or key.endswith(("_deg", "_hz", "_us")) else f"{_shown(value)} {unit[1]}"


def _shown(value: Any) -> str:
    if isinstance(value, Spec):
        given = value.model_dump(exclude_unset=True)
        return ", ".join(f"{key}: {_with_unit(type(value), key, item)}" for key, item in given.items())
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_shown(item)}" for key, item in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        items = [_shown(item) for item in value]
        if len(items) > _SHOWN:
            items = [*items[:3], "...", f"{items[-1]}"]
        return f"[{', '.join(items)}]" + (f" ({len(value)} values)" if len(value) > _SHOWN else "")
    return f"{value:.10g}" if isinstance(value, float) else str(value)
