"""Reading any rig file gives a rig or one InputError, in less than LONGEST."""

import time
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml_mutations
from hypothesis import given
from hypothesis import strategies as st

import rigcast.configs
from rigcast.rig_file import RigConfig, read_rig
from rigcast.sensors.errors import InputError

RIGS = [files(rigcast.configs).joinpath(name).read_bytes() for name in ("minimal.yaml", "demo.yaml")]
LONGEST = 10.0  # [s] for one file; a naive reader never finishes a bomb of aliases


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "rig.yaml"


def read(file: Path, content: bytes) -> RigConfig | InputError:
    file.write_bytes(content)
    start, result = time.perf_counter(), _read(file)
    assert time.perf_counter() - start < LONGEST
    assert isinstance(result, RigConfig) or str(result).startswith(str(file)), result
    return result


def _read(file: Path) -> RigConfig | InputError:
    try:
        return read_rig(file)
    except InputError as error:
        return error


@given(content=yaml_mutations.mutated(RIGS))
def test_a_rig_file_with_anything_put_into_it(file: Path, content: bytes) -> None:
    read(file, content)


@given(content=st.text().map(lambda text: text.encode("utf-8", "surrogatepass")) | st.binary())
def test_any_bytes(file: Path, content: bytes) -> None:
    assert isinstance(read(file, content), InputError)


@given(sensor=yaml_mutations.SENSORS)
def test_any_values_under_the_right_keys(file: Path, sensor: Any) -> None:
    read(file, yaml_mutations.as_yaml({"model": "m.xml", "sensors": [sensor]}))


LAUGHS = "".join(f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 9)}]\n" for k in range(1, 30))
BOMBS = {
    "aliases of aliases": f"l0: &l0 [ha]\n{LAUGHS}sensors: *l29\n",
    "aliases in a sensor": f"l0: &l0 [ha]\n{LAUGHS}sensors: [{{name: a, type: lidar, elevation_deg: *l29}}]\n",
    "a chain of aliases": "l0: &l0 [ha]\n" + "".join(f"l{k}: &l{k} [*l{k - 1}]\n" for k in range(1, 3000)),
    "a list of itself": "sensors: &s [*s]\n",
    "a mapping of itself": "sensors: &s {sensors: *s}\n",
    "merge of itself": "a: &a {<<: *a}\nsensors: []\n",
    "deep lists": "sensors: " + "[" * 100_000,
    "deep mappings": "sensors: " + "{a: " * 5_000,
    "deep and closed": "sensors: " + "[" * 2_000 + "]" * 2_000,
    "a long list": "sensors: [" + "1, " * 500_000 + "]\n",
    "a long list of mappings": "sensors:\n" + "  - {}\n" * 200_000,
    "long integer": "seed: " + "9" * 100_000 + "\nsensors: []\n",
    "long hexadecimal": "seed: 0x" + "f" * 100_000 + "\nsensors: []\n",
    "long exponent": "sensors: [{name: a, type: lidar, mount: {}, columns: 1e999999999}]\n",
    "integer as text": "sensors: [{name: a, type: lidar, mount: {}, columns: 1e400, elevation_deg: [1e400]}]\n",
    "another version of YAML": "sensors: []\n%YAML 9.9\n",
    "an old version of YAML": "%YAML 1.1\n---\nsensors: []\n",
    "python tag": "sensors: !!python/object/apply:os.system ['true']\n",
    "a thousand documents": "---\nsensors: []\n" * 1000,
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_do_not_go_off(file: Path, name: str) -> None:
    assert isinstance(read(file, BOMBS[name].encode()), InputError)
