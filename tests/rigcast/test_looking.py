"""A frame shows itself in a notebook, in matplotlib and in MuJoCo's viewer."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image

import rigcast
from rigcast.sensors.extras import load_extra

SCENE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="9 9 1"/>
    <geom name="wall" type="box" pos="4 0 1" size="0.1 3 1"/>
  </worldbody>
</mujoco>
"""
MOUNT = rigcast.Mount(pos=(0, 0, 1))
SENSORS: list[rigcast.Lidar | rigcast.DepthCamera | rigcast.HeightScan] = [
    rigcast.Lidar(name="top", mount=MOUNT, elevation_deg=[-20, 0, 20], columns=36),
    rigcast.Lidar(name="dual", mount=MOUNT, elevation_deg=[-20, 0, 20], columns=36, returns="dual"),
    rigcast.Lidar(name="rosette", mount=MOUNT, preset="livox_mid40"),
    rigcast.DepthCamera(name="front", mount=MOUNT, resolution=(8, 6), fov_y_deg=50),
    rigcast.DepthCamera(
        name="fisheye", mount=MOUNT, resolution=(9, 9), fx=2, fy=2, cx=4.5, cy=4.5, distortion=rigcast.KannalaBrandt()
    ),
    rigcast.HeightScan(name="feet", mount=MOUNT, size=(1, 1), spacing=0.25),
]


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


@pytest.fixture(scope="module")
def frames(model: mujoco.MjModel) -> dict[str, rigcast.Frame]:
    return rigcast.Rig(model, SENSORS, device="cpu").sense(mujoco.MjData(model))


@pytest.mark.parametrize("name", [sensor.name for sensor in SENSORS])
def test_a_notebook_shows_a_frame(frames: dict[str, rigcast.Frame], name: str) -> None:
    with Image.open(io.BytesIO(frames[name]._repr_png_() or b"")) as picture:
        assert (picture.format, picture.width) == ("PNG", 1200)
        assert np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0).shape[0] > 20


@pytest.mark.parametrize(
    ("name", "label"),
    [
        *((name, "range [m]") for name in ("top", "dual", "rosette", "fisheye")),
        ("front", "depth [m]"),
        ("feet", "z [m]"),
    ],
)
def test_matplotlib_draws_a_frame(
    frames: dict[str, rigcast.Frame], name: str, label: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure, ax = pyplot.subplots()
    assert frames[name].plot(ax) is ax
    figure.canvas.draw()
    assert ax.get_title() == f"{name}, t = 0.000 s"
    assert label in [other.get_ylabel() for other in figure.axes]
    pyplot.close(figure)


def test_a_plot_of_a_field_is_refused(frames: dict[str, rigcast.Frame]) -> None:
    pytest.importorskip("matplotlib.pyplot")
    with pytest.raises(rigcast.InputError, match=r"^Frame\.plot: ax: got str, expected Axes"):
        frames["top"].plot("range")  # type: ignore[arg-type]


def test_the_plot_has_the_depths(frames: dict[str, rigcast.Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    front = frames["front"]
    assert isinstance(front, rigcast.CameraFrame)
    (image,) = front.plot().images
    np.testing.assert_array_equal(np.ma.filled(np.ma.asarray(image.get_array()), np.inf), front.depth.numpy())
    pyplot.close("all")


def test_a_missing_library_is_named_with_its_extra() -> None:
    with pytest.raises(rigcast.InputError, match=r"Looking needs nowhere, .* pip install 'rigcast\[look\]' brings it"):
        load_extra("Looking", "nowhere.at_all", "look")


class Viewer:
    """A stand-in for the handle of `mujoco.viewer.launch_passive`, which needs a screen."""

    def __init__(self, model: mujoco.MjModel, room: int) -> None:
        self.user_scn = mujoco.MjvScene(model, room)
        self.locked = 0

    @contextmanager
    def lock(self) -> Iterator[None]:
        self.locked += 1
        yield


def drawn(scene: mujoco.MjvScene) -> Any:
    return np.array([scene.geoms[k].pos for k in range(scene.ngeom)])


def test_the_points_are_drawn_where_they_are(model: mujoco.MjModel, frames: dict[str, rigcast.Frame]) -> None:
    viewer = Viewer(model, 10_000)
    points = frames["top"].points_world.numpy().reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    assert 0 < len(points) < 3 * 36
    for _ in range(2):  # the second takes the place of the first
        assert rigcast.overlay(viewer, frames["top"]) == len(points)
    np.testing.assert_allclose(drawn(viewer.user_scn), points, atol=1e-5)
    assert viewer.locked == 2
    assert rigcast.overlay(viewer, []) == viewer.user_scn.ngeom == 0


def test_near_points_are_warm(model: mujoco.MjModel, frames: dict[str, rigcast.Frame]) -> None:
    viewer = Viewer(model, 10_000)
    rigcast.overlay(viewer, frames.values())
    scene = viewer.user_scn
    distance = np.linalg.norm(drawn(scene) - [0, 0, 1], axis=1)
    red, _, blue = np.array([scene.geoms[k].rgba[:3] for k in range(scene.ngeom)]).T
    assert (red > blue)[distance.argmin()]
    assert (blue > red)[distance.argmax()]


@pytest.mark.parametrize(("room", "most", "expected"), [(10_000, 20, (10, 20)), (12, 5000, (6, 12)), (0, 9, (0, 0))])
def test_it_draws_as_many_as_there_is_room_for(
    model: mujoco.MjModel, frames: dict[str, rigcast.Frame], room: int, most: int, expected: tuple[int, int]
) -> None:
    viewer = Viewer(model, room)
    count = rigcast.overlay(viewer, frames["top"], most=most)
    assert expected[0] <= count == viewer.user_scn.ngeom <= expected[1]


def test_a_scene_of_ones_own_keeps_what_was_drawn_before(
    model: mujoco.MjModel, frames: dict[str, rigcast.Frame]
) -> None:
    scene = mujoco.MjvScene(model, 1000)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), everything, scene)
    before = scene.ngeom
    assert rigcast.overlay(scene, frames["feet"]) == 25
    assert scene.ngeom == before + 25
    np.testing.assert_allclose(drawn(scene)[before:, 2], 0, atol=1e-6)
    rigcast.overlay(scene, frames["feet"])
    assert scene.ngeom == before + 50


@pytest.mark.parametrize("viewer", [None, "viewer", object()])
def test_what_is_no_viewer_is_refused(frames: dict[str, rigcast.Frame], viewer: object) -> None:
    with pytest.raises(rigcast.InputError, match=r"overlay: viewer: got .* expected the viewer of"):
        rigcast.overlay(viewer, frames["top"])


def test_what_is_no_frame_is_refused(model: mujoco.MjModel) -> None:
    with pytest.raises(rigcast.InputError, match="overlay: frames: got str, expected Frame"):
        rigcast.overlay(Viewer(model, 9), ["top"])  # type: ignore[list-item]


@pytest.mark.parametrize("size", [0.0, -0.01, np.nan, np.inf])
def test_points_without_a_size_are_refused(
    model: mujoco.MjModel, frames: dict[str, rigcast.Frame], size: float
) -> None:
    with pytest.raises(rigcast.InputError, match=r"overlay: size: got .*, expected a positive number of metres"):
        rigcast.overlay(Viewer(model, 9), frames["top"], size=size)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"size": "1 cm"}, "overlay: size: got str, expected Real"),
        ({"most": -1}, "overlay: most: got -1, expected a whole number from 0 on"),
        ({"most": 9.5}, "overlay: most: got 9.5, expected a whole number from 0 on"),
    ],
)
def test_numbers_of_another_kind_are_refused(
    model: mujoco.MjModel, frames: dict[str, rigcast.Frame], how: dict[str, Any], message: str
) -> None:
    with pytest.raises(rigcast.InputError, match=message):
        rigcast.overlay(Viewer(model, 9), frames["top"], **how)


def test_frames_of_many_worlds_are_not_drawn_over_each_other(model: mujoco.MjModel) -> None:
    lidar = rigcast.Lidar(name="top", mount=rigcast.Mount(pos=(0, 0, 1)), elevation_deg=[-20], columns=8)
    worlds = [mujoco.MjData(model) for _ in range(2)]
    for data in worlds:
        mujoco.mj_forward(model, data)
    frame = rigcast.Rig(model, [lidar], device="cpu").sense(worlds)["top"]
    with pytest.raises(rigcast.InputError, match=r"got a frame of 2 worlds, expected one of one world"):
        rigcast.overlay(Viewer(model, 99), frame)
    assert rigcast.overlay(Viewer(model, 99), frame.world(1)) == 8
