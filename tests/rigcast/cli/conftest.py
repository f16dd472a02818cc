"""A rig of two sensors, for commands that cast little."""

from pathlib import Path

import pytest

MODEL = '<mujoco><worldbody><body name="torso"><geom size="0.1"/></body></worldbody></mujoco>'
RIG = """\
model: robot.xml
sensors:
  - {name: top, type: lidar, preset: velodyne_vlp16, mount: {body: torso}}
  - {name: front, type: depth_camera, mount: {}, resolution: [64, 48], fov_y_deg: 58}
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    (tmp_path / "robot.xml").write_text(MODEL)
    (tmp_path / "rig.yaml").write_text(RIG)
    return tmp_path / "rig.yaml"
