"""Input that a scene cannot use is refused with one error that says what and where."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import small_scenes
import warp as wp
from small_scenes import Elsewhere, model_of

from rigcast import Filter, InputError, Scene


@pytest.fixture(scope="module")
def row() -> Scene:
    return small_scenes.row()


NAN, INF = np.nan, np.inf
GOOD = [[1.0, 0, 0]] * 4
BAD_RAYS = [
    pytest.param((0, 0, 0), (NAN, 0, 0), "directions: got [nan, 0.0, 0.0], expected finite", id="NaN"),
    pytest.param((0, 0, 0), [*GOOD, [0, 0, INF]], "ray 4: directions: got [0.0, 0.0, inf], expected finite", id="inf"),
    pytest.param((0, 0, 0), (0, 0, 0), "directions: got [0.0, 0.0, 0.0], expected a direction", id="zero"),
    pytest.param((0, 0, 0), [*GOOD, [0, 0, 0], [0, 0, 0]], "ray 4: directions: got [0.0, 0.0, 0.0]", id="first zero"),
    pytest.param((0, 0, 0), [GOOD[:2], [[1, 0, 0], [0, 0, 0]]], "ray (1, 1): directions: got [0.0, 0.0", id="2D"),
    pytest.param((0, 0, NAN), GOOD, "origins: got [0.0, 0.0, nan], expected finite", id="origin NaN"),
    pytest.param([[0, 0, 0]] * 3 + [[0, -INF, 0]], GOOD, "ray 3: origins: got [0.0, -inf, 0.0]", id="origin inf"),
    pytest.param((0, 0, 0), (1, 0), "directions: got shape (2,), expected (..., 3)", id="two numbers"),
    pytest.param((0, 0, 0), 1.0, "directions: got shape (), expected (..., 3)", id="a number"),
    pytest.param((0, 0, 0), [], "directions: got shape (0,), expected (..., 3)", id="nothing"),
    pytest.param((0, 0, 0), np.ones((3, 4)), "directions: got shape (3, 4), expected (..., 3)", id="transposed"),
    pytest.param((0, 0, 0), [[1, 0, 0], [1, 0]], "directions: expected an array of numbers", id="ragged"),
    pytest.param((0, 0), GOOD, "origins: got shape (2,), expected (..., 3)", id="origin of two numbers"),
    pytest.param(
        [[0, 0, 0]] * 3,
        GOOD,
        "origins: got shape (3, 3), expected (3,) or what can be broadcast with that of directions, (4, 3)",
        id="too few origins",
    ),
    pytest.param([[0, 0, 0], [0, -INF, 0]], (1, 0, 0), "ray 1: origins: got [0.0, -inf, 0.0]", id="of many origins"),
    pytest.param([[0, 0, 0]] * 2, (0, 0, 0), "ray 0: directions: got [0.0, 0.0, 0.0]", id="of many origins, zero"),
    pytest.param((0, 0, 0), "x", "directions: expected an array of numbers", id="text"),
    pytest.param((0, 0, 0), ["1", "0", "0"], "of numbers (..., 3), got <U1 ['1', '0', '0']", id="digits as text"),
    pytest.param(("a", 0, 0), GOOD, "origins: expected an array of numbers", id="origin text"),
    pytest.param((0, 0, 0), [1j, 0, 0], "directions: expected an array of numbers", id="complex"),
    pytest.param((0, 0, 0), [None, 0, 0], "directions: expected an array of numbers", id="None"),
    pytest.param((0, 0, 0), Elsewhere(), "directions: expected an array of numbers (..., 3): can't", id="elsewhere"),
    pytest.param((0, 0, 0), {"x": 1}, "directions: expected an array of numbers", id="a mapping"),
]


@pytest.mark.parametrize(("origins", "directions", "message"), BAD_RAYS)
def test_bad_rays_give_one_error_that_names_the_ray(row: Scene, origins: Any, directions: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        row.cast(origins, directions)
    assert str(caught.value).startswith("Scene.cast: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cull": "bakc"}, r"no cull 'bakc', expected one of none, back, front; did you mean 'back'\?"),
        ({"cull": None}, "no cull None, expected one of none, back, front"),
        ({"max_distance": -1.0}, "max_distance must be at least 0 m, got -1.0"),
        ({"max_distance": NAN}, "max_distance must be at least 0 m, got nan"),
        ({"filter": Filter(exclude_bodies=["thrid"])}, r"no body 'thrid' in the model, .*did you mean 'third'\?"),
    ],
)
def test_bad_options_of_a_cast_are_refused(row: Scene, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        row.cast((0, 0, 0), (1, 0, 0), **arguments)


def test_device_origins_must_fit_the_directions(row: Scene) -> None:
    origins, directions = (wp.zeros(n, dtype=wp.vec3, device=row.device) for n in (2, 3))
    with pytest.raises(InputError, match=r"origins: got shape \(2, 3\), expected \(3,\) or what .*, \(3, 3\)"):
        row.cast(origins, directions)


def test_a_cast_before_the_first_update_is_refused(row: Scene) -> None:
    with pytest.raises(InputError, match=r"no poses yet, expected scene\.update\(data\) first"):
        Scene(row.model).cast((0, 0, 0), (1, 0, 0))


def test_data_of_another_model_is_refused_and_changes_nothing(row: Scene) -> None:
    other = mujoco.MjData(model_of('<geom size="1"/>'))
    with pytest.raises(InputError, match=r"data belongs to another model: got .* 1 geoms, expected .* 3"):
        row.update(other)
    assert row.cast((0, 0, 0), (1, 0, 0)).numpy().distance == np.float32(0.9)


@pytest.mark.parametrize("way", ["made", "reset"])
def test_data_without_poses_is_refused(way: str) -> None:
    model = model_of('<geom size="1" pos="3 0 0"/>')
    data, scene = mujoco.MjData(model), Scene(model)
    if way == "reset":
        mujoco.mj_forward(model, data)
        mujoco.mj_resetData(model, data)
    with pytest.raises(InputError, match=r"Scene\.update: data: poses have not been computed, expected mj_forward or"):
        scene.update(data)
    mujoco.mj_kinematics(model, data)
    scene.update(data)
    assert scene.cast((0, 0, 0), (1, 0, 0)).numpy().distance == 2


LINE = '<flexcomp name="line" dim="1" type="grid" count="2 1 1" spacing="1 1 1" radius="0.1" rigid="true"/>'


@pytest.mark.parametrize("xml", ['<geom size="1"/>', LINE], ids=["all supported", "flex"])
def test_an_unknown_way_to_treat_unsupported_geometry_is_refused(xml: str) -> None:
    with pytest.raises(InputError, match=r"on_unsupported 'wran', expected one of error, warn; did you mean 'warn'\?"):
        Scene(model_of(xml), on_unsupported="wran")  # type: ignore[arg-type]


def test_a_folder_for_kernels_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    folder = tmp_path / "file" / "kernels"
    message = "kernels cannot be written there: (Not a directory|Permission denied); WARP_CACHE_PATH can name another"
    code = "import mujoco, rigcast; rigcast.Scene(mujoco.MjModel.from_xml_string('<mujoco/>'), 'cpu')"
    environment = {**os.environ, "WARP_CACHE_PATH": str(folder)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert re.search(message, done.stderr.splitlines()[-1])
    assert str(folder) in done.stderr.splitlines()[-1]
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(folder))  # as if it existed and were empty
    with pytest.raises(InputError, match=message):
        Scene(model_of(""), "cpu")
