"""A rig sees the world at data.time, gives each frame out once, and leaves the user's data alone."""

import copy
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from rigcast import DepthCamera, Filter, Frame, HeightScan, InputError, Lidar, Mount, Prop, Rig, Scene

pytestmark = pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")

TIMESTEP = 0.0037
XML = f"""
<mujoco>
  <option timestep="{TIMESTEP}"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="wall" type="box" size="0.1 4 2" pos="6 0 2"/>
    <site name="mast" pos="-2 0 1"/>
    <camera name="watcher" pos="-3 1 2" mode="targetbodycom" target="robot"/>
    <body name="target" mocap="true" pos="3 2 1"><geom name="target" type="capsule" size="0.3 0.5"/></body>
    <body name="robot" pos="0 0 1">
      <freejoint/>
      <geom name="chassis" type="box" size="0.3 0.2 0.1" mass="1"/>
      <site name="nose" pos="0.3 0 0.1" euler="0 20 0"/>
      <body name="head" pos="0 0 0.3">
        <joint name="pan" axis="0 0 1"/>
        <geom name="head" size="0.1" mass="0.1"/>
        <camera name="eye" pos="0.15 0 0" xyaxes="0 -1 0 0.3 0 1"/>
        <camera name="tracker" mode="targetbody" target="target"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
Sensor = Lidar | DepthCamera | HeightScan
SENSORS: tuple[Sensor, ...] = (
    Lidar(name="top", mount=Mount(body="head", pos=(0, 0, 0.3)), elevation_deg=[-20, 0, 10], columns=16, rate_hz=10),
    Lidar(name="fixed", mount=Mount(site="mast"), elevation_deg=[-5, 0], columns=32),
    DepthCamera(name="eye", mount=Mount(camera="eye"), resolution=(8, 6), rate_hz=30),
    DepthCamera(name="tracker", mount=Mount(camera="tracker"), resolution=(5, 5), fov_y_deg=30.0, rate_hz=100 / 3),
    DepthCamera(name="nose", mount=Mount(site="nose"), resolution=(6, 4), fov_y_deg=60.0, rate_hz=250.0),
    DepthCamera(name="watcher", mount=Mount(camera="watcher"), resolution=(7, 5), rate_hz=10),
    HeightScan(name="feet", mount=Mount(body="robot"), size=(1.0, 0.5), spacing=0.25, rate_hz=50, max_range=5.0),
)
NAMES = tuple(sensor.name for sensor in SENSORS)
FIELDS = ("range", "points", "points_world", "normal", "geom_id", "body_id", "stamp")


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def moving(model: mujoco.MjModel, steps: int = 20) -> mujoco.MjData:
    """A state in which everything moves and geom_xpos lags qpos, as mj_step leaves it."""
    data = mujoco.MjData(model)
    data.qpos[:] += np.random.default_rng(1).normal(scale=0.1, size=model.nq)
    data.qvel[:] = [2, -1, 3, 1, -2, 3, 5]
    for _ in range(steps):
        data.mocap_pos[0, 1] -= 0.01
        mujoco.mj_step(model, data)
    return data


def assert_same(got: Frame, expected: Frame, what: str = "") -> None:
    """Assert that two frames are the same, bit for bit."""
    assert (got.sensor, got.time) == (expected.sensor, expected.time), what
    np.testing.assert_array_equal(got.pose, expected.pose, err_msg=f"{what} pose")
    for field in FIELDS:
        values = [np.atleast_1d(getattr(frame, field).numpy()) for frame in (got, expected)]
        np.testing.assert_array_equal(values[0].view(np.uint8), values[1].view(np.uint8), err_msg=f"{what} {field}")


def test_sense_sees_the_world_at_data_time(model: mujoco.MjModel) -> None:
    data = moving(model)
    now = copy.copy(data)
    mujoco.mj_forward(model, now)
    assert np.abs(now.geom_xpos - data.geom_xpos).max() > 0.005, "poses must lag for this test to show anything"
    rig, scene = Rig(model, SENSORS), Scene(model)
    scene.update(now)
    for (name, frame), spec in zip(rig.sense(data).items(), SENSORS, strict=True):
        pattern = spec.pattern(model)
        assert frame.time == data.time
        mount = spec.mount.bind(model).pose(now)
        np.testing.assert_allclose(frame.pose[:3, 3], mount[:3, 3], atol=1e-12)
        if spec.frame_alignment == "base":
            np.testing.assert_allclose(frame.pose[:3, :3], mount[:3, :3] @ spec.frame_rotation, atol=1e-12)
        origins = np.broadcast_to(0.0 if pattern.origins is None else pattern.origins, pattern.directions.shape)
        rotation, position = frame.pose[:3, :3], frame.pose[:3, 3]
        hits = scene.cast(origins @ rotation.T + position, pattern.directions @ rotation.T, spec.max_range).numpy()
        np.testing.assert_array_equal(frame.geom_id.numpy(), hits.geom_id, err_msg=name)
        np.testing.assert_allclose(frame.range.numpy(), hits.distance, rtol=1e-5, err_msg=name)


def test_a_mocap_body_that_the_user_moved_is_seen_where_it_is_now(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    lidar = Lidar(name="l", mount=Mount(pos=(0, 2, 1)), elevation_deg=[0], columns=1)
    rig = Rig(model, [lidar])
    for x in (3.0, 4.0, 2.0):
        data.mocap_pos[0, 0] = x
        assert rig.sense(data)["l"].range.numpy().item() == pytest.approx(x - 0.3, abs=1e-6)


# what a user reads or a step starts from; of workspace, older MuJoCos show memory that nothing has written
STATE = (
    r"q(pos|vel|acc|acc_warmstart)|act|ctrl|mocap_.*|userdata|sensordata|xfrc_applied|eq_active"
    r"|x(pos|quat|mat|ipos|imat)|(geom|site|cam|light|subtree)_[a-z]+"
)


def arrays(data: mujoco.MjData) -> dict[str, np.ndarray]:
    values = {name: getattr(data, name) for name in dir(data) if re.fullmatch(STATE, name)}
    return {name: value.copy() for name, value in values.items() if isinstance(value, np.ndarray)}


def test_an_edited_model_whose_bodies_may_sleep_is_seen_as_it_is() -> None:
    """MuJoCo does not update sleeping bodies and all that cannot move, so a rig must."""
    may_sleep = (
        '<worldbody><body name="still" pos="1 1 0" sleep="init"><freejoint/><geom size="0.2" pos="0 0 0.3"/></body>'
    )
    xml = XML.replace("<worldbody>", '<option><flag sleep="enable"/></option>' + may_sleep)
    model = mujoco.MjModel.from_xml_string(xml)
    scan = HeightScan(name="scan", mount=Mount(site="mast"), size=(12, 2), spacing=0.25)
    data, rig = mujoco.MjData(model), Rig(model, [scan])
    rig.sense(data)
    model.geom("wall").pos[0] = 2.0
    model.geom_pos[model.body("still").geomadr[0], 2] = 0.6
    model.site("mast").pos[2] = 2.5
    got, expected = (each.sense(data)["scan"].range.numpy() for each in (rig, Rig(model, [scan])))
    np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("call", [Rig.sense, Rig.step, Rig.rays, Rig.cast], ids=lambda call: call.__name__)
def test_the_users_data_is_only_read(model: mujoco.MjModel, call: Callable[[Rig, mujoco.MjData], Any]) -> None:
    data = moving(model)
    before, time, contacts = arrays(data), data.time, data.ncon
    assert {"qpos", "qvel", "mocap_pos", "geom_xpos", "cam_xmat", "site_xpos", "qacc_warmstart"} <= before.keys()
    assert len(list(call(Rig(model, SENSORS), data))) >= 2
    for name, values in arrays(data).items():
        np.testing.assert_array_equal(values, before[name], err_msg=name)
    assert (data.time, data.ncon) == (time, contacts)


@pytest.mark.parametrize("names", [None, [], ["eye"], ["feet", "top"], NAMES, NAMES[::-1]], ids=str)
def test_only_the_named_sensors_are_read(model: mujoco.MjModel, names: list[str] | None) -> None:
    data, rig = moving(model), Rig(model, SENSORS)
    expected = NAMES if names is None else tuple(names)
    assert tuple(rig.sense(data, names)) == expected
    assert tuple(rig.rays(data, names)) == expected
    assert tuple(rig.cast(data, names)) == expected
    assert all(frame.sensor == name for name, frame in rig.sense(data, names).items())


@pytest.mark.parametrize("call", [Rig.sense, Rig.rays, Rig.cast], ids=lambda call: call.__name__)
def test_an_unknown_name_is_refused_with_the_nearest(model: mujoco.MjModel, call: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match=r"no sensor 'noze', expected one of top, fixed, .*; did you mean 'nose'\?"):
        call(Rig(model, SENSORS), mujoco.MjData(model), ["top", "noze"])


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        pytest.param([SENSORS[0], SENSORS[1], SENSORS[0]], "names must differ, got 'top' more than once", id="names"),
        pytest.param(
            [Lidar(name="l", mount=Mount(body="rabot"), elevation_deg=[0], columns=1)],
            r"sensor 'l': mount\.body: no body 'rabot' in the model, .*did you mean 'robot'\?",
            id="mount",
        ),
        pytest.param(
            [HeightScan(name="h", mount=Mount(), size=(1, 1), spacing=1, filter=Filter(exclude_bodies=["hed"]))],
            r"sensor 'h': filter\.exclude_bodies\[0\]: no body 'hed' in the model, .*did you mean 'head'\?",
            id="filter",
        ),
        pytest.param(
            [DepthCamera(name="c", mount=Mount(camera="eye"))], "sensor 'c': .*resolution required", id="resolution"
        ),
        pytest.param(
            [Lidar(name=name, mount=Mount(site=name), elevation_deg=[0], columns=1) for name in "ab"],
            r"sensor 'a': mount\.site: no site 'a' .*\nsensor 'b': mount\.site: no site 'b'",
            id="all at once",
        ),
    ],
)
def test_sensors_that_do_not_fit_the_model_are_refused(
    model: mujoco.MjModel, sensors: list[Sensor], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Rig(model, sensors)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, r"Rig: seed: got -1, expected a whole number from 0 to 2\^63 - 1"),
        ({"seed": 2**63}, "Rig: seed: got 9223372036854775808"),
        ({"seed": True}, "Rig: seed: got True"),
        ({"seed": "7"}, "Rig: seed: got '7'"),
        ({"props": Prop(name="p", file=Path("p.stl"))}, "props: got Prop, expected a list of props"),
        ({"props": ["p.stl"]}, r"props\[0\]: got str, expected Prop"),
        ({"props": 3}, "props: got int, expected a list of props"),
    ],
)
def test_bad_options_are_refused(model: mujoco.MjModel, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Rig(model, SENSORS, **options)


@pytest.mark.parametrize("call", [Rig.sense, Rig.step, Rig.rays, Rig.cast], ids=lambda call: call.__name__)
def test_data_of_another_model_is_refused(model: mujoco.MjModel, call: Callable[[Rig, mujoco.MjData], Any]) -> None:
    other = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    other.time = 0.051  # when no sensor but those without a rate falls due
    with pytest.raises(InputError, match="data belongs to another model than the rig"):
        call(Rig(model, SENSORS[:1]), other)


def sense_worlds(rig: Rig, data: mujoco.MjData) -> object:
    mujoco.mj_forward(rig.model, data)
    return rig.sense([data])


@pytest.mark.parametrize(
    "call", [Rig.sense, Rig.step, Rig.rays, Rig.cast, sense_worlds], ids=lambda call: call.__name__
)
@pytest.mark.parametrize("field", ["cam_fovy", "cam_intrinsic", "cam_sensorsize"])
def test_optics_of_a_camera_that_were_edited_are_refused(call: Callable[[Rig, mujoco.MjData], Any], field: str) -> None:
    """The rig reads them once. Those of cameras that no sensor uses, or for which a sensor has its own, may change."""
    model = mujoco.MjModel.from_xml_string(XML)
    taken = DepthCamera(name="taken", mount=Mount(camera="eye"), resolution=(8, 6))
    own = DepthCamera(name="own", mount=Mount(camera="tracker"), resolution=(8, 6), fov_y_deg=40)
    rig, data = Rig(model, [taken, own]), mujoco.MjData(model)
    getattr(model, field)[[model.camera(name).id for name in ("tracker", "watcher")]] += 1
    call(rig, data)
    getattr(model, field)[model.camera("eye").id] += 1
    with pytest.raises(InputError, match="optics of camera 'eye' of the model have changed; make a new Rig"):
        call(rig, data)


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is CUDA")
def test_cuda_without_a_driver_is_one_error(model: mujoco.MjModel, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"^no device 'cuda', expected one of cpu$"):
        Rig(model, SENSORS, device="cuda")
    assert "CUDA error" not in capfd.readouterr().err


def test_out_is_written_over_and_time_and_pose_are_in_what_is_returned(model: mujoco.MjModel) -> None:
    rig, data = Rig(model, SENSORS[:1]), mujoco.MjData(model)
    (held,) = (frames := rig.sense(data)).values()
    data.time = 0.5
    (returned,) = rig.sense(data, out=frames).values()
    assert returned.range.ptr == held.range.ptr
    assert (held.time, returned.time) == (0.0, 0.5)


def test_what_holds_memory_of_a_device_says_what_to_pickle_in_its_place(model: mujoco.MjModel) -> None:
    rig = Rig(model, SENSORS[:1])
    with pytest.raises(TypeError, match="a Rig holds memory of its device: make one of its model and sensors in each"):
        pickle.dumps(rig)
    with pytest.raises(TypeError, match="a Scene holds memory of its device: make one of its model in each process"):
        pickle.dumps(rig.scene)
    (frame,) = rig.sense(mujoco.MjData(model)).values()
    with pytest.raises(TypeError, match=rf"a {type(frame).__name__} holds .* pickle arrays of it, such as range.numpy"):
        pickle.dumps(frame)


def test_unsupported_geometry_is_refused_or_left_out() -> None:
    asset = '<asset><mesh name="m" vertex="-1 -1 -1  1 -1 -1  0 1 -1  0 0 1"/></asset>'
    geom = '<worldbody><geom name="blob" type="sdf" mesh="m"/></worldbody>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{asset}{geom}</mujoco>")
    model.geom_dataid[0] = -1  # only a distance function, no mesh
    with pytest.raises(InputError, match="rays cannot hit sdf geom 'blob'"):
        Rig(model, SENSORS[:0])
    with pytest.warns(UserWarning, match="rays cannot hit sdf geom 'blob'") as caught:
        Rig(model, SENSORS[:0], on_unsupported="warn")
    assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.parametrize("order", [NAMES[::-1], ("feet",), ("eye", "top")], ids=str)
def test_a_frame_does_not_depend_on_the_other_sensors(model: mujoco.MjModel, order: tuple[str, ...]) -> None:
    by_name = {sensor.name: sensor for sensor in SENSORS}
    whole, part = Rig(model, SENSORS), Rig(model, [by_name[name] for name in order])
    data = mujoco.MjData(model)
    for _ in range(30):
        mujoco.mj_step(model, data)
        got = {(frame.sensor, frame.time): frame for frame in part.step(data)}
        expected = {(frame.sensor, frame.time): frame for frame in whole.step(data) if frame.sensor in order}
        assert got.keys() == expected.keys()
        for key, frame in got.items():
            assert_same(frame, expected[key], str(key))
    for name, frame in part.sense(data).items():
        assert_same(frame, whole.sense(data, [name])[name], name)
        assert np.isfinite(frame.range.numpy()).any(), f"{name} sees nothing"


def test_two_rigs_on_one_model_do_not_disturb_each_other(model: mujoco.MjModel) -> None:
    worlds = [moving(model, steps) for steps in (5, 40)]
    rigs = [Rig(model, SENSORS) for _ in worlds]
    first = [rig.sense(data) for rig, data in zip(rigs, worlds, strict=True)]
    again = [rig.sense(data) for rig, data in zip(rigs, worlds, strict=True)]
    for k, data in enumerate(worlds):
        alone = Rig(model, SENSORS).sense(data)
        for name in NAMES:
            assert_same(first[k][name], alone[name], f"world {k}")
            assert_same(again[k][name], alone[name], f"world {k}, again")
    assert not np.array_equal(first[0]["top"].range.numpy(), first[1]["top"].range.numpy())


def test_rays_and_cast_are_those_of_sense(model: mujoco.MjModel) -> None:
    data, rig = moving(model), Rig(model, SENSORS)
    rays, hits, frames = rig.rays(data), rig.cast(data), rig.sense(data)
    for spec in SENSORS:
        (origins, directions), frame, hit = rays[spec.name], frames[spec.name], hits[spec.name].numpy()
        shape = frame.shape
        assert origins.shape == directions.shape == (*shape, 3)
        assert origins.dtype == directions.dtype == np.float64
        assert hit.distance.shape == shape
        np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-12)
        kept = np.isfinite(frame.range.numpy())
        np.testing.assert_array_equal(kept, (hit.distance <= spec.max_range) & (hit.geom_id >= 0))
        np.testing.assert_array_equal(frame.range.numpy()[kept], hit.distance[kept])
        np.testing.assert_array_equal(frame.geom_id.numpy()[kept], hit.geom_id[kept])
        ends = origins + np.where(kept, hit.distance, 0)[..., None].astype(np.float64) * directions
        np.testing.assert_allclose(frame.points_world.numpy()[kept], ends[kept], rtol=0, atol=1e-12)
        again = rig.scene.cast(origins, directions).numpy()
        np.testing.assert_array_equal(again.geom_id, hit.geom_id)
        np.testing.assert_allclose(again.distance, hit.distance, rtol=1e-6)
        np.testing.assert_allclose(again.normal, hit.normal, atol=1e-6)


def test_each_sensor_has_its_own_filter(model: mujoco.MjModel) -> None:
    inside: dict[str, Any] = {"mount": Mount(body="robot"), "elevation_deg": [0], "columns": 1}
    filters = {
        "all": Filter(),
        "others": Filter(exclude_bodies=["robot"], exclude_subtree=True),
        "moving": Filter(exclude_bodies=["robot"], static=False),
    }
    rig = Rig(model, [Lidar(name=name, filter=filter_, **inside) for name, filter_ in filters.items()])
    data = mujoco.MjData(model)
    for frames in (rig.sense(data), {frame.sensor: frame for frame in rig.step(data)}):
        seen = {name: frame.geom_id.numpy().item() for name, frame in frames.items()}
        assert seen == {"all": model.geom("chassis").id, "others": model.geom("wall").id, "moving": -1}
