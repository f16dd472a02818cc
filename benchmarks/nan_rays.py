"""What rays of NaN and inf cost, compared with good ones: python benchmarks/nan_rays.py [device]"""

import sys
import time
from importlib.resources import as_file, files

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray

import rigcast
import rigcast.configs

RAYS = 200_000
REPEATS = 7


def main(device: str | None = None) -> None:
    with as_file(files(rigcast.configs)) as folder:
        model = mujoco.MjModel.from_xml_path(str(folder / "warehouse" / "warehouse.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    scene = rigcast.Scene(model, device)
    scene.update(data)
    good = np.random.default_rng(0).normal(size=(RAYS, 3))
    cost = seconds(scene, good)
    print(f"good rays: {RAYS / cost / 1e6:.2f} million/s on {scene.device}")
    for name, value in (("NaN", np.nan), ("inf", np.inf)):
        for share in (1.0, 0.5):
            bad = good.copy()
            bad[: int(share * RAYS), 1] = value
            print(f"{name} in {share:.0%} of rays: {seconds(scene, bad) / cost:.3f} times the time")


def seconds(scene: rigcast.Scene, directions: NDArray[np.float64]) -> float:
    """The least time [s] of REPEATS casts."""
    rays = wp.array(directions, dtype=wp.vec3d, device=scene.device)
    origin = wp.array([(0.0, 0.0, 1.5)], dtype=wp.vec3d, device=scene.device)
    return min(_time(scene, origin, rays) for _ in range(REPEATS))


def _time(scene: rigcast.Scene, origin: wp.array, rays: wp.array) -> float:
    start = time.perf_counter()
    scene.cast(origin, rays)
    wp.synchronize_device(scene.device)
    return time.perf_counter() - start


if __name__ == "__main__":
    main(*sys.argv[1:2])
