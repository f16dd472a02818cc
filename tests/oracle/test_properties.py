"""Properties of every cast in any scene: culling, maximum distance, shapes and lengths of directions."""

import functools
from collections.abc import Callable
from operator import itemgetter
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import scenes
from hypothesis import given
from hypothesis import strategies as st

import rigcast
from rigcast.oracle import RayHits
from rigcast.oracle.bounds import TIE, agrees
from rigcast.sensors.scene.hits import NumpyHits
from rigcast.sensors.scene.scene import Cull

COUNT = 24  # rays of an example
DEFORMABLE = """<mujoco><worldbody><geom type="plane" size="0 0 1" pos="0 0 -1"/><geom size=".4" pos="0 0 1"/>
<flexcomp name="cloth" type="grid" count="6 6 1" spacing=".5 .5 .5" dim="2" radius=".02" mass="1"><edge
equality="true"/></flexcomp>
<flexcomp name="soft" type="grid" count="4 4 4" spacing=".4 .4 .4" pos="1 1 1" dim="3" radius=".02" mass="1"><edge
equality="true"/></flexcomp></worldbody></mujoco>"""


@functools.cache
def world(seed: int) -> tuple[mujoco.MjModel, mujoco.MjData, rigcast.Scene]:
    """Return a random scene of geoms, or for seed -1 one with flexes."""
    model = scenes.scene(seed) if seed >= 0 else mujoco.MjModel.from_xml_string(DEFORMABLE)
    data = scenes.state(model, seed, 1) if seed >= 0 else mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = rigcast.Scene(model)
    scene.update(data)
    return model, data, scene


@functools.cache
def rays(seed: int, kind: str, rays_seed: int) -> tuple[scenes.Floats, scenes.Floats]:
    """Return origins and unit directions of one kind through the world of a seed."""
    model, data, _ = world(seed)
    origins, directions = scenes.rays(model, data, rays_seed, 0, kind)
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@st.composite
def casts(draw: st.DrawFn) -> tuple[rigcast.Scene, scenes.Floats, scenes.Floats]:
    """A scene, and COUNT origins and unit directions of one kind through it."""
    seed = draw(st.integers(-1, 5))
    origins, unit = rays(seed, draw(st.sampled_from(sorted(scenes.KINDS))), draw(st.integers(0, 3)))
    first = draw(st.integers(0, len(unit) - COUNT))
    return world(seed)[2], origins[first : first + COUNT], unit[first : first + COUNT]


def assert_same(got: NumpyHits, expected: NumpyHits) -> None:
    """Assert that all fields are equal."""
    for name, field, wanted in zip(NumpyHits._fields, got, expected, strict=True):
        np.testing.assert_array_equal(field, wanted, err_msg=name)


def each(hits: NumpyHits, change: Callable[[Any], Any]) -> NumpyHits:
    """The hits with every field changed."""
    return hits._replace(**{name: change(field) for name, field in hits._asdict().items()})


def kept(hits: NumpyHits, keep: npt.NDArray[np.bool_], otherwise: NumpyHits) -> NumpyHits:
    """The hits, with the other ones wherever `keep` (n,) is False."""
    others = otherwise._asdict()
    left: dict[str, Any] = {
        name: np.where(keep if field.ndim == 1 else keep[:, None], field, others[name])
        for name, field in hits._asdict().items()
    }
    return hits._replace(**left)


def misses() -> NumpyHits:
    """COUNT rays that hit nothing."""
    nothing = np.full(COUNT, -1, np.int32)
    return NumpyHits(np.full(COUNT, np.inf, np.float32), *(nothing,) * 5, normal=np.zeros((COUNT, 3), np.float32))


@given(given=casts())
def test_culling_splits_hits_by_the_sign_of_d_n(given: tuple[rigcast.Scene, scenes.Floats, scenes.Floats]) -> None:
    """The first hit is the nearer of the first front face and the first back face."""
    scene, origins, unit = given
    every, faced, followed = (scene.cast(origins, unit, cull=cull).numpy() for cull in _CULLS)
    for hits, sign in ((faced, -1), (followed, 1)):
        slope = (unit * hits.normal).sum(axis=1)
        assert (sign * slope >= -1e-6).all(), slope
        np.testing.assert_array_equal(np.isfinite(hits.distance), np.any(hits.normal != 0, axis=1))
    first = kept(faced, faced.distance <= followed.distance, otherwise=followed)
    # which hits are decided in float64 depends on the others, so distances may differ within their error
    both = np.isfinite(faced.distance) & np.isfinite(followed.distance)
    apart = np.subtract(faced.distance, followed.distance, out=np.full(COUNT, np.inf, np.float32), where=both)
    is_clear = np.abs(apart) > TIE * (1 + np.where(both, first.distance, 0))
    same = agrees(unit, RayHits.of(every), RayHits.of(first))
    assert same[is_clear].all(), f"{every}\n{first}"
    np.testing.assert_allclose(every.distance, first.distance, rtol=TIE, atol=TIE)


_CULLS: tuple[Cull, ...] = ("none", "back", "front")


@given(given=casts(), ray=st.integers(0, COUNT - 1), limit=st.floats(0, 20))
def test_maximum_distance_is_inclusive_and_changes_nothing_else(
    given: tuple[rigcast.Scene, scenes.Floats, scenes.Floats], ray: int, limit: float
) -> None:
    scene, origins, unit = given
    hits = scene.cast(origins, unit).numpy()
    own = hits.distance[ray]
    below = float(np.nextafter(own, np.float32(-np.inf))) if 0 < own < np.inf else 0.0
    for most in (float(own), below, limit, 0.0):
        expected = kept(hits, hits.distance <= np.float32(most), otherwise=misses())
        assert_same(scene.cast(origins, unit, max_distance=most).numpy(), expected)


@given(given=casts(), rows=st.sampled_from([1, 2, 3, 4, 6, 8, 12, 24]))
def test_shapes_are_those_of_the_rays_and_change_nothing(
    given: tuple[rigcast.Scene, scenes.Floats, scenes.Floats], rows: int
) -> None:
    scene, origins, unit = given
    flat = scene.cast(origins, unit).numpy()
    shape = (rows, COUNT // rows)
    shaped = scene.cast(origins.reshape(*shape, 3), unit.reshape(*shape, 3)).numpy()
    assert_same(shaped, each(flat, lambda field: field.reshape(shape + field.shape[1:])))
    one = scene.cast(origins[0], unit).numpy()
    assert_same(one, scene.cast(np.tile(origins[0], (COUNT, 1)), unit).numpy())
    for k in (0, COUNT - 1):
        assert_same(scene.cast(origins[k], unit[k]).numpy(), each(flat, itemgetter(k)))


@given(given=casts(), exponent=st.integers(-900, 900))
def test_the_length_of_a_direction_does_not_matter(
    given: tuple[rigcast.Scene, scenes.Floats, scenes.Floats], exponent: int
) -> None:
    """Bit for bit, as a power of two causes no rounding."""
    scene, origins, unit = given
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    assert_same(scene.cast(origins, unit * 2.0**exponent).numpy(), scene.cast(origins, unit).numpy())
