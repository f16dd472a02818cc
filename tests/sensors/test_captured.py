"""Readings of worlds on a GPU: the host does not wait for them, and a CUDA graph repeats them as captured, whatever the
rig reads in between."""

# mypy: disallow-untyped-decorators=False

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from world_states import SENSORS, arrays_of, model, states

from rigcast import Filter, Frame, InputError, Mount, Rig, Scene, Worlds

wp.set_module_options({"enable_backward": False})

pytestmark = pytest.mark.cuda
MODEL = model()
STILL = [spec for name, spec in SENSORS.items() if name not in ("moving", "rolling", "rosette")]
IDEAL = ("lidar", "fixed", "ring", "scan", "camera")
COUNT = 3
TYPES = {"xpos": wp.vec3, "xmat": wp.mat33}


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const long long first = clock64();
    while (clock64() - first < cycles) {}
#endif
""")
def wait(cycles: wp.int64):  # type: ignore[no-untyped-def]
    """Wait for a number of cycles of the GPU's clock."""


@wp.kernel
def keep_busy(cycles: wp.int64) -> None:
    wait(cycles)


def on_device(seed: int, count: int = COUNT, spread: float = 1.0) -> dict[str, wp.array]:
    """Random poses of `count` worlds on the GPU."""
    arrays = arrays_of(states(MODEL, count, seed))
    del arrays["time"]
    arrays["geom_xpos"] *= spread
    types = {name: TYPES[name.rpartition("_")[2]] for name in arrays}
    return {
        name: wp.array(values.reshape(count, -1, *types[name]._shape_), dtype=types[name], device="cuda:0")
        for name, values in arrays.items()
    }


def values(frames: Mapping[str, Frame]) -> dict[str, NDArray[Any]]:
    fields = ("range", "normal", "points_world", "geom_id", "body_id")
    return {f"{name}.{field}": getattr(frames[name], field).numpy() for name in IDEAL for field in fields}


def captured(rig: Rig, batch: Mapping[str, wp.array]) -> tuple[dict[str, Frame], "wp.Graph"]:
    frames = rig.sense(batch)
    values(frames)
    rig.sense(batch, out=frames)
    with wp.ScopedCapture("cuda:0") as capture:
        rig.sense(batch, out=frames)
    return frames, capture.graph


def test_the_host_waits_for_no_reading() -> None:
    """All launches return while an earlier kernel, which takes a second, is still running."""
    rig, batch = Rig(MODEL, STILL, "cuda:0"), on_device(0)
    rays = wp.array(np.ones((COUNT, 5, 3)), dtype=wp.vec3d, device="cuda:0")
    frames, hits = rig.sense(batch), rig.scene.cast(rays, rays)
    for cycles in (0, 2 * 10**9):
        wp.synchronize_device("cuda:0")
        wp.launch(keep_busy, 1, inputs=[wp.int64(cycles)], device="cuda:0")
        busy = wp.get_stream("cuda:0").record_event()
        for spec in STILL:
            rig.sense(batch, [spec.name], out=frames)
            assert cycles == 0 or not busy.is_complete, spec.name
        rig.scene.cast(rays, rays, out=hits)
        assert cycles == 0 or not busy.is_complete, "cast"


def test_a_graph_needs_no_colours_where_no_sensor_does() -> None:
    rig, batch = Rig(MODEL, [SENSORS["scan"]], "cuda:0"), on_device(0)
    frames = rig.sense(batch)
    with wp.ScopedCapture("cuda:0") as capture:
        rig.sense(batch, out=frames)
    expected = frames["scan"].range.numpy()
    frames["scan"].range.zero_()
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(frames["scan"].range.numpy(), expected)


def nothing(_rig: Rig, _frames: Mapping[str, Frame]) -> None:
    pass


def other_readings(rig: Rig, _frames: Mapping[str, Frame]) -> None:
    for count in (1, 5):
        rig.sense(on_device(count, count))
    rig.sense(states(MODEL, 1)[0])


def trees_built_anew(rig: Rig, _frames: Mapping[str, Frame]) -> None:
    for seed in range(3):
        rig.sense(on_device(seed, spread=100.0))


def other_sizes(rig: Rig, frames: Mapping[str, Frame]) -> None:
    rig.model.geom_size *= 1.5
    rig.sense(on_device(0), out=frames)
    rig.model.geom_size /= 1.5


@pytest.mark.parametrize("meanwhile", [nothing, other_readings, trees_built_anew, other_sizes])
def test_a_graph_reads_what_a_reading_does(meanwhile: Callable[[Rig, Mapping[str, Frame]], None]) -> None:
    rig, batch = Rig(model(), STILL, "cuda:0"), on_device(0)
    frames, graph = captured(rig, batch)
    meanwhile(rig, frames)
    for seed in (7, 8):
        for name, array in on_device(seed).items():
            wp.copy(batch[name], array)
        wp.capture_launch(graph)
        got = values(frames)
        for name, expected in values(rig.sense(batch)).items():
            np.testing.assert_array_equal(got[name], expected, err_msg=f"seed {seed}: {name}")


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "MjData": (lambda: states(MODEL, 1)[0], "Scene.update: data: got MjData while a CUDA graph is captured"),
    "a list": (lambda: states(MODEL, 3), "Worlds: geom_xpos: got an array on the host while"),
    "time": (lambda: on_device(0) | {"time": np.zeros(3)}, "Worlds: time: got an array on the host while"),
    "active": (lambda: Worlds(on_device(0), active=[True, False, True]), "Worlds: active: got an array on the host"),
}


@pytest.mark.parametrize(("data", "message"), REFUSED.values(), ids=list(REFUSED))
def test_what_is_on_the_host_is_refused_in_a_graph(data: Callable[[], Any], message: str) -> None:
    rig, given = Rig(MODEL, STILL, "cuda:0"), data()
    rig.sense(given)
    with wp.ScopedCapture("cuda:0"), pytest.raises(InputError, match=message):
        rig.sense(given)


def changed(name: str) -> Callable[[Rig], Any]:
    def change(rig: Rig) -> Any:
        getattr(rig.model, name)[:] *= 0.5
        return on_device(0)

    return change


def given(**options: Any) -> Callable[[Rig], Any]:
    return lambda _: Worlds(on_device(0), **options)


UNREAD: dict[str, tuple[Callable[[Rig], Any], str]] = {
    "colours": (changed("geom_rgba"), "Scene: colours, groups or materials of the model are others while a CUDA graph"),
    "sizes": (changed("geom_size"), "Scene: sizes, meshes or what is visible are others while"),
    "a height field": (changed("hfield_data"), "Scene: sizes, meshes or what is visible are others while"),
    "what is visible": (given(visible=np.eye(COUNT, MODEL.ngeom) > 0), "Scene: sizes, meshes or what is visible are"),
    "filters": (given(filters={"lidar": [Filter(static=False)] * COUNT}), "Scene: got another filter while"),
    "mounts": (given(mounts={"scan": [Mount()] * COUNT}), "Worlds: mounts: 'scan': got those of a new Worlds while"),
    "ids": (given(ids=[7, 8, 9]), "Worlds: got other ids while"),
}


@pytest.mark.parametrize(("change", "message"), UNREAD.values(), ids=list(UNREAD))
def test_what_was_not_read_before_is_refused_in_a_graph_and_read_after_it(
    change: Callable[[Rig], Any], message: str
) -> None:
    """Else the graph would copy it at each replay from host memory that may be gone."""
    rig = Rig(model(), STILL, "cuda:0")
    rig.sense(on_device(0))
    batch = change(rig)
    with wp.ScopedCapture("cuda:0"), pytest.raises(InputError, match=message):
        rig.sense(batch)
    got, expected = values(rig.sense(batch)), values(Rig(rig.model, STILL, "cuda:0").sense(batch))
    for name in got:
        np.testing.assert_array_equal(got[name], expected[name], err_msg=name)


def test_rays_that_are_others_in_each_reading_are_refused_in_a_graph() -> None:
    rig, batch = Rig(MODEL, [SENSORS["rosette"]], "cuda:0"), on_device(0)
    rig.sense(batch)
    with wp.ScopedCapture("cuda:0"), pytest.raises(InputError, match="sensor 'rosette': got a pattern that is another"):
        rig.sense(batch)


def test_rays_on_the_host_are_refused_in_a_graph() -> None:
    scene = Scene(MODEL, "cuda:0")
    scene.update(states(MODEL, 1)[0])
    with wp.ScopedCapture("cuda:0"), pytest.raises(InputError, match="directions: got an array on the host while"):
        scene.cast((0, 0, 1), (1, 0, 0))


def test_the_default_device_may_be_another() -> None:
    """Events of an update must be recorded on the scene's device, not on the default one."""
    with wp.ScopedDevice("cpu"):
        scene, data = Scene(MODEL, "cuda:0"), mujoco.MjData(MODEL)
        mujoco.mj_kinematics(MODEL, data)
        for _ in range(3):
            scene.update(data)
