"""Patterns from a user's file: one measurement per row, with its time and direction."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of
from rigcast.sensors.specs.pattern import Pattern, directions_at
from rigcast.sensors.specs.spec import FilePath, Spec, Takes, beside, folder_of

from .ray_table import RayTable

_COLUMNS = ("time", "azimuth", "elevation", "ring")
_SUFFIXES = (".csv", ".npy")


class RayFile(Spec):
    """A CSV or NPY file with a row per measurement: time [s], azimuth [deg], elevation [deg] and, if any, ring.

    A CSV file may name its columns in a first line: `time`, `azimuth`, `elevation` or `zenith` (90 - elevation), and
    `ring`, in any order, each alone or followed by / or _ and its unit, as in Livox's `Time/s,Azimuth/deg,Zenith/deg`.
    Rows are in the order of their times, and the first one fires at the time of the reading.

    A file longer than 1 / rate_hz is spread evenly over successive readings and starts again after the last of them.
    Rows left over, fewer than there are readings, are not used.
    """

    path: Takes[str | Path, FilePath] = Field(description="the file, .csv or .npy; in a rig file a path relative to it")
    sample_rate_hz: float | None = Field(
        default=None,
        gt=0,
        description="rows per second [Hz], for files whose times are only counters; null: use the file's times",
    )

    @field_validator("path")
    @classmethod
    def _readable(cls, path: Path, info: ValidationInfo) -> Path:
        if path.suffix.lower() not in _SUFFIXES:
            raise ValueError(f"must be a file of type {' or '.join(_SUFFIXES)}, got {str(path)!r}")
        return beside(folder_of("ray_file", info), path)

    def pattern(self, rate_hz: float | None, phase: float) -> Pattern:
        """Rays (rays,), all readings of one size; column counts the rows of a reading.

        Raises InputError for a file that cannot be read, or has fewer rows than there are readings in its time.
        """
        table = read_rays(self.path)
        rows = len(table.ring)
        if self.sample_rate_hz is not None:
            table = replace(table, times=np.arange(rows) / self.sample_rate_hz)
        if table.readings(rate_hz) > rows:
            raise InputError(
                f"{self.path}: {rows} rows over {table.length:g} s are less than one per reading at "
                f"{rate_hz:g} Hz; expected more, or sample_rate_hz where the file's times only count"
            )
        return table.pattern(rate_hz, phase)


def read_rays(path: Path) -> RayTable:
    """The rows of a CSV or NPY file as `RayFile` describes them.

    Raises InputError for a file that cannot be read, and names the first row in which a value is not finite, time
    goes back, or an elevation is beyond 90 deg.
    """
    try:
        changed = path.stat().st_mtime_ns
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    return _read(path, changed)


@lru_cache(maxsize=4)
def _read(path: Path, _changed: int) -> RayTable:
    try:
        columns, numbers = _read_npy(path) if path.suffix.lower() == ".npy" else _read_csv(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    times, azimuth, elevation = (columns[name] for name in _COLUMNS[:3])
    if not times.size:
        raise InputError(f"{path}: got no row, expected one per measurement")
    ring = columns.get("ring", np.zeros_like(times))
    for what, bad in (
        ("a number that is not finite", ~np.isfinite([times, azimuth, elevation, ring]).all(axis=0)),
        ("a time before that of the row above", np.diff(times, prepend=times[0]) < 0),
        ("an elevation beyond 90 deg", np.abs(elevation) > 90),
    ):
        if bad.any():
            raise InputError(f"{path}:{numbers[int(bad.argmax())]}: got {what}")
    directions = directions_at(np.deg2rad(azimuth), np.deg2rad(elevation))
    return RayTable(directions, ring.astype(np.int32), times - times[0])


def _read_npy(path: Path) -> tuple[dict[str, NDArray[np.float64]], Sequence[int]]:
    """The columns by name, and the number of each row, from 0."""
    try:
        table = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise InputError(f"{path}: not an NPY file of numbers: {error}") from None
    if table.ndim != 2 or table.shape[1] not in (3, 4) or table.dtype.kind not in "iuf":
        raise InputError(f"{path}: got {table.dtype} of shape {table.shape}, expected numbers (n, 3) or (n, 4)")
    return dict(zip(_COLUMNS, table.astype(np.float64).T, strict=False)), range(len(table))


def _read_csv(path: Path) -> tuple[dict[str, NDArray[np.float64]], Sequence[int]]:
    """The columns by name, and the line of each row, from 1. Blank lines, and what follows a #, are left out."""
    lines = [(number, line) for number, line in enumerate(_lines(path), 1) if line.strip()]
    names, header = _column_names(path, *(lines[0] if lines else (1, "")))
    stripped = [(number, line.partition("#")[0].strip()) for number, line in lines[header:]]
    rows = [(number, line) for number, line in stripped if line]
    try:
        table = np.loadtxt([line for _, line in rows], delimiter=",", ndmin=2) if rows else np.empty((0, len(names)))
    except ValueError:
        raise InputError(_first_fault(path, rows, len(names))) from None
    if table.size and table.shape[1] != len(names):
        raise InputError(_first_fault(path, rows, len(names)))
    columns = dict(zip(names, table.reshape(-1, len(names)).T, strict=True))
    if "zenith" in columns:
        columns["elevation"] = 90 - columns.pop("zenith")
    return columns, [number for number, _ in rows]


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8-sig").splitlines()


def _column_names(path: Path, number: int, line: str) -> tuple[list[str], int]:
    """The columns of a CSV file, and the number of header lines (0 or 1)."""
    cells = [cell.strip() for cell in line.split(",")]
    if all(_is_number(cell) for cell in cells):
        return list(_COLUMNS[: max(3, min(len(cells), 4))]), 0
    names = [cell.lower().split("/")[0].split("_")[0] for cell in cells]
    known = (*_COLUMNS, "zenith")
    for name in names:
        if name not in known or names.count(name) > 1:
            raise InputError(
                f"{path}:{number}: column {name!r} is unknown or named twice, {expected_one_of(name, known)}"
            )
    if not {"time", "azimuth"} < set(names) or ("elevation" in names) == ("zenith" in names):
        raise InputError(
            f"{path}:{number}: got columns {', '.join(names)}, expected time, azimuth, and elevation or zenith"
        )
    return names, 1


def _first_fault(path: Path, rows: list[tuple[int, str]], columns: int) -> str:
    for number, line in rows:
        cells = line.split(",")
        if len(cells) != columns or not all(_is_number(cell) for cell in cells):
            return f"{path}:{number}: got {line[:60]!r}, expected {columns} numbers"
    return f"{path}: expected {columns} numbers in each row"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
