"""The environment on which the bits of frames depend: versions, the device, and how kernels are compiled."""

import platform
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path

import warp as wp

from rigcast.dataset.description.file import DatasetFile
from rigcast.quiet import quiet_warp
from rigcast.sensors.device import find_device
from rigcast.sensors.errors import InputError

_PACKAGES = ("rigcast", "mujoco", "warp-lang", "numpy", "pillow")
_FORMAT_PACKAGES = {"npz": (), "zarr": ("zarr", "numcodecs"), "exr": ("openexr",)}
_NATIVE = "-march=native"
_VECTORS = ("sse", "ssse", "avx", "fma", "f16c", "bmi", "amx", "asimd", "sve")  # which affect code


def prepare_warp(portable: bool) -> None:
    """Silence Warp and, for a portable data set, let it compile for the generic CPU of the architecture from now on.

    Raises InputError if Warp has no such option.
    """
    quiet_warp()
    if not portable:
        return
    if not hasattr(wp.config, "cpu_compiler_flags"):
        raise InputError(
            f"portable: warp-lang {wp.__version__} compiles for the CPU at hand only, expected a newer one"
        )
    flags = (wp.config.cpu_compiler_flags or "").replace(_NATIVE, "").strip()
    if flags != wp.config.cpu_compiler_flags:
        wp.config.cpu_compiler_flags = flags
        for name in [name for name in sys.modules if name.startswith("rigcast.kernels")]:
            wp.get_module(name).mark_modified()  # loaded modules were compiled with other flags


def environment(file: DatasetFile, device: str | None) -> dict[str, str]:
    """Versions, device and compiler flags as plain values; frames are reproducible only where these are the same."""
    packages = (
        *_PACKAGES,
        *_FORMAT_PACKAGES[file.output.format],
        *(_FORMAT_PACKAGES["exr"] if file.output.exr else ()),
    )
    place = find_device(device)
    machine = platform.machine() if file.portable else f"{platform.machine()} {_cpu_name()}"
    flags = getattr(wp.config, "cpu_compiler_flags", None)
    made_with = {name: _version(name) for name in packages}
    return made_with | {
        "device": machine if place.is_cpu else place.name,
        "cpu_compiler_flags": _NATIVE if flags is None else flags,
    }


@cache  # each call takes some milliseconds
def _version(package: str) -> str:
    return version(package)


@cache
def _cpu_name() -> str:
    """The CPU's name, which virtual machines share, and its vector instructions."""
    try:
        lines = [line.partition(":") for line in Path("/proc/cpuinfo").read_text().splitlines()]
    except OSError:
        return platform.processor()
    about = {key.strip(): value.strip() for key, _, value in reversed(lines)}
    features = (about.get("flags") or about.get("Features") or "").split()
    vectors = sorted(feature for feature in features if feature.startswith(_VECTORS))
    return " ".join([about.get("model name", platform.processor()), *vectors])
