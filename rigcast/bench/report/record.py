"""The results of one run of `rigcast bench` and its environment, to JSON and back."""

import json
import os
import platform
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path

from pydantic import TypeAdapter

from rigcast.bench.figure import Figure
from rigcast.bench.race import Result
from rigcast.bench.scaling import Series
from rigcast.bench.worlds.measure import OnDevice
from rigcast.kernels.launching.slices import thread_count

_PACKAGES = ("rigcast", "mujoco", "warp-lang", "numpy", "open3d", "mujoco-lidar", "mujoco-warp")


@dataclass
class Record:
    """The environment of a run, and its results.

    load: number of threads ready to run on the machine before the run, NaN if unknown. versions: of the installed
    packages.
    """

    machine: str
    processor: str
    cores: int
    threads: int
    rounds: int
    load: float
    versions: dict[str, str]
    results: list[Result] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    scaling: list[Series] = field(default_factory=list)
    worlds: OnDevice | None = None

    @staticmethod
    def begun(rounds: int) -> "Record":
        """The record of a run that begins now."""
        load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
        versions = dict(chain.from_iterable(map(_version, _PACKAGES)))
        return Record(platform.machine(), _processor(), os.cpu_count() or 1, thread_count(), rounds, load, versions)

    @staticmethod
    def read(file: Path) -> "Record":
        """The record from a file written by `as_json`."""
        return TypeAdapter(Record).validate_python(json.loads(file.read_text()))

    def as_json(self) -> str:
        """The record as JSON. Speeds are in M rays/s."""
        return json.dumps(asdict(self), indent=1) + "\n"

    @property
    def packages(self) -> str:
        """The versions in one line."""
        return ", ".join(f"{name} {version}" for name, version in self.versions.items())


def _version(package: str) -> Iterator[tuple[str, str]]:
    try:
        yield package, version(package)
    except PackageNotFoundError:
        return


def _processor() -> str:
    """Return the CPU's name from Linux, else from Python."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
