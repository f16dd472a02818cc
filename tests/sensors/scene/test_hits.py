"""Hits are the same on the device and on the host, and later casts do not change them."""

import numpy as np
import pytest
import warp as wp
from small_scenes import KINDS, model_of, posed, ready

from rigcast import InputError, Scene

IDS = dict.fromkeys(("geom_id", "flex_id", "skin_id", "prop_id"), wp.int32)
FIELDS = {"distance": wp.float32, **IDS, "face": wp.int32, "normal": wp.float32}


@pytest.fixture(scope="module")
def scene() -> Scene:
    """One geom of every kind, geom k in the lane y = 10 k, met at x = 2; 0 and 1 are planes."""
    lanes = "".join(f"<geom {xml.format(y=10 * k)}/>" for k, xml in enumerate(KINDS.values()) if k > 0)
    return ready(model_of(lanes))


RAYS = np.array([(0, 10 * k, -0.125) for k in range(len(KINDS))]), np.tile([1.0, 0, 0], (len(KINDS), 1))


def test_warp_and_numpy_fields_are_the_same(scene: Scene) -> None:
    hits = scene.cast(*RAYS)
    assert set(hits.numpy()._fields) == set(FIELDS)
    for name, dtype in FIELDS.items():
        array = getattr(hits, name)
        assert array.dtype == dtype, name
        assert array.device == scene.device, name
        np.testing.assert_array_equal(array.numpy(), getattr(hits.numpy(), name), err_msg=name)


def test_ids_of_kinds_that_a_scene_has_none_of_are_one_number(scene: Scene) -> None:
    hits = scene.cast(*RAYS).numpy()
    for name in ("flex_id", "skin_id", "prop_id"):
        ids = getattr(hits, name)
        assert (ids.shape, ids.strides, ids.flags.writeable) == ((len(KINDS),), (0,), False), name
        assert (ids == -1).all(), name


def test_a_miss_and_every_kind_of_hit_have_the_values_of_the_contract(scene: Scene) -> None:
    hits = scene.cast(*RAYS).numpy()
    assert hits.geom_id.tolist() == [-1, *range(len(KINDS) - 1)]
    assert hits.distance[0] == np.inf
    np.testing.assert_allclose(hits.distance[1:], 2, atol=0.05)
    has_face = np.isin(list(KINDS), ["mesh", "hfield"])
    assert (hits.face[has_face] >= 0).all()
    assert (hits.face[~has_face] == -1).all()
    np.testing.assert_array_equal(hits.normal[0], 0)
    np.testing.assert_allclose(np.linalg.norm(hits.normal[1:], axis=1), 1, atol=1e-6)


def test_a_single_ray_gives_arrays_of_one_on_the_device_and_scalars_on_the_host(scene: Scene) -> None:
    hits = scene.cast(RAYS[0][5], RAYS[1][5])
    assert hits.distance.shape == (1,)
    assert hits.normal.shape == (1, 3)
    assert hits.numpy().distance.shape == ()
    assert hits.numpy().normal.shape == (3,)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("plane", "rectangle")])
def test_normals_point_outwards_from_inside_and_outside(kind: str) -> None:
    scene = ready(model_of(f"<geom {KINDS[kind].format(y=0)}/>"))
    inside, ways = np.array([2.4, 0.05, -0.125]), np.eye(3)
    outside = [inside - 20 * way for way in ways]
    entering = scene.cast(outside, ways).numpy()
    leaving = scene.cast(inside, ways).numpy()
    assert (np.sum(entering.normal * ways, axis=1) < 0).all(), f"got {entering.normal}"
    assert (np.sum(leaving.normal * ways, axis=1) > 0).all(), f"got {leaving.normal}"
    assert (leaving.distance > 0).all()


def test_hits_are_written_over_in_the_arrays_of_earlier_ones(scene: Scene) -> None:
    first = scene.cast(*RAYS)
    places = [getattr(first, name).ptr for name in ("distance", "face", "normal")]
    turned = RAYS[0], -RAYS[1]
    again = scene.cast(*turned, out=first)
    assert [getattr(again, name).ptr for name in ("distance", "face", "normal")] == places
    for name, got, expected in zip(FIELDS, again.numpy(), scene.cast(*turned).numpy(), strict=True):
        np.testing.assert_array_equal(got, expected, err_msg=name)
    assert (again.geom_id.numpy() != scene.cast(*RAYS).geom_id.numpy()).any()


def test_hits_of_other_rays_have_no_room(scene: Scene) -> None:
    device = scene.device
    with pytest.raises(InputError, match=rf"out: got hits of shape \(2, 4\) on {device}, expected \(\) on {device}"):
        scene.cast((0, 0, 0), (1, 0, 0), out=scene.cast(np.zeros(3), np.ones((2, 4, 3))))
    with pytest.raises(InputError, match="out: got dict, expected Hits"):
        scene.cast((0, 0, 0), (1, 0, 0), out={})  # type: ignore[arg-type]


def test_later_casts_and_updates_leave_hits_alone() -> None:
    model = model_of('<body><joint type="slide" axis="1 0 0"/><geom type="box" size="1 1 1" pos="4 0 0"/></body>')
    scene, data = Scene(model), posed(model)
    scene.update(data)
    directions = np.random.default_rng(0).normal(scale=(1, 0.1, 0.1), size=(100, 3))
    first = scene.cast((0, 0, 0), directions)
    kept = [field.copy() for field in first.numpy()]
    assert 0 < (kept[1] >= 0).sum() < 100
    data.geom_xpos[0] += 1
    scene.update(data)
    second = scene.cast((0, 0, 0), directions)
    assert not np.array_equal(second.numpy().distance, kept[0])
    for name, got, expected in zip(FIELDS, first.numpy(), kept, strict=True):
        np.testing.assert_array_equal(got, expected, err_msg=name)
