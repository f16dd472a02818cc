"""Imported cameras and rangefinders of a model have MuJoCo's readings."""

import mujoco
import numpy as np
import pytest

import rigcast

pytestmark = pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")

MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
    <camera name="over view" pos="0 0 5"/>
    <camera name="map" pos="0 0 5" projection="orthographic" resolution="8 6"/>
    <camera pos="0 0 5"/>
    <body name="cart" pos="0.3 -0.2 1.5" euler="10 20 30">
      <freejoint/>
      <geom size="0.2"/>
      <site name="down" euler="180 0 0"/>
      <site name="ahead" pos="0.1 0 0" euler="0 90 0"/>
      <site name="up"/>
      <camera name="eye" euler="0 -90 0" resolution="5 4" fovy="50"/>
      <camera name="finder" euler="0 -90 20" resolution="4 3"/>
      <body name="arm" pos="0 0 -0.4"><geom size="0.02"/></body>
    </body>
  </worldbody>
  <sensor>
    <rangefinder site="down"/>
    <rangefinder name="near" site="ahead" cutoff="0.5"/>
    <rangefinder name="far" site="ahead" cutoff="50"/>
    <rangefinder name="far:" site="up"/>
    CAMERA
  </sensor>
</mujoco>
"""
ON_CAMERA = '<rangefinder name="pixels" camera="finder" data="dist"/>'


def model_of(on_camera: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.replace("CAMERA", on_camera))


def with_camera_rangefinder() -> mujoco.MjModel:
    try:
        return model_of(ON_CAMERA)
    except ValueError:
        pytest.skip("this MuJoCo has no rangefinders on cameras")


def read_both(model: mujoco.MjModel) -> tuple[dict[str, rigcast.Frame], mujoco.MjData]:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return rigcast.Rig(model, rigcast.from_model(model), device="cpu").sense(data), data


def test_everything_with_a_name_is_imported_under_it() -> None:
    sensors = {sensor.name: sensor for sensor in rigcast.from_model(model_of())}
    assert list(sensors) == ["over_view", "eye", "finder", "down", "near", "far", "far_"]
    assert [sensors[name].type for name in ("eye", "down")] == ["depth_camera", "lidar"]


@pytest.mark.parametrize(("name", "reading"), [("down", "down"), ("far", "far"), ("far_", "far:")])
def test_a_rangefinder_reads_what_mujoco_reads(name: str, reading: str) -> None:
    model = model_of()
    frames, data = read_both(model)
    adr = 0 if reading == "down" else model.sensor(reading).adr[0]
    expected = data.sensordata[adr]
    assert frames[name].shape == (1, 1)
    assert frames[name].range.numpy().item() == pytest.approx(np.inf if expected < 0 else expected, abs=1e-5)


def test_down_sees_the_arm_but_not_its_own_body() -> None:
    model = model_of()
    frames, _ = read_both(model)
    assert model.body(frames["down"].body_id.numpy().item()).name == "arm"


def test_beyond_the_cutoff_there_is_no_return() -> None:
    frames, data = read_both(model_of())
    assert data.sensor("near").data == 0.5
    assert frames["near"].range.numpy().item() == np.inf


def test_a_rangefinder_on_a_camera_reads_what_mujoco_reads() -> None:
    model = with_camera_rangefinder()
    frames, data = read_both(model)
    expected = data.sensor("pixels").data.reshape(3, 4)
    np.testing.assert_allclose(frames["pixels"].range.numpy(), np.where(expected < 0, np.inf, expected), atol=1e-5)
    assert "finder" not in frames


def test_cameras_keep_their_resolution() -> None:
    frames, _ = read_both(model_of())
    assert (frames["eye"].shape, frames["over_view"].shape) == ((4, 5), (480, 640))
    small = {s.name: s for s in rigcast.from_model(model_of(), resolution=(32, 24))}["over_view"]
    assert isinstance(small, rigcast.DepthCamera)
    assert small.resolution == (32, 24)


def test_a_rangefinder_on_a_nameless_body_is_refused() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.replace('body name="cart"', "body").replace("CAMERA", ""))
    with pytest.raises(rigcast.InputError, match="rangefinder on site 'down' is on body 1, expected one with a name"):
        rigcast.from_model(model)


def test_a_path_is_no_model() -> None:
    with pytest.raises(rigcast.InputError, match="from_model: model: got str, expected MjModel"):
        rigcast.from_model("robot.xml")
