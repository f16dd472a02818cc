"""Reading frames without end takes no more memory; benchmarks/endless.py does it 100 000 times."""

import gc
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from endless import read, small_rig

from rigcast.bench.scene_memory import resident

FRAMES = 800
BYTES_PER_FRAME = 400  # less than the smallest array that a frame could leave behind, with its Python object


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read as Linux tells it")
def test_frames_leave_nothing_behind() -> None:
    rig, data = small_rig()
    read(rig, data, FRAMES)
    gc.collect()
    objects, memory = len(gc.get_objects()), resident()
    read(rig, data, FRAMES)
    gc.collect()
    assert len(gc.get_objects()) - objects < FRAMES / 20
    assert resident() - memory < BYTES_PER_FRAME * FRAMES
