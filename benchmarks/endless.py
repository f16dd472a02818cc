"""Memory of a process that reads frame after frame: `python benchmarks/endless.py [FRAMES]`, else 100 000. Linux only.

Prints a line for every tenth of them; exits with 1 if memory has grown by more than 16 bytes for each frame.
"""

import sys

import mujoco

import rigcast
from rigcast.bench.scene_memory import resident
from rigcast.quiet import quiet_warp

MODEL = """<mujoco><worldbody>
  <geom type="plane" size="0 0 1" pos="0 0 -1"/>
  <body pos="2 0 0"><joint type="hinge" axis="0 0 1"/><geom type="box" size=".5 .3 .4"/></body>
</worldbody></mujoco>"""
FRAMES = 100_000
PARTS = 10
BYTES_PER_FRAME = 16


def small_rig() -> tuple[rigcast.Rig, mujoco.MjData]:
    """Return a lidar and a camera of a few rays, the lidar with noise."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    noise = rigcast.Noise(range_std=0.01)
    lidar = rigcast.Lidar(name="lidar", mount=rigcast.Mount(), elevation_deg=[0.0, -5.0], columns=16, noise=noise)
    camera = rigcast.DepthCamera(name="camera", mount=rigcast.Mount(), resolution=(8, 6), fov_y_deg=60.0)
    return rigcast.Rig(model, [lidar, camera], "cpu"), mujoco.MjData(model)


def read(rig: rigcast.Rig, data: mujoco.MjData, count: int) -> None:
    """Read `count` frames, all fields of every tenth reading, while the box turns."""
    for k in range(count // len(rig.sensors)):
        data.qpos[:] += 0.01
        for frame in rig.sense(data).values():
            frame.range.numpy()
            if k % 10 == 0:
                (frame.points_world.numpy(), frame.normal.numpy(), frame.geom_id.numpy(), frame.body_id.numpy())


def main(frames: int) -> int:
    """Return the exit status."""
    quiet_warp()
    rig, data = small_rig()
    read(rig, data, 2000)
    first = resident()
    for part in range(PARTS):
        read(rig, data, frames // PARTS)
        grown = (resident() - first) / 1024
        print(f"{(part + 1) * frames // PARTS} frames: {grown:+.0f} KiB of {first / 2**20:.0f} MiB", flush=True)
    return int(resident() - first > BYTES_PER_FRAME * frames)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else FRAMES))
