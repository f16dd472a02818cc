"""Depth cameras on a GPU measure what they measure on the CPU, noise and losses included."""

from importlib.resources import files
from typing import Any

import mujoco
import numpy as np
import pytest
from depth_scenes import camera

from rigcast import BrownConrady, CameraFrame, Mount, Rig, Stereo, TimeOfFlight

pytestmark = pytest.mark.cuda
SCENE = files("rigcast.configs") / "effects.xml"
STEREO = Stereo(
    baseline=0.05,
    disparity_std=0.1,
    disparity_step=1 / 32,
    max_disparity=30,
    shadow=True,
    matching_window=5,
    dropout=0.1,
)


@pytest.mark.parametrize(
    "arguments",
    [
        {"distortion": BrownConrady(k1=-0.1, k2=0.01)},
        {"stereo": STEREO},
        {"stereo": Stereo(baseline=0.05, untextured_dropout=0.5, min_intensity=0.01, max_incidence_deg=80)},
        {"stereo": Stereo(baseline=0.075, kinect_v1="nguyen")},
        {"stereo": Stereo(baseline=0.075, kinect_v1="disparity")},
        {"time_of_flight": TimeOfFlight(range_std=0.02, bias=0.01, subrays=3, modulation_hz=5e7)},
    ],
)
def test_cuda_measures_what_the_cpu_measures(arguments: dict[str, Any]) -> None:
    """A few pixels in a thousand are at an edge, or at a rounding step, and may differ."""
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    spec = camera(mount=Mount(camera="eye"), **arguments)
    cpu, cuda = (Rig(model, [spec], device, seed=3).sense(data)["eye"] for device in ("cpu", "cuda:0"))
    assert isinstance(cpu, CameraFrame)
    assert isinstance(cuda, CameraFrame)
    for name in ("depth", "range", "intensity", "normal"):
        a, b = (getattr(frame, name).numpy() for frame in (cpu, cuda))
        assert np.isclose(a, b, rtol=1e-4, atol=1e-5, equal_nan=True).mean() > 0.997, name
    assert (cpu.depth_16bit.numpy() == cuda.depth_16bit.numpy()).mean() > 0.95
    assert (cpu.geom_id.numpy() == cuda.geom_id.numpy()).mean() > 0.997
