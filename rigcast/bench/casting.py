"""Measurements of casts: patterns compared with grids, further outputs, rays with unrelated origins."""

from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from rigcast.rig_file import open_rig
from rigcast.sensors.rig.rig import Rig
from rigcast.sensors.specs.cameras.depth_camera import DepthCamera
from rigcast.sensors.specs.filter import Filter
from rigcast.sensors.specs.lidars.lidar import Lidar
from rigcast.sensors.specs.mount import Mount

from .casters import Floats, load_casters
from .figure import Figure, Spread
from .race import in_turns
from .workloads import demo_rig, room, warehouse

MOUNT = Mount(site="lidar_top")
ROBOT = Filter(exclude_bodies=("dolly",), exclude_subtree=True)


def patterns(rounds: int) -> Iterator[Figure]:
    """Rays per second of other patterns, over those of an even grid with as many rays and the same field of view."""
    odd: dict[str, Any] = {"name": "odd", "mount": MOUNT, "filter": ROBOT}
    cases = {
        "rosette": ("Livox Avia, non-repetitive", Lidar(**odd, preset="livox_avia", rate_hz=10.0), 70.4, 77.2),
        "wide": ("Velodyne VLP-16, 360 deg", Lidar(**odd, preset="velodyne_vlp16", rate_hz=10.0), 360.0, 30.0),
        "odd": ("37 x 613", Lidar(**odd, elevation_deg=np.linspace(9, -20, 37).tolist(), columns=613), 360.0, 29.0),
    }
    model, data = _demo()
    for key, (name, sensor, width, height) in cases.items():
        count = Rig(model, [sensor], "cpu").rays(data)["odd"].directions[..., 0].size
        rows = round((count * height / width) ** 0.5)
        columns = round(count / rows)
        grid = Lidar(
            name="grid",
            mount=MOUNT,
            elevation_deg=np.linspace(height / 2, -height / 2, rows).tolist(),
            columns=columns,
            azimuth_deg=(-width / 2, width / 2) if width < 360 else None,
            filter=ROBOT,
        )
        times = _sensor_times(Rig(model, [sensor, grid], "cpu"), data, rounds)
        ratio = (count / times["odd"][0]) / (rows * columns / times["grid"][0])
        what = f"{name}, {count} rays: rays/s over those of a grid of {rows} x {columns}"
        yield Figure(f"pattern_{key}", what, "ratio", Spread.of(ratio))


def _sensor_times(rig: Rig, data: mujoco.MjData, rounds: int) -> dict[str, Floats]:
    def frame_of(name: str) -> Callable[[], None]:
        def run() -> None:
            data.time += 0.1  # a rosette is different in each reading
            rig.cast(data, [name])[name].distance.numpy()

        return run

    return in_turns({spec.name: frame_of(spec.name) for spec in rig.sensors}, rounds)


def outputs(rounds: int) -> Iterator[Figure]:
    """The time of a depth frame with all fields read, over that of one with only the range read."""
    model, data = _demo()
    camera = DepthCamera(name="eye", mount=Mount(camera="head"), resolution=(640, 480), fov_y_deg=58.0, filter=ROBOT)
    rig = Rig(model, [camera], "cpu")

    def reader(*fields: str) -> Callable[[], None]:
        def run() -> None:
            (frame,) = rig.sense(data).values()
            for field in fields:
                getattr(frame, field).numpy()

        return run

    every = ("range", "normal", "geom_id", "body_id", "points", "depth")
    times = in_turns({"range": reader("range"), "every": reader(*every)}, rounds)
    what = "640 x 480 with normals, ids, points and z-depth: time over that of ranges alone"
    yield Figure("outputs", what, "ratio", Spread.of(times["every"][0] / times["range"][0]))


def origins(rounds: int) -> Iterator[Figure]:
    """`Scene.cast` of rays with unrelated origins: rays per second, and over Embree's if that is installed."""
    casters, _ = load_casters(("rigcast", "Open3D"))
    rng, count = np.random.default_rng(0), 100_000
    starts, towards = rng.uniform((-4, -3, 0.3), (4, 3, 2.0), (count, 3)), rng.normal(size=(count, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    for workload in (warehouse(), room()):
        scene = workload.model, workload.data, workload.groups
        times = in_turns({caster.name: caster(*scene).aim(starts, towards) for caster in casters}, rounds)
        key, what = f"origins_{workload.name}", f"Scene.cast of {count} unrelated rays, {workload.name}"
        yield Figure(key, what, "M rays/s", Spread.of(count / times["rigcast"][0] / 1e6))
        if "Open3D" in times:
            ratio = times["Open3D"][0] / times["rigcast"][0]
            yield Figure(f"{key}_embree", f"{what}: rays/s over Embree's", "ratio", Spread.of(ratio))


def _demo() -> tuple[mujoco.MjModel, mujoco.MjData]:
    config, model = open_rig(demo_rig())
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.keyframe(config.keyframe).id)
    return model, data
