"""`python -m rigcast.bench.scene_memory {mesh,hfield} TRIANGLES`: bytes that a scene adds to its process, as JSON.

On Linux only. The mesh has the triangles of the height field, and is a prop, of which MuJoCo knows nothing.
"""

import gc
import json
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from rigcast.sensors.scene.freed_memory import give_back_freed_memory
from rigcast.sensors.scene.parts.height_fields import hfield_data, hfield_triangles
from rigcast.sensors.scene.scene import Scene
from rigcast.sensors.specs.mount import Mount
from rigcast.sensors.specs.prop import Prop

from .workloads import Workload, hills


def resident() -> int:
    """Return the bytes of memory that this process has now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def ready(workload: Workload, props: list[Prop]) -> Scene:
    """Return a scene that has cast."""
    scene = Scene(workload.model, "cpu", props=props)
    scene.update(workload.data)
    scene.cast((0, 0, 9), np.eye(3))
    return scene


def as_prop(workload: Workload, folder: str) -> Prop:
    """Return the height field as a mesh."""
    model, file = workload.model, Path(folder) / f"{workload.model.nhfielddata}.ply"
    trimesh.Trimesh(*hfield_triangles(model.hfield_size[0], hfield_data(model, 0)), process=False).export(file)
    return Prop(name="hills", file=file, mount=Mount())


def main(kind: str, triangles: int) -> None:
    """Let a small scene load the kernels, then measure a large one."""
    few = hills(2000)
    workloads = [few, few if kind == "mesh" else hills(triangles)]
    with tempfile.TemporaryDirectory() as folder:
        props = [[as_prop(hills(n), folder)] if kind == "mesh" else [] for n in (2000, triangles)]
        kept = [ready(workloads[0], props[0])]
        give_back_freed_memory()  # else the scene uses memory that the process has already
        before = resident()
        kept.append(ready(workloads[1], props[1]))
        gc.collect()  # trimesh meshes contain reference cycles
        give_back_freed_memory()
        print(json.dumps({"bytes_per_triangle": (resident() - before) / triangles}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
