"""Measurements of preparations for the first frame: trees and start-up, by CPU time of all threads; memory."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from unittest.mock import patch

from rigcast.kernels.world.triangle_tree import build_triangle_tree
from rigcast.sensors.scene.cache.trees import cached_triangle_tree
from rigcast.sensors.scene.parts.height_fields import hfield_data, hfield_tree, hfield_triangles

from .figure import Figure, Spread
from .race import in_turns
from .workloads import hills

MILLION = 1_000_000


def trees(rounds: int, triangles: int = MILLION) -> Iterator[Figure]:
    """CPU time to build the tree of a mesh, to read it as a second start does, and to build that of a height field."""
    model = hills(triangles).model
    field = model.hfield_size[0], hfield_data(model, 0)
    mesh = hfield_triangles(*field)
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, RIGCAST_CACHE=folder):
        cached_triangle_tree(*mesh)
        ways = {
            "build": lambda: build_triangle_tree(*mesh),
            "read": lambda: cached_triangle_tree(*mesh),
            "hfield": lambda: hfield_tree(*field),
        }
        times = in_turns(ways, min(rounds, 3))
    names = ("a tree built", "a tree read by a second start", "the tree of a height field built")
    for way, what in zip(ways, names, strict=True):
        seconds = times[way][1] / len(mesh[1]) * MILLION
        yield Figure(f"tree_{way}", f"{what}, for each million triangles", "s", Spread.of(seconds))


def memory(rounds: int, triangles: int = MILLION) -> Iterator[Figure]:
    """Memory that a scene adds to its process, without kernels and model. Nothing where there is no /proc."""
    del rounds
    if not os.path.exists("/proc/self/statm"):
        return
    with tempfile.TemporaryDirectory() as folder:
        for way, kind, what in (
            ("built", "mesh", "its tree built"),
            ("read", "mesh", "its tree read"),
            ("hfield", "hfield", "of a height field"),
        ):
            grown = _child("scene_memory", kind, str(triangles), RIGCAST_CACHE=folder)["bytes_per_triangle"]
            of_scene = f"memory of a scene of {triangles} triangles, {what}"
            yield Figure(f"memory_{way}", of_scene, "bytes/triangle", Spread.of(grown))


def start(rounds: int) -> Iterator[Figure]:
    """CPU time from a fresh Python to the demo's first frames: import, model, rig and one frame of each sensor."""
    with tempfile.TemporaryDirectory() as folder:
        # bytecode is kept, as it is by default, and the first start writes it
        bytecode = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": f"{folder}/bytecode"}
        warm = [_child("first_frame", **bytecode) for _ in range(1 + min(rounds, 3))][1:]
        cold = _child("first_frame", **bytecode, WARP_CACHE_PATH=f"{folder}/kernels")
    for part in warm[0]:
        yield Figure(f"start_{part}", f"start of the demo: {part}", "s", Spread.of([times[part] for times in warm]))
    yield Figure("start_cold", "start of the demo, kernels compiled", "s", Spread.of(cold["in all"]))


def _child(module: str, *arguments: str, **environment: str) -> dict[str, float]:
    """Run a module of this package in a process of its own; return the last line that it prints."""
    command = [sys.executable, "-m", f"{__package__}.{module}", *arguments]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)
    measured: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return measured
