"""`rigcast presets NAME` shows a device: its rays, its figures and their sources."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shell_calls import call
from typer.testing import CliRunner

from rigcast.card import Card
from rigcast.card_picture import draw_card, terminal_picture
from rigcast.cli import app
from rigcast.sensors.preview.colour import PANEL
from rigcast.sensors.specs.presets import load_preset


@pytest.mark.parametrize("name", ["velodyne_vlp16", "livox_avia", "livox_mid360", "kinect_v1"])
def test_a_preset_is_shown_with_its_sources(name: str) -> None:
    code, output = call("presets", name)
    preset = load_preset(name)
    assert code == 0
    assert f"{name}: {preset.description}" in output
    assert " ".join(preset.source.split()) in output
    assert all(f"assumed: {key}: {' '.join(why.split())}" in output for key, why in preset.assumed.items())
    for key in (*preset.sensor, *preset.figures):
        (line,) = [line for line in output.splitlines() if line.startswith(f"{key}: ")]
        assert line.endswith("(assumed)") == (key in preset.assumed)


def test_the_card_says_what_the_rays_are() -> None:
    _, output = call("presets", "velodyne_vlp16")
    assert "rays: 16 x 1808 in a reading, 10 readings/s, 289,280 rays/s\n" in output
    assert "field of view: 360 deg across, elevation -15 to 15 deg, between" in output
    assert "firing: over 99.954 ms\n" in output
    assert "elevation_deg: [-15, -13, -11, ..., 15] (16 values)" in output
    rosette = call("presets", "livox_mid40")[1]
    assert "firing: over 99.990 ms, other rays in each reading; the first one is shown\n" in rosette
    assert "field of view: 269 deg" not in output
    assert "field of view: 270 deg across" in call("presets", "hokuyo_utm30lx")[1]
    assert "field of view: 74.91 deg across, elevation -32.45 to 32.45 deg" in call("presets", "azure_kinect_nfov")[1]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("azure_kinect_nfov", "max_range: 3.86 m"),
        ("azure_kinect_nfov", "resolution: [640, 576] pixels"),
        ("azure_kinect_nfov", "rate_hz: 30"),
        ("realsense_d435", "stereo: baseline: 0.05 m, disparity_std: 0.08 pixels, disparity_step: 0.03125 pixels, "),
    ],
)
def test_figures_have_the_units_that_their_keys_do_not_name(name: str, line: str) -> None:
    assert any(shown.startswith(line) for shown in call("presets", name)[1].splitlines())


def test_the_card_is_drawn(tmp_path: Path) -> None:
    code, _ = call("presets", "livox_mid40", "--picture", str(tmp_path / "card.png"))
    assert code == 0
    with Image.open(tmp_path / "card.png") as card:
        assert card.size[0] == 1200
    code, output = call("presets", "--picture", str(tmp_path / "none.png"))
    assert (code, output) == (2, "--picture: got no preset, expected the name of one to draw\n")
    code, output = call("presets", "livox_mid40", "--picture", "card.txt")
    assert (code, output) == (2, "--picture: got 'card.txt', expected a name that ends in .png\n")


def test_a_users_preset_has_a_card(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(
        "extends: velodyne_vlp16\ndescription: mine\nsource: measured\nassumed: {max_range: guessed}\n"
        "figures: {returns: 1}\nsensor: {max_range: 30, rate_hz: 20}\n"
    )
    code, output = call("presets", str(tmp_path / "own.yaml"))
    assert code == 0
    for line in (
        "own: mine",
        "type: lidar",
        "max_range: 30 m (assumed)",
        "rate_hz: 20",
        "returns: 1",
        "source: measured",
    ):
        assert line in output.splitlines()
    assert "assumed: max_range: guessed" in output
    assert "assumed: max_range: 100 m" not in output, "what is given anew is not assumed as before"
    assert "source: VLP-16 user manual" in output
    assert "16 x 904 in a reading" in output


def dots(picture: list[str]) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """The dots of lines of braille, four rows and two columns in each character."""
    places = (
        (0, 0, 0x01),
        (1, 0, 0x02),
        (2, 0, 0x04),
        (3, 0, 0x40),
        (0, 1, 0x08),
        (1, 1, 0x10),
        (2, 1, 0x20),
        (3, 1, 0x80),
    )
    shown = np.zeros((4 * len(picture), 2 * len(picture[0])), dtype=bool)
    for (row, column), _ in np.ndenumerate(np.empty((len(picture), len(picture[0])))):
        for down, across, bit in places:
            shown[4 * row + down, 2 * column + across] = bool(ord(picture[row][column]) - 0x2800 & bit)
    return shown


def test_the_terminal_shows_each_beam() -> None:
    shown = dots(terminal_picture(Card.of("velodyne_vlp16")))
    assert shown.shape == (72, 152)
    assert np.count_nonzero(shown.any(axis=1)) == 16
    assert shown[:, 10:-10].any(axis=1).sum() == shown[:, 10:-10].all(axis=1).sum() == 16


def test_left_is_left_and_up_is_up(tmp_path: Path) -> None:
    (tmp_path / "corner.yaml").write_text(
        "{type: lidar, description: one corner, source: none,"
        " sensor: {elevation_deg: [0, 0, 20], azimuth_offset_deg: [0, 60, 60], columns: 1}}"
    )
    shown = dots(terminal_picture(Card.of(str(tmp_path / "corner.yaml"))))
    rows, columns = np.nonzero(shown)
    assert sorted(zip((rows > 36).tolist(), (columns > 76).tolist(), strict=True)) == [
        (False, False),
        (True, False),
        (True, True),
    ]


@pytest.mark.parametrize("name", ["livox_mid40", "sick_tim571", "zed2", "azure_kinect_nfov"])
def test_the_picture_has_its_rays(name: str) -> None:
    page = np.asarray(draw_card(Card.of(name)))
    box = page[125:515, 70:1080]
    assert 0.0005 < np.mean(np.any(box != PANEL, axis=-1)) < 0.99
    coloured = np.ptp(page[125:515, 1094:1106].astype(int), axis=-1) > 60
    assert coloured.any() == (name != "azure_kinect_nfov"), "a bar has the colours of the times of firing"


def test_a_card_without_utf8_has_no_picture() -> None:
    output = CliRunner(charset="ascii").invoke(app, ["presets", "sick_tim571"]).output
    assert "rays: 1 x 811" in output
    assert all(ord(letter) < 128 for letter in output)
