"""`python cast_with_flags.py FLAGS`: a digest of the hits of sensors and single rays, compiled with these flags."""

import hashlib
import sys

import mujoco
import numpy as np
import warp as wp

from rigcast import HeightScan, Lidar, Mount, Rig, Scene

MODEL = """<mujoco>
  <asset><hfield name="hills" nrow="40" ncol="40" size="9 9 1 1"/>
    <mesh name="tent" vertex="-1 -1 0  1 -1 0  -1 1 0  1 1 0  0 -.5 1  .2 .7 1.3"/></asset>
  <worldbody>
    <geom type="hfield" hfield="hills" pos="0 0 -2"/>                 <geom type="mesh" mesh="tent" pos="2 1 0"/>
    <geom type="sphere" size=".5" pos="4 0 0"/>                       <geom type="capsule" size=".3 1" pos="-4 0 0"/>
    <geom type="ellipsoid" size=".5 .25 1" pos="0 4 0" euler="9 8 7"/> <geom type="cylinder" size=".5 1" pos="0 -4 0"/>
    <geom type="box" size=".5 .25 1" pos="3 3 0" euler="0 30 9"/>      <geom type="plane" size="3 3 1" pos="0 0 -1"/>
  </worldbody></mujoco>"""


def digest() -> str:
    """SHA-256 of ranges, ids and normals of rays in packets, in bundles and alone."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    rng, data = np.random.default_rng(0), mujoco.MjData(model)
    model.hfield_data[:] = rng.random(model.nhfielddata)
    rows = np.linspace(-40, 40, 48).tolist()
    dense = Lidar(name="dense", mount=Mount(), elevation_deg=rows, columns=256)
    sparse = Lidar(name="sparse", mount=Mount(), elevation_deg=[-30.0, 5.0], columns=11)
    scan = HeightScan(name="scan", mount=Mount(pos=(0, 0, 5)), size=(9, 9), spacing=0.2)
    found = hashlib.sha256()
    for frame in Rig(model, [dense, sparse, scan], "cpu").sense(data).values():
        for field in (frame.range, frame.geom_id, frame.normal):
            found.update(field.numpy().tobytes())
    scene = Scene(model, "cpu")
    scene.update(data)
    for hits in scene.cast(rng.uniform(-6, 6, (5000, 3)), rng.normal(size=(5000, 3))).numpy():
        found.update(hits.tobytes())
    return found.hexdigest()


if __name__ == "__main__":
    wp.config.log_level = wp.LOG_WARNING
    if sys.argv[1]:
        wp.config.cpu_compiler_flags = sys.argv[1]
    print(digest())
