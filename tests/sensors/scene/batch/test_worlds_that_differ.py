"""Worlds that differ in more than poses: each has the readings of that world alone."""

from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from world_states import COUNT, SENSORS, alone, arrays_of, assert_same, model, rig_of, state_of, states

from rigcast import Filter, InputError, Mount, Rig, Scene, Worlds


def test_sizes_may_differ(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    scales = [1.0, 0.5, 2.0, 1.5]
    sizes = np.array([robot.geom_size * scale for scale in scales])
    rig = rig_of(robot, "lidar", "weather")
    frames = rig.sense(Worlds(datas, geom_size=sizes))
    for world, (data, scale) in enumerate(zip(datas, scales, strict=True)):
        other = model()
        other.geom_size[:] *= scale
        for name, frame in alone(other, data, world, "lidar", "weather").items():
            assert_same(frames[name].world(world), frame, f"world {world}, sizes times {scale}")
    # and are those of the model again for worlds without sizes of their own
    again = rig_of(robot, "lidar").sense(datas)["lidar"]
    assert_same(rig.sense(datas, ["lidar"])["lidar"], again, "sizes of the model")
    np.testing.assert_array_equal(rig.sense(datas[1], ["lidar"])["lidar"].range.numpy(), again.range.numpy()[1])


def test_meshes_and_height_fields_may_differ_or_be_absent() -> None:
    robot = model()
    tent, cube = robot.mesh("tent").id, robot.mesh("cube").id  # no geom of the model has the cube
    datas = states(robot, 3)
    geom, hill = robot.geom("tent").id, robot.geom("hill").id
    dataid = np.tile(robot.geom_dataid, (3, 1))
    dataid[:, geom] = [tent, cube, -1]
    dataid[2, hill] = -1
    frames = rig_of(robot, "lidar").sense(Worlds(datas, geom_dataid=wp.array(dataid, dtype=int, device="cpu")))
    for world in range(3):
        other = model()
        other.geom_dataid[geom] = dataid[world, geom] if world < 2 else tent
        if world == 2:
            other.geom_rgba[[geom, hill], 3] = 0  # never hit
        frame = alone(other, datas[world], world, "lidar")["lidar"]
        assert_same(frames["lidar"].world(world), frame, f"world {world}")
    assert (frames["lidar"].geom_id.numpy()[1] == geom).any()


def test_what_is_edited_as_another_height_field_comes_in_is_seen_and_refused_until_it_is_mended() -> None:
    fields = "".join(f'<hfield name="{name}" nrow="3" ncol="3" size="2 2 1 .1"/>' for name in "ab")
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset>{fields}</asset><worldbody><geom type="hfield" hfield="a"/></worldbody></mujoco>'
    )
    data, scene = [mujoco.MjData(model) for _ in range(2)], Scene(model, "cpu")
    for each in data:
        mujoco.mj_kinematics(model, each)
    scene.update(data)
    both = Worlds(data, geom_dataid=np.array([[0], [1]], np.int32))
    model.hfield_data[:9], model.hfield_data[9:] = 0.25, np.nan
    for _ in range(2):
        with pytest.raises(InputError, match=r"hfield 'b': row 0, column 0: got .*nan"):
            scene.update(both)
        with pytest.raises(InputError, match="the last update failed"):
            scene.cast((0, 0, 3), [[(0, 0, -1)]] * 2)
    model.hfield_data[9:] = 0.5
    scene.update(both)
    assert scene.cast((0.1, 0.2, 3), [[(0, 0, -1)]] * 2).numpy().distance.ravel().tolist() == [2.75, 2.5]


def test_geoms_may_be_there_in_some_worlds_only(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    visible = np.random.default_rng(5).random((COUNT, robot.ngeom)) < 0.6
    rig = rig_of(robot, "lidar", "weather")
    frames = rig.sense(Worlds(datas, visible=visible))
    for world, data in enumerate(datas):
        other = model()
        other.geom_matid[~visible[world]] = -1
        other.geom_rgba[~visible[world], 3] = 0  # never hit
        for name, frame in alone(other, data, world, "lidar", "weather").items():
            assert_same(frames[name].world(world), frame, f"seed 5, world {world}")
    assert_same(
        rig.sense(datas, ["lidar"])["lidar"], rig_of(robot, "lidar").sense(datas)["lidar"], "all are there again"
    )


def with_own(robot: mujoco.MjModel, data: mujoco.MjData, world: int, name: str, **own: Any) -> Any:
    """The frame of a sensor alone in a world, with another mount or filter."""
    sensor = SENSORS[name].model_copy(update=own)
    worlds = Worlds([state_of(robot, data)], ids=[world])
    return Rig(robot, [sensor], "cpu", seed=5).sense(worlds)[name].world(0)


FILTERS = [
    Filter(exclude_bodies=["robot"]),
    Filter(static=False),
    Filter(exclude_bodies=["robot", "ball"], exclude_subtree=True),
    Filter(exclude_bodies=["robot"]),
]


@pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")
def test_filters_may_differ(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    chosen = {"lidar": FILTERS, "stereo": FILTERS[::-1], "weather": tuple(FILTERS)}
    for visible in (None, np.random.default_rng(3).random((COUNT, robot.ngeom)) < 0.7):
        rig = rig_of(robot, "lidar", "stereo", "weather", "scan")
        frames = rig.sense(Worlds(datas, filters=chosen, visible=visible))
        for world, data in enumerate(datas):
            other = model()
            if visible is not None:
                other.geom_matid[~visible[world]] = -1
                other.geom_rgba[~visible[world], 3] = 0  # never hit
            for name, filters in chosen.items():
                expected = with_own(other, data, world, name, filter=filters[world])
                assert_same(frames[name].world(world), expected, f"world {world}")
    assert_same(rig.sense(datas, ["lidar"])["lidar"], rig_of(robot, "lidar").sense(datas)["lidar"], "its own again")


MOUNTS: dict[str, list[Mount]] = {
    "lidar": [Mount(body=name, pos=(0.1, 0, 0.4), euler_deg=(k, 5, 0)) for k, name in enumerate(("robot", "can") * 2)],
    "scan": [Mount(body="tent", pos=(0.1 * k, 0, 1)) for k in range(COUNT)],
    "noisy": [Mount(site="nose", quat=(1, 0.1 * k, 0, 0)) for k in range(COUNT)],
    "camera": [Mount(camera="eye", pos=(0, 0.1 * k, 0), euler_deg=(0, 0, k)) for k in range(COUNT)],
    "rolling": [Mount(body="robot", pos=(0, 0.1 * k, 0)) for k in range(COUNT)],
    "fixed": [Mount(pos=(0, k, 3)) for k in range(COUNT)],
}


@pytest.mark.filterwarnings("ignore:sensor '.*' is within geom")
@pytest.mark.parametrize("device", [False, True])
def test_mounts_may_differ(robot: mujoco.MjModel, datas: list[mujoco.MjData], device: bool) -> None:
    batch: Any = datas
    if device:
        kinds = {"pos": wp.vec3d, "mat": wp.mat33d}
        batch = {
            name: wp.array(values.reshape(*values.shape[:2], *kinds[name[-3:]]._shape_), kinds[name[-3:]], device="cpu")
            for name, values in arrays_of(datas).items()
            if name != "time"
        } | {"time": np.array([data.time for data in datas])}
    worlds = Worlds(batch, mounts=MOUNTS)
    for _ in range(2):  # two rigs of the same worlds
        frames = rig_of(robot, *MOUNTS).sense(worlds)
        for name, mounts in MOUNTS.items():
            for world, data in enumerate(datas):
                expected = with_own(robot, data, world, name, mount=mounts[world])
                assert_same(frames[name].world(world), expected, f"world {world}")


def test_a_cast_takes_a_filter_for_each_world(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    scene, directions = Scene(robot, "cpu"), np.random.default_rng(2).normal(size=(COUNT, 60, 3))
    scene.update(datas)
    hits = scene.cast((0, 0, 2), directions, filter=FILTERS).numpy()
    for world, data in enumerate(datas):
        scene.update(data)
        expected = scene.cast((0, 0, 2), directions[world], filter=FILTERS[world]).numpy()
        np.testing.assert_array_equal(hits.geom_id[world], expected.geom_id, err_msg=f"world {world}")
        np.testing.assert_array_equal(hits.distance[world], expected.distance, err_msg=f"world {world}")
    with pytest.raises(InputError, match="filter: got list, expected Filter"):
        scene.cast((0, 0, 2), directions, filter=FILTERS)


def test_filters_that_are_new_each_time_take_no_more_memory(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    rig, rng = rig_of(robot, "lidar"), np.random.default_rng(0)
    for _ in range(200):
        filters = [Filter(geom_groups=np.flatnonzero(chosen).tolist()) for chosen in rng.random((COUNT, 6)) < 0.5]
        rig.sense(Worlds(datas, filters={"lidar": filters}))
    assert len(rig.scene._sight._visible) < 100


def test_a_mujoco_batch_brings_its_meshes(robot: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    module = pytest.importorskip("mujoco.batch", reason="from MuJoCo 4.0 on")
    batch = module.Batch(robot, COUNT)
    batch.qpos = np.array([d.qpos for d in datas])
    for name in ("geom_xpos", "geom_xmat", "xpos", "xmat"):
        batch.bind(name)
    batch.forward()
    dataid = np.tile(robot.geom_dataid, (COUNT, 1))
    dataid[1, robot.geom("tent").id] = robot.mesh("cube").id
    batch.expand("geom_dataid")[...] = dataid
    expected = rig_of(robot, "lidar").sense(Worlds(datas, geom_dataid=dataid))["lidar"]
    np.testing.assert_array_equal(rig_of(robot, "lidar").sense(batch)["lidar"].range.numpy(), expected.range.numpy())


OPTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "too few active": ({"active": [True] * 3}, r"active: got shape \(3,\), expected \(4,\): one per world"),
    "numbers for active": ({"active": [0.5] * 4}, "active: got an array of float64, expected bool"),
    "one id for all": ({"ids": [7]}, r"ids: got shape \(1,\), expected \(4,\): one per world"),
    "negative ids": ({"ids": [0, 1, -2, 3]}, "ids: world 2: got -2, expected whole numbers from 0 to 2"),
    "sizes of other geoms": (
        {"geom_size": np.ones((4, 2, 3))},
        r"geom_size: got shape \(4, 2, 3\), expected \(4, 8, 3\)",
    ),
    "visible of other geoms": ({"visible": np.ones((4, 2), bool)}, r"visible: got shape \(4, 2\), expected \(4, 8\)"),
    "a size of NaN": (
        {"geom_size": np.full((4, 8, 3), np.nan)},
        "geom_size: world 0, geom 0: got .*nan.*, expected 0 to 1e",
    ),
    "a size below 0": (
        {"geom_size": np.full((4, 8, 3), -1.0)},
        r"geom_size: world 0, geom 0: got \[-1.0, -1.0, -1.0\], expected 0 to 1e",
    ),
    "active of two axes": (
        {"active": np.ones((4, 2), bool)},
        r"active: got shape \(4, 2\), expected \(4,\): one per world",
    ),
    "ids of two axes": ({"ids": np.ones((4, 1), int)}, r"ids: got shape \(4, 1\), expected \(4,\): one per world"),
    "a mesh there is not": (
        {"geom_dataid": np.full((4, 8), 7)},
        "geom_dataid: world 0, geom 1: got 7, expected a mesh or height field of the model, or -1",
    ),
    "filters of no sensor": ({"filters": FILTERS}, "filters: got list, expected Mapping"),
    "one filter": (
        {"filters": {"fixed": Filter()}},
        "filters: 'fixed': got Filter, expected a list of Filter, one per",
    ),
    "too few filters": ({"filters": {"fixed": FILTERS[:3]}}, "filters: 'fixed': got 3, expected 4: one per world"),
    "no filter": ({"filters": {"fixed": [Filter()] * 3 + [None]}}, "'fixed': world 3: got NoneType, expected Filter"),
    "another sensor": ({"filters": {"fixd": FILTERS}}, "filters: no sensor 'fixd', .*did you mean 'fixed'"),
    "another body": (
        {"filters": {"fixed": [Filter()] * 2 + [Filter(exclude_bodies=["bal"])] * 2}},
        r"filters: 'fixed': world 2: exclude_bodies\[0\]: no body 'bal' in the model, .*did you mean 'ball'",
    ),
    "mounts of several kinds": (
        {"mounts": {"fixed": [Mount(body="can")] * 3 + [Mount(site="nose")]}},
        "mounts: 'fixed': world 3: got one on a site, expected one on a body, as in world 0",
    ),
    "a mount on another site": (
        {"mounts": {"fixed": [Mount(site="nos")] * 4}},
        "mounts: 'fixed': world 0: site: no site 'nos' in the model",
    ),
}


@pytest.mark.parametrize(("options", "message"), OPTIONS.values(), ids=list(OPTIONS))
def test_what_does_not_fit_the_worlds_is_refused(
    robot: mujoco.MjModel, datas: list[mujoco.MjData], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        rig_of(robot, "fixed").sense(Worlds(datas, **options))
