"""`rigcast validate`: all mistakes of a rig, or its sensors and what is odd about them."""

import json
from pathlib import Path

import pytest
from shell_calls import call_on_one_line as call
from small_datasets import edited


def test_validate_shows_the_sensors(rig: Path) -> None:
    code, output = call("validate", rig)
    assert code == 0, output
    assert "┃ sensor ┃ type ┃ rays ┃ view [deg] ┃ rate ┃ mount ┃" in output
    assert "│ top │ lidar │ 16 x 1808 │ 360 x 30 │ 10 Hz │ body torso │" in output
    assert "│ front │ depth_camera │ 48 x 64 │ 72.1 x 57 │ every step │ world │" in output


@pytest.mark.parametrize(
    ("sensor", "view"),
    [
        ("type: lidar, elevation_deg: [-0.26, 0.26], columns: 9, azimuth_deg: [-3.14, 3.14]", "6.28 x 0.52"),
        ("type: lidar, elevation_deg: [10], columns: 1", "0 x 0"),
        ("type: height_scan, size: [1, 1], spacing: 0.5", "down"),
        (
            "type: depth_camera, resolution: [9, 9], fx: 2, fy: 2, cx: 4.5, cy: 4.5, distortion: {type: "
            "kannala_brandt}",
            "229 x 229",
        ),
    ],
)
def test_validate_shows_how_far_a_sensor_sees_around(rig: Path, sensor: str, view: str) -> None:
    rig.write_text(f"model: robot.xml\nsensors: [{{name: s, mount: {{}}, {sensor}}}]\n")
    code, output = call("validate", rig)
    assert code == 0, output
    assert f" │ {view} │ " in output


def test_a_sensor_that_reads_more_often_than_the_model_steps_is_named(rig: Path) -> None:
    word = "sensor 'front' reads at 600 Hz, the model steps at 500 Hz: rig.step gives one frame of a step"
    for rate, moves, named in ((600, 0, True), (500, 0, False), (600, 0.001, False)):
        values = f"sensors.front.rate_hz={rate}", f"sensors.front.readout_time={moves}"
        code, output = call("validate", rig, "--set", values[0], "--set", values[1])
        assert (code, word in output) == (0, named), output


def test_a_sensor_within_a_geom_of_its_own_body_is_named(rig: Path) -> None:
    word = (
        "of body 'torso' or on its surface, which hides from it what is outside; "
        "exclude_bodies: [torso] in its filter leaves that out"
    )
    for command in (("validate", rig), ("check", rig, "--rays", "20")):
        code, output = call(*command)
        assert code == 0, output
        assert word in output
        assert word not in call(*command, "--set", "sensors.top.mount.pos=[0,0,9]")[1]


def test_validate_takes_another_model(rig: Path) -> None:
    (rig.parent / "other.xml").write_text((rig.parent / "robot.xml").read_text().replace("torso", "trunk"))
    code, output = call("validate", rig, "--model", rig.parent / "other.xml")
    assert code == 2
    assert f"{rig}:3:68: sensors[0].mount.body: no body 'torso' in the model, expected one of world, trunk" in output


@pytest.mark.parametrize(
    ("angles", "told"),
    [
        ("[0, 0, 1.5708]", "euler_deg has 1.5708, which is pi / 2 to 4 digits: it is in degrees"),
        ("[-3.14159, 0, 0]", "euler_deg has -3.14159, which is -pi to 4 digits: it is in degrees"),
        ("[0.785398, 0, 90]", "euler_deg has 0.785398, which is pi / 4 to 4 digits: it is in degrees"),
        ("[0, 1.5, 90]", None),
        ("[0, 0, 0]", None),
    ],
)
def test_angles_that_seem_to_be_radians_are_told(rig: Path, angles: str, told: str | None) -> None:
    edited(rig, "mount: {}", f"mount: {{euler_deg: {angles}}}")
    code, output = call("validate", rig)
    assert code == 0
    assert ("euler_deg" in output) == (told is not None)
    assert told is None or f"sensor 'front': {told}" in output


CONFIGS = Path(__file__).resolve().parents[3] / "configs"


def test_validate_tells_programs_all_about_a_rig(tmp_path: Path) -> None:
    call("validate", CONFIGS / "minimal.yaml", "--json", tmp_path / "rig.json")
    document = json.loads((tmp_path / "rig.json").read_text())
    (top,) = document["sensors"]
    assert document["files"] == [str(CONFIGS / "minimal.yaml")]
    assert (top["name"], top["shape"], top["max_range"], top["mount"]["body"]) == ("top", [16, 1808], 100.0, "robot")
