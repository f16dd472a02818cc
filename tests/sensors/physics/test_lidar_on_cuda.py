"""Lidars on a GPU measure what they measure on the CPU, noise and losses included."""

from importlib.resources import files
from typing import Any

import mujoco
import numpy as np
import pytest
from lidar_scenes import wide

from rigcast import Beam, Detection, LidarFrame, Mount, Noise, Rig, Weather

pytestmark = pytest.mark.cuda
SCENE = files("rigcast.configs") / "effects.xml"
NOISE = Noise(range_std=0.02, angle_std_deg=0.1, dropout=0.1, dark_dropout=0.3, range_resolution=0.002)


@pytest.mark.parametrize(
    "options",
    [
        {"noise": NOISE},
        {"detection": Detection(range=6, accuracy=0.03, accuracy_range=6)},
        {"beam": Beam(divergence_deg=(0.6, 0.3)), "returns": "dual"},
        {"max_surfaces": 4, "mirrors": True, "returns": "dual"},
        {"weather": Weather(rain_rate=50, visibility=20), "detection": Detection(range=60), "returns": "first"},
    ],
)
def test_cuda_measures_what_the_cpu_measures(options: dict[str, Any]) -> None:
    """A few rays in a thousand are at an edge, or at a rounding step, and may differ."""
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    spec = wide(mount=Mount(site="eye"), **options)
    cpu, cuda = (Rig(model, [spec], device, seed=3).sense(data)["top"] for device in ("cpu", "cuda:0"))
    assert isinstance(cpu, LidarFrame)
    assert isinstance(cuda, LidarFrame)
    for name in ("range", "intensity", "normal", "points"):
        a, b = (getattr(frame, name).numpy() for frame in (cpu, cuda))
        assert np.isclose(a, b, rtol=1e-4, atol=1e-5, equal_nan=True).mean() > 0.995, name
    assert (cpu.geom_id.numpy() == cuda.geom_id.numpy()).mean() > 0.995
