"""numpy, torch and JAX share the memory of frames, with the same type and shape."""

import gc
from typing import Any

import mujoco
import numpy as np
import pytest

import rigcast

FIELDS = {
    "top": ("range", "points", "points_world", "normal", "geom_id", "body_id", "stamp", "ring", "column"),
    "front": ("range", "depth", "points"),
}
CASES = [(sensor, field) for sensor, fields in FIELDS.items() for field in fields]
SCENE = '<mujoco><worldbody><geom type="plane" size="9 9 1"/><geom size="0.5" pos="3 0 1"/></worldbody></mujoco>'


def sense() -> dict[str, rigcast.Frame]:
    mount = rigcast.Mount(pos=(0, 0, 1))
    sensors: list[rigcast.Lidar | rigcast.DepthCamera] = [
        rigcast.Lidar(name="top", mount=mount, elevation_deg=[-20, 0, 20], columns=36),
        rigcast.DepthCamera(name="front", mount=mount, resolution=(8, 6), fov_y_deg=50),
    ]
    model = mujoco.MjModel.from_xml_string(SCENE)
    return rigcast.Rig(model, sensors, device="cpu").sense(mujoco.MjData(model))


@pytest.fixture(scope="module")
def frames() -> dict[str, rigcast.Frame]:
    return sense()


@pytest.mark.parametrize("library", ["numpy", "torch"])
@pytest.mark.parametrize(("sensor", "field"), CASES)
def test_the_memory_is_shared(frames: dict[str, rigcast.Frame], sensor: str, field: str, library: str) -> None:
    array = getattr(frames[sensor], field)
    given = np.asarray(pytest.importorskip(library).from_dlpack(array))
    assert given.ctypes.data == array.ptr
    np.testing.assert_array_equal(given, array.numpy(), strict=True)


@pytest.mark.parametrize(("sensor", "field"), CASES)
def test_jax_shares_the_memory(frames: dict[str, rigcast.Frame], sensor: str, field: str) -> None:
    jax: Any = pytest.importorskip("jax")
    array = getattr(frames[sensor], field)
    with jax.enable_x64():  # without it JAX makes float32 of points_world and stamp
        given = jax.numpy.from_dlpack(array)
        assert given.unsafe_buffer_pointer() == array.ptr
        np.testing.assert_array_equal(np.asarray(given), array.numpy())


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_what_was_taken_outlives_its_frame(library: str) -> None:
    given = pytest.importorskip(library).from_dlpack(sense()["top"].range)
    expected = np.asarray(given).copy()
    gc.collect()
    for _ in range(5):  # would reuse the memory if it had been released
        sense()
    np.testing.assert_array_equal(np.asarray(given), expected)
