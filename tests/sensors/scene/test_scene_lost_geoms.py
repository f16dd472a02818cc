"""A geom whose pose is not finite is never hit, is named in one warning, and comes back when its pose does."""

import warnings

import mujoco
import numpy as np
import pytest
from small_scenes import KINDS, assert_missed, model_of, posed, ready

from rigcast import InputError, Scene

NAN, INF = np.nan, np.inf


def ruin(data: mujoco.MjData, part: str, element: int | None, value: float) -> None:
    """Put a value into one element, or into all, of the pose of geom 0."""
    getattr(data, part)[0, slice(None) if element is None else element] = value


RUINED = [
    *((part, None, value) for part in ("geom_xpos", "geom_xmat") for value in (NAN, INF)),
    *(("geom_xpos", element, NAN) for element in range(3)),
    *(("geom_xmat", element, NAN) for element in range(9)),
]


@pytest.mark.parametrize("kind", KINDS)
def test_a_geom_whose_pose_is_not_finite_is_never_hit_and_named_once(kind: str) -> None:
    behind = '<geom name="behind" type="box" size="1 9 9" pos="9 0 0"/>'
    model = model_of(f'<geom name="lost" {KINDS[kind].format(y=0)}/>{behind}')
    rays = (0, 0, -0.125), [(1, 0, 0), (1, 0.001, 0.001), (0, 0, 1), (0, 1, 0), (-1, 0, 0)]
    scene = ready(model)
    good = scene.cast(*rays).numpy()
    assert good.geom_id.tolist() == [0, 0, -1, -1, -1]
    for ruined in RUINED:
        data = posed(model)
        data.time = 1.5
        ruin(data, *ruined)
        with pytest.warns(RuntimeWarning, match=r"pose not finite at t = 1\.5 s, not hit: lost$") as caught:
            scene.update(data)
        assert len(caught) == 1, ruined
        for _ in range(2):
            assert scene.cast(*rays).numpy().geom_id.tolist() == [1, 1, -1, -1, -1], ruined
            scene.update(data)  # a second warning would fail the test
        scene.update(posed(model))
        for got, expected in zip(scene.cast(*rays).numpy(), good, strict=True):
            np.testing.assert_array_equal(got, expected, err_msg=f"back from {ruined}")


def test_where_the_warning_is_an_error_nothing_is_cast_until_the_next_update() -> None:
    model = model_of('<geom name="lost" size="0.1"/><body pos="2 0 0"><freejoint/><geom size="0.1"/></body>')
    scene, data = ready(model), posed(model)
    data.geom_xpos[0], data.geom_xpos[1, 0] = NAN, 3
    with warnings.catch_warnings(action="error"), pytest.raises(RuntimeWarning, match="not hit: lost"):
        scene.update(data)
    with pytest.raises(InputError, match=r"the last update failed, expected scene\.update\(data\) first"):
        scene.cast((1, 0, 0), (1, 0, 0))
    scene.update(data)
    assert scene.cast((1, 0, 0), (1, 0, 0)).numpy().distance == pytest.approx(1.9)


def test_a_scene_that_starts_with_nothing_finite_comes_right() -> None:
    model = model_of("".join(f"<geom {xml.format(y=10 * k)}/>" for k, xml in enumerate(KINDS.values())))
    scene, data = Scene(model), posed(model)
    data.geom_xpos[:] = NAN
    with pytest.warns(RuntimeWarning, match=r"not hit: geom 0, geom 1, .*, geom 8$"):
        scene.update(data)
    rays = [(-1, 10 * k, -0.125) for k in range(len(KINDS))], np.tile([1.0, 0, 0], (len(KINDS), 1))
    assert_missed(scene.cast(*rays).numpy())
    scene.update(posed(model))
    expected = ready(model).cast(*rays).numpy()
    np.testing.assert_array_equal(scene.cast(*rays).numpy().distance, expected.distance)
    assert np.isfinite(expected.distance).all()


def test_many_lost_geoms_are_counted_and_later_ones_named_on_their_own() -> None:
    model = model_of("".join(f'<geom name="g{k}" size="0.1" pos="{k} 0 0"/>' for k in range(15)))
    scene, data = Scene(model), posed(model)
    data.geom_xpos[:13] = NAN
    with pytest.warns(RuntimeWarning, match=r"not hit: g0, g1, .*, g9 and 3 more$"):
        scene.update(data)
    data.geom_xpos[14] = NAN
    with pytest.warns(RuntimeWarning, match=r"not hit: g14$"):
        scene.update(data)
    scene.update(data)
