"""`rigcast presets`: the list of devices."""

import json
import re

from shell_calls import call_on_one_line as call

from rigcast.sensors.specs.presets import load_preset, preset_names


def test_presets_are_listed() -> None:
    code, output = call("presets")
    assert code == 0
    assert "┃ preset ┃ type ┃ device ┃ cited ┃" in output
    assert all(f"│ {name} │ {load_preset(name).type} │" in output for name in preset_names())


def test_the_list_counts_figures() -> None:
    code, output = call("presets", "--json", "-")
    assert code == 0
    entries = {entry["name"]: entry for entry in json.loads(output)}
    _, table = call("presets")
    for preset in map(load_preset, preset_names()):
        cited = entries[preset.name]["cited"]
        assert set(cited) == preset.cited()
        share = f"{len(cited)} of {len(preset.stated())}"
        assert re.search(rf"│ {preset.name} +│[^│]+│[^│]+│ +{share} │", table), preset.name


def test_unknown_preset_names_the_nearest() -> None:
    code, output = call("presets", "velodyne_vlp61")
    assert code == 2
    assert "unknown preset 'velodyne_vlp61'" in output
    assert "did you mean 'velodyne_vlp16'?" in output
