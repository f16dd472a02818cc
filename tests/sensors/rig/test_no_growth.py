"""A scene takes little memory, and reading frames takes no more and more; benchmarks/endless.py reads 100 000."""

import gc
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from endless import read, small_rig

from rigcast.bench.scene_memory import resident

FRAMES = 800
BYTES_PER_FRAME = 400  # less than the smallest array that a frame could leave behind, with its Python object


TRIANGLES = 300_000
BYTES_PER_TRIANGLE = 120  # 36 of them are its corners

needs_statm = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read as Linux tells it")


@needs_statm
def test_a_scene_whose_tree_was_built_keeps_little_beside_the_tree() -> None:
    command = [sys.executable, "-m", "rigcast.bench.scene_memory", "mesh", str(TRIANGLES)]
    environment = os.environ | {"RIGCAST_CACHE": "off"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    taken = json.loads(done.stdout.splitlines()[-1])["bytes_per_triangle"]
    assert 36 < taken < BYTES_PER_TRIANGLE


@needs_statm
@pytest.mark.usefixtures("no_older_objects")
def test_frames_leave_nothing_behind() -> None:
    rig, data = small_rig()
    objects, memory = [], []
    for _ in range(4):
        read(rig, data, FRAMES)
        gc.collect()
        objects.append(len(gc.get_objects()))
        memory.append(resident())
    # the least, as memory that is allocated once, for whatever reason, is in one of them
    assert min(np.diff(objects)) < FRAMES / 20, objects
    assert min(np.diff(memory)) < BYTES_PER_FRAME * FRAMES, memory
