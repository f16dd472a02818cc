"""The arrays of frames: held arrays never change, arrays that nobody holds are reused, `out` is overwritten."""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import mujoco
import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from rigcast import DepthCamera, Filter, Frame, HeightScan, InputError, Lidar, LidarFrame, Mount, Noise, Rig
from rigcast.kernels.cast import Readings, launch, prepare_readings

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
  <geom type="plane" size="0 0 1" pos="0 0 -1"/>
  <body name="ball" mocap="true" pos="3 0 0"><geom size=".5"/></body>
  <body name="robot" mocap="true"><geom size=".1"/></body></worldbody></mujoco>""")
ON: dict[str, Any] = {"mount": Mount(body="robot"), "filter": Filter(exclude_bodies=("robot",))}
SENSORS = (
    Lidar(name="lidar", elevation_deg=[-30, -10, 0], columns=24, **ON),
    Lidar(name="noisy", elevation_deg=[-30, -10, 0], columns=24, noise=Noise(range_std=0.02), **ON),
    DepthCamera(name="camera", resolution=(9, 7), fov_y_deg=60.0, **ON),
    HeightScan(name="scan", size=(1.0, 1.0), spacing=0.25, **ON),
)
IDEAL = ("lidar", "camera", "scan")
FIELDS = ("range", "normal", "points", "points_world", "geom_id", "body_id")


def moved(by: float) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.time = by
    data.mocap_pos[0, 0] += by
    data.mocap_pos[1, 2] += 0.1 * by
    mujoco.mj_kinematics(MODEL, data)
    return data


def worlds(by: float) -> list[mujoco.MjData]:
    return [moved(by), moved(2 * by)]


def states_of(worlds: list[mujoco.MjData]) -> dict[str, NDArray[np.float64]]:
    names = ("geom_xpos", "geom_xmat", "xpos", "xmat")
    return {name: np.stack([getattr(data, name) for data in worlds]) for name in names}


def values(frame: Frame, *fields: str) -> dict[str, NDArray[Any]]:
    return {field: getattr(frame, field).numpy().copy() for field in fields or FIELDS}


def assert_same(got: dict[str, NDArray[Any]], expected: dict[str, NDArray[Any]], what: str) -> None:
    for field, array in expected.items():
        np.testing.assert_array_equal(got[field], array, err_msg=f"{what}: {field}")


@contextmanager
def counted_arrays(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[Any, ...]]]:
    """A list of the shapes of the Warp arrays that are made within the context."""
    made: list[tuple[Any, ...]] = []
    init = wp.array.__init__

    def counting(self: wp.array, *args: Any, **kwargs: Any) -> None:
        init(self, *args, **kwargs)
        made.append(self.shape)

    with monkeypatch.context() as patched:
        patched.setattr(wp.array, "__init__", counting)
        yield made


HELD: dict[str, Callable[[Frame], Any]] = {
    "frame": lambda frame: frame,
    "range": lambda frame: frame.range,
    "numpy": lambda frame: frame.range.numpy(),
    "asked by numpy": lambda frame: np.asarray(frame.range),
    "row": lambda frame: frame.range[1:],
    "part of numpy": lambda frame: frame.normal.numpy()[..., 2],
    "dlpack": lambda frame: np.from_dlpack(frame.normal),
    "points": lambda frame: frame.points,
    "ids": lambda frame: frame.geom_id.numpy(),
}


def seen(held: Any) -> NDArray[Any]:
    held = held.range if isinstance(held, Frame) else held
    return np.array(held.numpy() if isinstance(held, wp.array) else held)


@pytest.mark.parametrize("name", [spec.name for spec in SENSORS])
@pytest.mark.parametrize("what", HELD)
def test_what_is_held_never_changes(what: str, name: str) -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    for k in range(3):  # also into reused arrays
        held = HELD[what](rig.sense(moved(0.3 * k), [name])[name])
        before = seen(held)
        for by in (1.0, 1.3, 1.7):
            values(rig.sense(moved(by), [name])[name])
        np.testing.assert_array_equal(seen(held), before)


@pytest.mark.parametrize("what", ["range", "normal", "points", "time", "pose"])
def test_what_is_held_of_one_of_many_worlds_never_changes(what: str) -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    frame = rig.sense(worlds(0.2))["lidar"]
    held = getattr(frame, what) if what in ("time", "pose") else getattr(frame.world(1), what)
    del frame
    before = seen(held)
    for by in (1.0, 1.3, 1.7):
        values(rig.sense(worlds(by))["lidar"])
    np.testing.assert_array_equal(seen(held), before)


def test_arrays_that_nobody_holds_are_used_again(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    frames: dict[str, Frame] = {}
    # the last frames still exist while the next are made; the launches for reused arrays are prepared here
    for by in (0.0, 0.1, 0.2, 0.3):
        frames = rig.sense(moved(by), IDEAL)
        got = {name: values(frame) for name, frame in frames.items()}
    with counted_arrays(monkeypatch) as made:
        for by in (0.4, 0.5, 0.6):
            frames = rig.sense(moved(by), IDEAL)
            got = {name: values(frame) for name, frame in frames.items()}
    assert made == []
    fresh = Rig(MODEL, SENSORS, "cpu").sense(moved(0.6), IDEAL)
    for name, frame in fresh.items():
        assert_same(got[name], values(frame), name)


WORKED_OUT = ("points", "depth", "body_id")


def by_cast(rig: Rig, name: str) -> set[str]:
    """Names of the fields that the cast of a sensor's last reading wrote beside its hits."""
    return set(rig._mounted[name].pool._last[-1].fields.written)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("state", [moved, worlds], ids=["one world", "many worlds"])
def test_a_cast_writes_what_was_asked_of_the_reading_before(
    state: Callable[[float], Any], device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(MODEL, SENSORS, device)
    expected = values(Rig(MODEL, SENSORS, device).sense(state(0.5))["camera"], *WORKED_OUT)
    for asked in ((), ("depth",), WORKED_OUT, ()):
        values(rig.sense(state(0.2), ["camera"])["camera"], "range", *asked)
        values(rig.sense(state(0.4), ["camera"])["camera"], "range")
        assert by_cast(rig, "camera") == set(asked)
    values(rig.sense(state(0.3), ["camera"])["camera"], *WORKED_OUT)
    with monkeypatch.context() as patched:
        for work_out in ("points", "z_depth", "look_up"):
            patched.setattr(
                f"rigcast.kernels.hits.reading.{work_out}", lambda *_: pytest.fail("worked out after the cast")
            )
        got = values(rig.sense(state(0.5), ["camera"])["camera"], *WORKED_OUT)
    assert_same(got, expected, "camera")


def test_what_a_cast_wrote_is_held_and_written_over_as_what_was_worked_out_later() -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    for by in (0.1, 0.2, 0.3):
        frame = rig.sense(moved(by), ["camera"])["camera"]
        held = [getattr(frame, field) for field in WORKED_OUT]
        if by < 0.3:
            del frame, held
    assert by_cast(rig, "camera") == set(WORKED_OUT)
    again = rig.sense(moved(0.7), ["camera"], out={"camera": frame})["camera"]
    assert [getattr(again, field) for field in WORKED_OUT] == held
    assert by_cast(rig, "camera") == set(WORKED_OUT)
    expected = values(Rig(MODEL, SENSORS, "cpu").sense(moved(0.7))["camera"], *WORKED_OUT)
    del frame, again
    for by in (1.0, 1.3, 1.7):
        values(rig.sense(moved(by), ["camera"])["camera"], *WORKED_OUT)
        rig.sense(moved(by), ["camera"])
    assert_same(dict(zip(WORKED_OUT, map(seen, held), strict=True)), expected, "camera")


def test_frames_that_are_all_kept_are_those_of_other_rigs_and_share_launches(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, prepared = Rig(MODEL, SENSORS, "cpu"), list[object]()

    def counting(*args: Any) -> Any:
        prepared.append(args)
        return prepare_readings(*args)

    monkeypatch.setattr("rigcast.sensors.scene.stage.prepare_readings", counting)
    states = [*(moved(0.1 * k) for k in range(5)), worlds(0.6), worlds(0.7), [*worlds(0.8), moved(0.9)], moved(1.0)]
    held = [rig.sense(state, IDEAL) for state in states]
    assert len(prepared) == 4 * len(IDEAL)  # for one world, two, three, and one again
    for state, frames in zip(states, held, strict=True):
        for name, frame in Rig(MODEL, SENSORS, "cpu").sense(state, IDEAL).items():
            assert_same(values(frames[name]), values(frame), f"{name}, {frames[name].time}")


@pytest.mark.parametrize("state", [moved, worlds])
def test_sensors_without_errors_are_read_in_one_launch_as_each_is_alone(
    state: Callable[[float], mujoco.MjData | list[mujoco.MjData]], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, launched = Rig(MODEL, SENSORS, "cpu"), list[int]()

    def counting(readings: Collection[Readings]) -> object:
        launched.append(len(readings))
        return launch(readings)

    for by in (0.1, 0.2, 0.3):
        with monkeypatch.context() as patched:
            patched.setattr("rigcast.sensors.rig.reading.launch", counting)
            frames = rig.sense(state(by))
        for name in IDEAL:
            alone = Rig(MODEL, SENSORS, "cpu").sense(state(by), [name])[name]
            assert_same(values(frames[name]), values(alone), name)
    assert launched == [len(IDEAL)] * 3


def test_readings_of_many_worlds_use_arrays_again() -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    pointers = []
    for by in (0.1, 0.2, 0.3, 0.4):
        frames = rig.sense(worlds(by))
        pointers.append([[getattr(frame, f).ptr for f in ("range", "points", "pose")] for frame in frames.values()])
    assert pointers[2:] == pointers[:2]


def test_steps_make_no_arrays_once_frames_are_released(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(MODEL, [spec for spec in SENSORS if spec.name in IDEAL], "cpu")
    data = moved(0.0)
    with counted_arrays(monkeypatch) as made:
        for _ in range(6):
            counts = len(made)
            data.time += MODEL.opt.timestep
            assert len([frame.range.numpy() for frame in rig.step(data)]) == len(IDEAL)
    assert counts == len(made)


def test_held_frames_do_not_keep_later_ones_from_being_used_again(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    held = [rig.sense(moved(0.01 * k), ["lidar"])["lidar"].range for k in range(20)]
    before = [array.numpy().copy() for array in held]
    for by in (1.0, 1.1):  # the second of which prepares launches
        rig.sense(moved(by), ["lidar"])
    with counted_arrays(monkeypatch) as made:
        rig.sense(moved(1.2), ["lidar"])
    assert made == []
    np.testing.assert_array_equal([array.numpy() for array in held], before)


def test_arrays_for_as_many_worlds_as_before_count_as_free(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(MODEL, SENSORS[:1], "cpu")
    rig.sense(worlds(0.1))
    monkeypatch.setattr("rigcast.sensors.rig.capacity.free_memory", lambda _: 5_000)
    rig.sense(worlds(0.2))
    with pytest.raises(InputError, match="2 worlds need"):
        Rig(MODEL, SENSORS[:1], "cpu").sense(worlds(0.2))


def test_arrays_for_another_number_of_worlds_are_let_go() -> None:
    rig = Rig(MODEL, SENSORS[:1], "cpu")
    for count in (2, 3, 4, 5):
        rig.sense([moved(0.1)] * count)
    assert [arrays.shape[0] for arrays in rig._mounted["lidar"].pool._last] == [5]


@pytest.mark.parametrize("state", [moved, worlds], ids=["one world", "many worlds"])
def test_out_is_written_over(state: Callable[[float], Any]) -> None:
    rig, again = (Rig(MODEL, SENSORS, "cpu", seed=3) for _ in range(2))
    first = rig.sense(state(0.0))
    again.sense(state(0.0))
    held = {name: (frame.range, frame.points) for name, frame in first.items()}
    second, expected = rig.sense(state(0.7), out=first), again.sense(state(0.7))
    for name, frame in second.items():
        assert (frame.range, frame.points) == held[name]
        assert_same(values(frame), values(expected[name]), name)
        assert_same(values(first[name], "range", "points"), values(frame, "range", "points"), name)
        np.testing.assert_array_equal(seen(frame.time), seen(expected[name].time))
        np.testing.assert_array_equal(seen(frame.pose), seen(expected[name].pose))


def test_fields_that_were_asked_for_are_worked_out_again_after_a_reading_that_failed() -> None:
    rig = Rig(MODEL, SENSORS, "cpu")
    good = states_of(worlds(0.1)), states_of(worlds(0.7))
    frames = rig.sense(good[0])
    points = frames["lidar"].points
    for _ in range(2):
        with pytest.raises(InputError, match="xmat"):
            rig.sense(good[1] | {"xmat": good[1]["xmat"][:, :1]}, out=frames)
    rig.sense(good[1], out=frames)
    np.testing.assert_array_equal(points.numpy(), Rig(MODEL, SENSORS, "cpu").sense(good[1])["lidar"].points.numpy())


def test_fields_that_were_asked_for_are_worked_out_again_into_their_arrays() -> None:
    rig, again = (Rig(MODEL, SENSORS, "cpu", seed=3) for _ in range(2))
    first = rig.sense(moved(0.0))["noisy"]
    again.sense(moved(0.0))
    assert isinstance(first, LidarFrame)
    fields = ("points_world", "stamp", "intensity", "body_id")
    held = {field: getattr(first, field).numpy() for field in fields}  # views on the CPU
    rig.sense(moved(0.7), ["noisy"], out={"noisy": first})
    assert_same(held, values(again.sense(moved(0.7))["noisy"], *fields), "noisy")


@pytest.mark.parametrize("state", [moved, worlds], ids=["one world", "many worlds"])
def test_fields_that_are_held_are_worked_out_again_after_a_reading_that_failed(
    state: Callable[[float], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also those of sensors before and after the one that failed."""
    rig, again = (Rig(MODEL, SENSORS, "cpu", seed=3) for _ in range(2))
    first = rig.sense(state(0.0))
    held = {name: {field: getattr(frame, field) for field in FIELDS} for name, frame in first.items()}

    def failing(*_: Any) -> NoReturn:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr("rigcast.sensors.physics.lidar.LidarPhysics.read", failing)
        with pytest.raises(MemoryError):
            rig.sense(state(0.3), out=first)
    rig.sense(state(0.7), out=first)
    for by in (0.0, 0.3):
        again.sense(state(by))
    for name, frame in again.sense(state(0.7)).items():
        assert_same({field: array.numpy() for field, array in held[name].items()}, values(frame), name)


OUTS: dict[str, tuple[Callable[[dict[str, Frame]], Any], str]] = {
    "none": (lambda _: {}, "out: no frame of sensor 'lidar'"),
    "one of two": (lambda frames: {"lidar": frames["lidar"]}, "out: no frame of sensor 'camera'"),
    "a frame": (lambda frames: frames["lidar"], "out: got LidarFrame, expected Mapping"),
    "an array": (
        lambda frames: frames | {"camera": frames["camera"].range},
        "'camera': got (Host)?[aA]rray, expected Frame",
    ),
    "another sensor's": (
        lambda frames: frames | {"camera": frames["lidar"]},
        "out: sensor 'camera': got a frame of sensor 'lidar', expected one of its own",
    ),
    "of one of many worlds": (
        lambda frames: frames | {"camera": frames["camera in two worlds"].world(1)},
        "out: sensor 'camera': got a frame of one of many worlds, expected one of a reading of one world",
    ),
    "of many worlds": (
        lambda frames: frames | {"camera": frames["camera in two worlds"]},
        r"out: sensor 'camera': got a frame of shape \(2, 7, 9\) on cpu, expected \(7, 9\) on cpu",
    ),
}


@pytest.mark.parametrize("given", OUTS)
def test_out_without_room_is_refused_before_anything_is_written_over(given: str) -> None:
    rig, (out, message) = Rig(MODEL, SENSORS, "cpu"), OUTS[given]
    frames = rig.sense(moved(0.0)) | {"camera in two worlds": rig.sense(worlds(0.0))["camera"]}
    before = values(frames["lidar"])
    with pytest.raises(InputError, match=message):
        rig.sense(moved(0.7), ["lidar", "camera"], out(frames))
    assert_same(values(frames["lidar"]), before, given)
