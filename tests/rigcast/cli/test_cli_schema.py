"""`rigcast schema`: for editors, of rigs and of data sets."""

import json
import runpy
from pathlib import Path
from typing import Any, NoReturn

import jsonschema
import pytest
from ruamel.yaml import YAML
from shell_calls import call

from rigcast.rig_file.file import RigFile
from rigcast.schema import dataset_schema, rig_schema


def schema() -> dict[str, Any]:
    code, output = call("schema")
    assert code == 0

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is not JSON")

    return dict(json.loads(output, parse_constant=refuse))


def test_schema_knows_the_keys_and_explains_them() -> None:
    document = schema()
    definitions = document["$defs"]
    assert set(document["properties"]) == set(RigFile.model_fields)
    of_all = {"Mount", "Filter", "Prop", "Surface", "Export"}
    of_lidars = {
        "Lidar",
        "Rosette",
        "Wedge",
        "Nodding",
        "RayArrays",
        "RayFile",
        "Noise",
        "Detection",
        "Beam",
        "Weather",
    }
    of_cameras = {"DepthCamera", "BrownConrady", "KannalaBrandt", "Stereo", "TimeOfFlight"}
    assert set(definitions) == of_all | of_lidars | of_cameras | {"HeightScan"}
    for name, definition in {"RigFile": document, **definitions}.items():
        assert definition["additionalProperties"] is False
        unexplained = [key for key, field in definition["properties"].items() if "description" not in field]
        assert unexplained in ([], ["type"]), name


@pytest.mark.parametrize(
    ("sensor", "required"),
    [
        ("Lidar", {"type", "name", "mount"}),
        ("DepthCamera", {"type", "name", "mount"}),
        ("HeightScan", {"type", "name", "mount", "size", "spacing"}),
    ],
)
def test_schema_requires_what_no_preset_gives(sensor: str, required: set[str]) -> None:
    assert set(schema()["$defs"][sensor]["required"]) == required


@pytest.mark.parametrize("key", ["max_range", "columns", "elevation_deg"])
def test_schema_gives_no_default_that_a_file_could_not_hold(key: str) -> None:
    assert "default" not in schema()["$defs"]["Lidar"]["properties"][key]


CONFIGS = Path(__file__).resolve().parents[3] / "configs"
EXAMPLES = sorted([*CONFIGS.glob("*.yaml"), *(CONFIGS.parent / "examples").rglob("*.yaml")])


@pytest.mark.parametrize("kind", ["rig", "dataset"])
def test_the_shipped_schema_is_the_one_that_is_printed(kind: str) -> None:
    shipped = json.loads((CONFIGS / f"{kind}.schema.json").read_text())
    assert shipped == json.loads(call("schema", kind)[1]), f"run: rigcast schema {kind} > configs/{kind}.schema.json"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_names_the_schema_and_keeps_to_it(path: Path) -> None:
    first, _, _ = path.read_text().partition("\n")
    assert first.startswith("# yaml-language-server: $schema=")
    assert (path.parent / first.partition("=")[2]).resolve() == CONFIGS / "rig.schema.json"
    jsonschema.validate(YAML(typ="safe", pure=True).load(path), rig_schema())


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("datasets/*.yaml")), ids=lambda path: path.name)
def test_every_data_set_names_its_schema_and_keeps_to_it(path: Path) -> None:
    first, _, _ = path.read_text().partition("\n")
    assert (path.parent / first.partition("=")[2]).resolve() == CONFIGS / "dataset.schema.json"
    jsonschema.Draft202012Validator.check_schema(dataset_schema())
    jsonschema.validate(YAML(typ="safe", pure=True).load(path), dataset_schema())


SENSOR = "{name: a, type: lidar, mount: {}, elevation_deg: [0], columns: 4"


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        (f"sensors: [{SENSOR}}}]", True),
        (f"sensors: [{SENSOR}, rate: 3}}]", False),
        ("sensors: [{name: a, type: lidar}]", False),
        ("extends: a.yaml\nsensors: [{name: a, rate_hz: 3}]", True),
        ("extends: [a.yaml, b.yaml]", True),
        ("extends: 3", False),
        ("seed: 3", False),
        (f"sensors: [{SENSOR}, repeat: {{k: [1, 2]}}, rate_hz: $k}}]", True),
        ("sensors: [{name: a$k, type: lidar, mount: {pos: [0, $k, 1]}, repeat: {k: [1]}}]", True),
        (f"sensors: [{SENSOR}, rate_hz: fast}}]", False),
        (f"sensors: [{SENSOR}, repeat: [1]}}]", False),
    ],
)
def test_the_schema_takes_what_may_be_written(text: str, fits: bool) -> None:
    jsonschema.Draft202012Validator.check_schema(rig_schema())
    faults = list(jsonschema.Draft202012Validator(rig_schema()).iter_errors(YAML(typ="safe", pure=True).load(text)))
    assert (not faults) == fits, faults


def test_the_yaml_reference_has_every_key() -> None:
    reference = runpy.run_path(str(CONFIGS.parent / "docs" / "site.py"))["yaml_reference"]()
    schema = rig_schema()
    keys = {key for part in (schema, *schema["$defs"].values()) for key in part["properties"]}
    assert [key for key in sorted(keys) if f"| `{key}` |" not in reference] == []
