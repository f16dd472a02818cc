"""What a batch of worlds costs, compared with a loop over its worlds: python benchmarks/many_worlds.py [N] [device]"""

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np
import warp as wp

import rigcast

REPEATS = 15
HOUSE = "".join(
    f'<geom type="box" size="0.3 0.3 0.5" pos="{x} {y} 0.5"/>' for x in (-6, -3, 3, 6) for y in (-6, -2, 2, 6)
)
LEGS = "".join(
    f'<body pos="{x} {y} 0"><joint axis="0 1 0"/><geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.25"/>'
    '<body pos="0 0 -0.25"><joint axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25"/></body>'
    "</body>"
    for x in (0.25, -0.25)
    for y in (0.15, -0.15)
)
XML = f"""
<mujoco>
  <asset><hfield name="ground" nrow="64" ncol="64" size="10 10 0.3 0.1"/></asset>
  <worldbody>
    <geom type="hfield" hfield="ground"/>{HOUSE}
    <body name="torso" pos="0 0 0.6"><freejoint/><geom type="box" size="0.3 0.15 0.1"/>{LEGS}</body>
  </worldbody>
</mujoco>
"""


def sensors() -> list[rigcast.HeightScan | rigcast.Lidar | rigcast.DepthCamera]:
    unseen = rigcast.Filter(exclude_bodies=["torso"], exclude_subtree=True)
    torso, head = rigcast.Mount(body="torso"), rigcast.Mount(body="torso", pos=(0.3, 0, 0.2))
    rows = np.linspace(-15, 15, 64).tolist()
    return [
        rigcast.HeightScan(name="height_scan_of_187_rays", mount=torso, size=(1.6, 1.0), spacing=0.1, filter=unseen),
        rigcast.Lidar(name="lidar_of_64_rays", mount=head, elevation_deg=[0], columns=64, filter=unseen),
        rigcast.Lidar(name="lidar_of_64_x_64_rays", mount=head, elevation_deg=rows, columns=64, filter=unseen),
        rigcast.DepthCamera(name="camera_of_64_x_48", mount=head, resolution=(64, 48), fov_y_deg=60, filter=unseen),
    ]


def main(count: int = 256, device: str | None = None) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    model.hfield_data[:] = np.random.default_rng(0).random(model.hfield_data.shape)
    datas = states(model, count)
    on_device = poses_on_device(datas, rigcast.Scene(model, device).device)
    known = rigcast.Worlds(datas)  # where each has its poses is looked up once
    one, many = (rigcast.Rig(model, sensors(), device=device) for _ in range(2))
    batches = {"list of MjData": datas, "Worlds of it": known, **batch_of_mujoco(datas), "arrays on device": on_device}
    print(f"{count} worlds of {model.ngeom} geoms on {one.scene.device}: ms, and times as fast as a loop")
    for sensor in sensors():
        ways = [partial(batch, many, sensor.name, worlds) for worlds in batches.values()]
        for clock, (looped, *each) in least([partial(loop, one, sensor.name, datas), *ways]).items():
            figures = [f"{name} {took:.1f} ({looped / took:.1f})" for name, took in zip(batches, each, strict=True)]
            print(f"{sensor.name}, {clock}: loop {looped:.1f}, {', '.join(figures)}")


def loop(rig: rigcast.Rig, name: str, datas: list[mujoco.MjData]) -> None:
    for data in datas:
        rig.sense(data, [name])[name].range.numpy()


def batch(rig: rigcast.Rig, name: str, worlds: Any) -> None:
    rig.sense(worlds, [name])[name].range.numpy()


def states(model: mujoco.MjModel, count: int) -> list[mujoco.MjData]:
    """States of the robot at `count` random places, with random angles of its legs."""
    rng, datas = np.random.default_rng(1), [mujoco.MjData(model) for _ in range(count)]
    for data in datas:
        data.qpos[:2] = rng.uniform(-2, 2, 2)
        data.qpos[7:] = rng.normal(0, 0.3, model.nq - 7)
        mujoco.mj_forward(model, data)
    return datas


def poses_on_device(datas: list[mujoco.MjData], device: wp.Device) -> dict[str, wp.array]:
    """Poses of all worlds on the device, with mujoco_warp's names, shapes and float32."""
    poses = {}
    for name, dtype, shape in (("pos", wp.vec3, (3,)), ("mat", wp.mat33, (3, 3))):
        for prefix in ("x", "geom_x"):
            values = np.array([getattr(data, prefix + name) for data in datas])
            poses[prefix + name] = wp.array(values.reshape(*values.shape[:2], *shape), dtype=dtype, device=device)
    return poses


def batch_of_mujoco(datas: list[mujoco.MjData]) -> dict[str, Any]:
    """The same states in a `mujoco.batch.Batch`; nothing before MuJoCo 4.0."""
    try:
        from mujoco.batch import Batch
    except ImportError:
        return {}
    made = Batch(datas[0].model, nsim=len(datas))
    for name in ("geom_xpos", "geom_xmat", "xpos", "xmat"):
        made.bind(name)
    made.bind("qpos")[:] = [data.qpos for data in datas]
    made.forward()
    return {"mujoco.batch": made}


def least(ways: Sequence[Callable[[], None]]) -> dict[str, list[float]]:
    """The least time of each way [ms] in REPEATS interleaved runs, as other work on the machine only adds to it.

    By the clock, and by CPU time, which other work disturbs less.
    """
    for way in ways:
        way()
    clocks = {"by the clock": time.perf_counter, "CPU time": time.process_time}
    taken = [[_times(way, list(clocks.values())) for way in ways] for _ in range(REPEATS)]
    return dict(zip(clocks, np.min(taken, axis=0).T.tolist(), strict=True))


def _times(way: Callable[[], None], clocks: Sequence[Callable[[], float]]) -> list[float]:
    begin = [clock() for clock in clocks]
    way()
    return [1e3 * (clock() - was) for clock, was in zip(clocks, begin, strict=True)]


if __name__ == "__main__":
    main(*([int(sys.argv[1])] if sys.argv[1:] else []), *sys.argv[2:])  # type: ignore[arg-type]
