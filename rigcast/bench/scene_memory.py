"""`python -m rigcast.bench.scene_memory TRIANGLES`: bytes that a scene adds to its process (Linux only), as JSON."""

import json
import os
import sys
from pathlib import Path

import numpy as np

from rigcast.sensors.scene.freed_memory import give_back_freed_memory
from rigcast.sensors.scene.scene import Scene

from .workloads import Workload, hills


def resident() -> int:
    """Return the bytes of memory that this process has now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def ready(workload: Workload) -> Scene:
    """Return a scene that has cast."""
    scene = Scene(workload.model, "cpu")
    scene.update(workload.data)
    scene.cast((0, 0, 9), np.eye(3))
    return scene


def main(triangles: int) -> None:
    """Let a small scene load the kernels, then measure a large one."""
    workload = hills(triangles)
    kept = [ready(hills(2000))]
    give_back_freed_memory()  # else the scene takes what is free in the process already
    before = resident()
    kept.append(ready(workload))
    print(json.dumps({"bytes_per_triangle": (resident() - before) / triangles}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
