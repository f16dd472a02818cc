"""A model of a hundred thousand geoms, which MuJoCo takes half a minute to compile."""

import mujoco
import numpy as np
import pytest
from small_scenes import ready

COUNT = 100_000
KINDS = ('type="sphere" size="0.1"', 'type="box" size="0.1 0.2 0.1"', 'type="capsule" size="0.1 0.2"')


@pytest.mark.long
def test_a_hundred_thousand_geoms_are_hit_as_mj_ray_hits_them() -> None:
    rng = np.random.default_rng(0)
    places = enumerate(rng.uniform(-100, 100, (COUNT, 3)))
    geoms = "".join(f'<geom {KINDS[k % 3]} pos="{x:.3f} {y:.3f} {z:.3f}"/>' for k, (x, y, z) in places)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    got = ready(model).cast((0, 0, 0), directions).numpy()
    expected, geom_id = [], np.zeros(1, np.int32)
    for direction in directions:
        mujoco.mj_ray(model, data, np.zeros(3), direction, None, 1, -1, geom_id)
        expected.append(int(geom_id[0]))
    assert got.geom_id.tolist() == expected
    assert max(expected) >= 0
