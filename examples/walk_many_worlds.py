"""A quadruped on rough ground in many worlds: mujoco_warp moves it, rigcast senses, and nothing leaves the device.

The gait lifts the feet higher where the height scan finds rough ground, and slows down where the lidar sees a pillar
ahead. Robots that fall are reset. What a learner needs from a step, observations and rewards, are arrays on the device.

pip install 'rigcast[worlds]'; python examples/walk_many_worlds.py [--worlds N] [--steps N] [--device D]
"""

# mypy: disallow-untyped-decorators=False

import time

import mujoco
import mujoco_warp as mjw
import numpy as np
import typer
import warp as wp

import rigcast

SUBSTEPS = 4  # of physics between two looks
LEG = """
<body name="{name}" pos="{x} {y} 0">
  <joint name="{name}_hip" axis="0 1 0" range="-60 60"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.16" size="0.025" contype="0" conaffinity="0"/>
  <body pos="0 0 -0.16">
    <joint name="{name}_knee" axis="0 1 0" range="-100 10"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.16" size="0.018" contype="0" conaffinity="0"/>
    <geom size="0.03" pos="0 0 -0.16"/>
  </body>
</body>
"""
PILLARS = [(3.0, 1.5), (4.0, -1.0), (-3.0, -2.0), (-2.0, 3.0), (0.5, -4.0), (1.0, 4.0)]


def robot_on_ground() -> mujoco.MjModel:
    """A robot of 14 kg with two joints in each leg, on 12 m x 12 m of bumps of up to 12 cm, flat where it starts."""
    legs = [
        ("front_left", 0.22, 0.13),
        ("front_right", 0.22, -0.13),
        ("back_left", -0.22, 0.13),
        ("back_right", -0.22, -0.13),
    ]
    joints = [f"{name}_{joint}" for name, _, _ in legs for joint in ("hip", "knee")]
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="0.005" iterations="30" ls_iterations="20"/>
      <default>
        <geom friction="1 0.02 0.01"/> <joint damping="1.5" armature="0.02" limited="true"/>
        <position kp="60" ctrlrange="-1.6 1.6"/>
      </default>
      <asset><hfield name="bumps" nrow="49" ncol="49" size="6 6 0.12 0.1"/></asset>
      <worldbody>
        <geom name="ground" type="hfield" hfield="bumps"/>
        {"".join(f'<geom type="cylinder" size="0.3 0.8" pos="{x} {y} 0.8"/>' for x, y in PILLARS)}
        <body name="torso" pos="0 0 0.36">
          <joint type="free" limited="false" damping="0" armature="0"/>
          <geom type="box" size="0.25 0.1 0.06" mass="10" contype="0" conaffinity="0"/>
          {"".join(LEG.format(name=name, x=x, y=y) for name, x, y in legs)}
        </body>
      </worldbody>
      <actuator>{"".join(f'<position joint="{name}"/>' for name in joints)}</actuator>
    </mujoco>""")
    x = np.linspace(-6, 6, 49)
    distance = np.hypot(x, x[:, None])
    bumps = np.random.default_rng(3).random((49, 49))
    model.hfield_data[:] = (bumps * np.clip(distance - 0.7, 0, 1)).ravel()
    return model


def sensors() -> list[rigcast.HeightScan | rigcast.Lidar]:
    unseen = rigcast.Filter(exclude_bodies=["torso"], exclude_subtree=True)
    return [
        rigcast.HeightScan(
            name="scan", mount=rigcast.Mount(body="torso", pos=(0.3, 0, 0)), size=(1.0, 0.6), spacing=0.1, filter=unseen
        ),
        rigcast.Lidar(
            name="lidar",
            mount=rigcast.Mount(body="torso", pos=(0.2, 0, 0.12)),
            elevation_deg=np.linspace(-15, 15, 64).tolist(),
            azimuth_deg=(-45, 45),
            columns=8,
            max_range=8.0,
            filter=unseen,
        ),
    ]


@wp.kernel
def walk(
    scan: wp.array2d[float],
    lidar: wp.array3d[float],
    time: wp.array[float],
    # out:
    control: wp.array2d[float],
) -> None:
    """The policy: a trot. It lifts feet higher where the ground is rough, and slows down before a wall."""
    w = wp.tid()
    low = wp.float32(wp.inf)
    high = wp.float32(0.0)
    for i in range(scan.shape[1]):
        if wp.isfinite(scan[w, i]):
            low = wp.min(low, scan[w, i])
            high = wp.max(high, scan[w, i])
    ahead = wp.float32(8.0)
    for row in range(lidar.shape[1] / 2, lidar.shape[1]):
        for column in range(lidar.shape[2]):
            if wp.isfinite(lidar[w, row, column]):
                ahead = wp.min(ahead, lidar[w, row, column])
    lift = 0.4 + wp.min(2.0 * wp.max(high - low, 0.0), 0.3)
    stride = 0.2 * wp.clamp(ahead - 0.6, 0.2, 1.0)
    for leg in range(4):
        phase = 12.0 * time[w] + wp.where(leg == 0 or leg == 3, 0.0, wp.PI)
        swing = wp.max(wp.cos(phase), 0.0)
        control[w, 2 * leg] = 0.45 - stride * wp.sin(phase)
        control[w, 2 * leg + 1] = -0.9 - lift * swing


@wp.kernel
def judge(
    xpos: wp.array2d[wp.vec3],
    xmat: wp.array2d[wp.mat33],
    velocity: wp.array2d[float],
    # out:
    reward: wp.array[float],
    has_fallen: wp.array[bool],
) -> None:
    """Forward speed [m/s] is the reward; who is on the side or below 12 cm has fallen."""
    w = wp.tid()
    has_fallen[w] = xmat[w, 1][2, 2] < 0.5 or xpos[w, 1][2] < 0.12
    ahead = wp.vec2(xmat[w, 1][0, 0], xmat[w, 1][1, 0])
    reward[w] = wp.where(has_fallen[w], -1.0, wp.dot(ahead, wp.vec2(velocity[w, 0], velocity[w, 1])))


class Walkers:
    """So many robots, each in a world of its own."""

    def __init__(self, worlds: int, device: str | None, seed: int = 0) -> None:
        model = robot_on_ground()
        self.rig = rigcast.Rig(model, sensors(), device=device)
        self.device = self.rig.scene.device
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        with wp.ScopedDevice(self.device):
            self.model = mjw.put_model(model)
            self.data = mjw.put_data(model, data, nworld=worlds, nconmax=24, njmax=120)
            self.reward = wp.zeros(worlds, dtype=float)
            self.has_fallen = wp.zeros(worlds, dtype=bool)
        turned = np.tile(data.qpos, (worlds, 1)).astype(np.float32)
        yaw = np.random.default_rng(seed).uniform(-np.pi, np.pi, worlds) / 2
        turned[:, 3], turned[:, 6] = np.cos(yaw), np.sin(yaw)
        self.data.qpos.assign(turned)
        mjw.kinematics(self.model, self.data)
        self.frames = self.rig.sense(self.data)

    def step(self) -> None:
        """Act on what was seen, move on, and look again."""
        worlds, seen = self.data.nworld, self.frames
        inputs = [seen["scan"].range, seen["lidar"].range, self.data.time]
        wp.launch(walk, worlds, inputs=inputs, outputs=[self.data.ctrl], device=self.device)
        for _ in range(SUBSTEPS):
            mjw.step(self.model, self.data)
        outputs = [self.reward, self.has_fallen]
        state = [self.data.xpos, self.data.xmat, self.data.qvel]
        wp.launch(judge, worlds, inputs=state, outputs=outputs, device=self.device)
        mjw.reset_data(self.model, self.data, reset=self.has_fallen)
        # a step leaves the poses where they were before it
        mjw.kinematics(self.model, self.data)
        self.frames = self.rig.sense(self.data)


def main(worlds: int = 64, steps: int = 100, device: str | None = None) -> None:
    walkers = Walkers(worlds, device)
    with wp.ScopedDevice(walkers.device):
        walkers.step()  # which compiles what it needs
        reward, falls, seconds = 0.0, 0, -time.perf_counter()
        for _ in range(steps):
            walkers.step()
            reward += float(walkers.reward.numpy().mean()) / steps
            falls += int(walkers.has_fallen.numpy().sum())
        seconds += time.perf_counter()
    rays = sum(frame.range.size for frame in walkers.frames.values())
    print(f"{worlds} worlds, {steps} steps: {reward:.3f} m/s forwards, {falls} falls")
    print(f"{worlds * steps / seconds:.0f} steps of a world per second, with {rays / worlds:.0f} rays each")


if __name__ == "__main__":
    typer.run(main)
