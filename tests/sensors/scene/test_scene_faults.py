"""Input that a scene or a rig cannot use is refused with one InputError; a diverged simulation leaves no trace."""

import warnings
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from small_scenes import model_of, posed, ready, row

from rigcast import InputError, Lidar, Mount, Rig, Scene
from rigcast.sensors.rig.timing.schedule import Schedule

NAN, INF = np.nan, np.inf
ROW = row()
DATA = posed(ROW.model)
LIDAR = Lidar(name="top", mount=Mount(), elevation_deg=[0], columns=4)


def on_device(values: Any, dtype: Any = wp.vec3) -> wp.array:
    return wp.array(np.asarray(values), dtype=dtype, device=ROW.device)


def rig() -> Rig:
    return Rig(ROW.model, [LIDAR])


def cast(**arguments: Any) -> None:
    ROW.cast(**{"origins": (0, 0, 0), "directions": (1, 0, 0), **arguments})


def edited(geom: str, field: str, index: Any, value: Any) -> mujoco.MjModel:
    model = model_of(f'<geom name="odd" {geom}/>')
    getattr(model, field)[index] = value
    return model


MESH, HILL = 'type="mesh" mesh="cube"', 'type="hfield" hfield="hill"'
ANY: Any = None
MANY: Any = [DATA]
REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "no model": (lambda: Scene(ANY), "Scene: model: got NoneType, expected MjModel"),
    "data for a model": (lambda: Scene(DATA), "Scene: model: got MjData, expected MjModel"),
    "no data": (lambda: Scene(ROW.model).update(ANY), "Scene.update: data: got NoneType, expected MjData"),
    "text for a distance": (lambda: cast(max_distance="1"), "max_distance: got str, expected Real"),
    "no distance": (lambda: cast(max_distance=None), "max_distance: got NoneType, expected Real"),
    "a distance per ray": (lambda: cast(max_distance=[1.0]), "max_distance: got list, expected Real"),
    "culls": (lambda: cast(cull=["back"]), r"no cull \['back'\], expected one of none, back, front"),
    "text for a filter": (lambda: cast(filter="all"), "filter: got str, expected Filter"),
    "a mapping for a filter": (lambda: cast(filter={}), "filter: got dict, expected Filter"),
    "a far origin": (lambda: cast(origins=(0, 1e30, 0)), r"origins: got .*, expected finite numbers up to 1e\+18 m"),
    "device floats": (lambda: cast(directions=on_device(np.eye(3), float)), "directions: got an array of float32"),
    "device vec2": (lambda: cast(directions=on_device([[1.0, 0]], wp.vec2)), "directions: got an array of vec2"),
    "device vec3h": (lambda: cast(directions=on_device([[1.0, 0, 0]], wp.vec3h)), "directions: got an array of vec3"),
    "device origins, floats": (
        lambda: cast(origins=on_device(np.eye(3), float), directions=on_device(np.eye(3))),
        "origins: got an array of float32, expected vec3 or vec3d",
    ),
    "host origin NaN, device directions": (
        lambda: cast(origins=(NAN, 0, 0), directions=on_device(np.eye(3))),
        r"origins: got \[nan, 0.0, 0.0\], expected finite",
    ),
    "a mesh with NaN": (lambda: Scene(edited(MESH, "mesh_vert", (3, 1), NAN)), "mesh 'cube': face .* vertex 3: got"),
    "a mesh with inf": (lambda: Scene(edited(MESH, "mesh_vert", (3, 1), -INF)), "mesh 'cube': face .* vertex 3: got"),
    "a mesh of 1e30 m": (lambda: Scene(edited(MESH, "mesh_vert", (3, 1), 1e30)), r"mesh 'cube': .* up to 1e\+18 m"),
    "a face out of range": (lambda: Scene(edited(MESH, "mesh_face", (2, 0), 99)), "'cube': face 2: got vertex 99"),
    "a height of NaN": (lambda: Scene(edited(HILL, "hfield_data", 2, NAN)), "hfield 'hill': row 0, column 2: got"),
    "a size of NaN": (lambda: Scene(edited('size="1"', "geom_size", 0, NAN)), "geom odd: size: got .*nan"),
    "a size of 1e30 m": (lambda: Scene(edited('size="1"', "geom_size", 0, 1e30)), r"geom odd: size: .* up to 1e\+18 m"),
    "a rig without a model": (lambda: Rig(ANY, [LIDAR]), "Rig: model: got NoneType, expected MjModel"),
    "no sensors": (lambda: Rig(ROW.model, ANY), "Rig: sensors: got NoneType, expected a list of sensors"),
    "a sensor for sensors": (lambda: Rig(ROW.model, LIDAR), "Rig: sensors: got Lidar, expected a list of sensors"),  # type: ignore[arg-type]
    "a name for a sensor": (lambda: Rig(ROW.model, ["top"]), r"Rig: sensors\[0\]: got str, expected Lidar or"),  # type: ignore[list-item]
    "a name for names": (lambda: rig().sense(DATA, "top"), r"Rig: names: got 'top', expected .* \['top'\]"),
    "a number for names": (lambda: rig().sense(DATA, 3), "Rig: names: got 3, expected a list of names"),  # type: ignore[arg-type]
    "None among names": (lambda: rig().sense(DATA, [ANY]), "name of a sensor: got NoneType, expected str"),
    "nothing to sense": (lambda: rig().sense(ANY), "Rig: data: got NoneType, expected MjData"),
    "nothing to step": (lambda: list(rig().step(ANY)), "Rig: data: got NoneType, expected MjData"),
    "worlds to step": (
        lambda: rig().step(MANY),
        r"Rig.step: data: got many worlds \(list\), expected one MjData; sense reads many worlds",
    ),
    "a clock of NaN": (lambda: Schedule(10, 0.01).due(NAN), "data.time: got nan s, expected a finite time"),
    "a clock of inf": (lambda: Schedule(None, 0.01).due(INF), "data.time: got inf s, expected a finite time"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_with_one_clear_error(name: str) -> None:
    act, message = REFUSED[name]
    with pytest.raises(InputError, match=message) as caught:
        act()
    assert "\n" not in str(caught.value)


def test_a_clock_that_leaps_is_refused_and_then_starts_over() -> None:
    schedule = Schedule(10.0, 0.01)
    assert schedule.due(0.0) == [0.0]
    with pytest.raises(InputError, match=r"data.time: got 1e\+09 s after 0 s, 10000000000 readings at 10 Hz"):
        schedule.due(1e9)
    assert schedule.due(1e9) == [1e9]


@pytest.mark.parametrize("dtype", [wp.vec3, wp.vec3d])
def test_bad_rays_on_the_device_give_nan_and_leave_the_others_alone(dtype: Any) -> None:
    origins = np.zeros((10, 3))
    directions = np.tile([1.0, 0, 0], (10, 1))
    directions[[1, 2, 3]] = [NAN, 0, 0], [0, -INF, 1], [0, 0, 0]
    origins[[5, 6, 7, 8], 2] = NAN, INF, 1e30, -1.1e18
    got = ROW.cast(on_device(origins, dtype), on_device(directions, dtype)).numpy()
    good = [0, 4, 9]
    assert np.isnan(np.delete(got.distance, good)).all()
    assert (np.delete(got.geom_id, good) == -1).all()
    assert (got.distance[good] == np.float32(0.9)).all()
    assert (got.geom_id[good] == 0).all()


def test_nothing_to_hit_and_nothing_to_sense_with() -> None:
    empty = model_of("")
    assert (ready(empty).cast((0, 0, 0), np.eye(3)).numpy().distance == INF).all()
    assert (Rig(empty, [LIDAR]).sense(posed(empty))["top"].range.numpy() == INF).all()
    bare = Rig(ROW.model, [])
    assert bare.sense(DATA) == {}
    assert list(bare.step(DATA)) == []


@pytest.mark.parametrize(
    ("size", "reached"), [((0, 0, 0), True), ((1, 0, 0), True), ((0, 1, 0), False), ((1, 1, 0), False)]
)
def test_a_plane_of_size_zero_along_an_axis_has_no_end_there(size: tuple[float, ...], reached: bool) -> None:
    model = model_of('<geom type="plane" size="1 1 1"/>')
    model.geom_size[0] = size
    got = ready(model).cast((0.5, 1e4, 5), (0, 0, -1)).numpy()
    assert np.isfinite(got.distance) == reached


EXPLODING = """
<mujoco>
  <option timestep="0.01"><flag autoreset="disable"/></option>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="robot" pos="0 0 1"><freejoint/><geom name="hull" type="box" size="0.2 0.2 0.1" mass="1"/>
      <body pos="0.3 0 0"><joint name="elbow" axis="0 1 0"/>
        <geom name="arm" type="capsule" fromto="0 0 0 0.3 0 0" size="0.05" mass="0.001"/></body></body>
    <body name="ball" pos="2 0 1"><freejoint/><geom name="ball" size="0.3"/></body>
  </worldbody>
  <actuator><motor name="motor" joint="elbow" gear="1e30"/></actuator>
</mujoco>"""


def test_a_diverged_simulation_passes_without_a_trace() -> None:
    model = mujoco.MjModel.from_xml_string(EXPLODING)
    optics: dict[str, Any] = {"elevation_deg": [-30, 0, 5], "columns": 60}
    sensors = [
        Lidar(name="carried", mount=Mount(body="robot", pos=(0, 0, 0.5)), **optics),
        Lidar(name="fixed", mount=Mount(pos=(0.5, 0, 0.8)), **optics),
    ]
    used = Rig(model, sensors)
    data, good = mujoco.MjData(model), mujoco.MjData(model)
    data.ctrl[0] = 1e9
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(20):
            mujoco.mj_step(model, data)
            used.sense(data)
    assert np.isnan(data.qpos[:3]).all(), "the simulation did not diverge"
    lost = [str(w.message) for w in caught if w.category is RuntimeWarning]
    assert sorted(", ".join(text.partition("not hit: ")[2] for text in lost).split(", ")) == ["arm", "ball", "hull"]
    assert {w.filename for w in caught} == {__file__}
    frames = used.sense(data)
    assert np.isnan(frames["carried"].pose[:3]).all()
    for field in ("range", "points", "points_world"):
        assert np.isnan(getattr(frames["carried"], field).numpy()).all(), field
    assert (frames["carried"].geom_id.numpy() == -1).all()
    assert set(np.unique(frames["fixed"].geom_id.numpy())) == {-1, 0}
    for name, frame in used.sense(good).items():
        fresh = Rig(model, sensors).sense(good)[name]
        np.testing.assert_array_equal(frame.pose, fresh.pose, err_msg=name)
        for field in ("range", "points", "points_world", "normal", "geom_id"):
            got, expected = (getattr(f, field).numpy() for f in (frame, fresh))
            np.testing.assert_array_equal(got, expected, err_msg=f"{name}.{field}")
        assert np.isfinite(frame.range.numpy()).any()
