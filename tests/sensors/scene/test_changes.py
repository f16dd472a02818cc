"""Edits of the model during a simulation are seen at the next update: no hit is ever stale.

The judge is `mj_ray` on the edited model, and for meshes, whose bounding volumes `mj_ray` keeps as they were
compiled, a model compiled with the new vertices.
"""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from judged_casts import assert_none_wrong
from numpy.typing import NDArray
from small_scenes import ASSETS, KINDS, model_of, posed

import rigcast
from rigcast import Filter, InputError, Mount, Scene
from rigcast.sensors.scene.hits import NumpyHits

Edit = Callable[[mujoco.MjModel], None]
RAYS = 400
SOLIDS = [kind for kind in KINDS if kind not in ("mesh", "hfield")]
PAIR = (
    '<geom name="left" size="0.3" pos="2 0.5 0" rgba="1 1 1 1"/>'
    '<geom name="right" type="box" size="0.3 0.3 0.3" pos="2 -0.5 0" material="paint"/>'
    '<geom name="wall" type="box" size="0.1 3 3" pos="5 0 0"/>'
)


def one_of(kind: str) -> mujoco.MjModel:
    return model_of(f'<body name="carrier" mocap="true"><geom name="it" {KINDS[kind].format(y=0)}/></body>')


def pair() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><material name="paint" rgba="1 1 1 1"/></asset><worldbody>{PAIR}</worldbody></mujoco>'
    )


def rays(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rays from around (2.5, 0, 0) to points near it."""
    rng = np.random.default_rng(seed)
    origins = np.array([2.5, 0, 0]) + 4 * rng.normal(size=(RAYS, 3))
    return origins, np.array([2.5, 0, 0]) + 0.7 * rng.normal(size=(RAYS, 3)) - origins


def assert_like_mj_ray(model: mujoco.MjModel, data: mujoco.MjData, scene: Scene, seed: int = 0) -> NumpyHits:
    hits = scene.cast(*rays(seed)).numpy()
    assert_none_wrong(model, data, *rays(seed), hits, what=f"seed {seed}")
    return hits


def assert_differ(before: NumpyHits, after: NumpyHits) -> None:
    """Assert that an edit changes hits, else the test would prove nothing."""
    assert (before.distance != after.distance).mean() > 0.02


@pytest.mark.parametrize("size", [(0.9, 0.7, 0.4), (0.2, 0.4, 0.3)], ids=["larger", "smaller"])
@pytest.mark.parametrize("kind", SOLIDS)
def test_a_size_edited_at_run_time_is_seen_at_the_next_update(kind: str, size: tuple[float, float, float]) -> None:
    model = one_of(kind)
    data, scene = posed(model), Scene(model)
    scene.update(data)
    before = assert_like_mj_ray(model, data, scene)
    model.geom_size[0] = size
    scene.update(data)
    assert_differ(before, assert_like_mj_ray(model, data, scene))


def test_a_plane_may_become_finite_and_infinite_again() -> None:
    model = one_of("plane")
    data, scene = posed(model), Scene(model)
    for size in ((0.5, 0.7, 1), (0.5, 0, 1), (0, 0, 1), (0.1, 0.1, 1)):
        model.geom_size[0] = size
        scene.update(data)
        assert_like_mj_ray(model, data, scene)


def test_edited_elevations_are_seen_at_the_next_update() -> None:
    model = one_of("hfield")
    data, scene = posed(model), Scene(model)
    scene.update(data)
    hits = assert_like_mj_ray(model, data, scene)
    for seed in range(3):
        model.hfield_data[:] = np.random.default_rng(seed).random(model.nhfielddata)
        scene.update(data)
        before, hits = hits, assert_like_mj_ray(model, data, scene, seed)
        assert_differ(before, hits)


def test_a_height_field_of_more_than_a_million_triangles_is_hit_as_mj_ray_hits_it_before_and_after_an_edit() -> None:
    """Such fields have code of their own, for single rays and for rays from one origin."""
    hills = '<asset><hfield name="hills" nrow="731" ncol="727" size="3 3 0.5 0.5"/></asset>'
    geoms = '<geom type="hfield" hfield="hills" euler="5 -3 20"/><geom size="0.3" pos="1 1 0.3"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{hills}<worldbody>{geoms}</worldbody></mujoco>")
    data, scene = posed(model), Scene(model)
    for seed in range(2):
        rng = np.random.default_rng(seed)
        model.hfield_data[:] = rng.random(model.nhfielddata)
        scene.update(data)
        targets = rng.uniform((-3, -3, 0), (3, 3, 0.5), (RAYS, 3))
        for origins in (np.array([-1.0, 0.5, 1.5]), targets + rng.normal(size=targets.shape)):
            hits = scene.cast(origins, targets - origins).numpy()
            assert_none_wrong(model, data, origins, targets - origins, hits, what=f"seed {seed}")
            assert (hits.geom_id == 0).mean() > 0.5


def test_a_height_field_may_grow_and_shrink() -> None:
    model = one_of("hfield")
    data, scene = posed(model), Scene(model)
    for size in ((0.5, 1.5, 0.2, 1), (2, 0.4, 1, 0.1)):
        model.hfield_size[0] = size
        scene.update(data)
        assert_like_mj_ray(model, data, scene)


def test_one_height_field_among_others_and_meshes_is_renewed_alone() -> None:
    geoms = (
        '<geom type="hfield" hfield="hill" pos="1.5 0 0"/><geom type="mesh" mesh="cube" pos="3 1 -1"/>'
        '<geom type="mesh" mesh="tent" pos="4 -1 0"/>'
    )
    model = model_of(geoms)
    data, scene = posed(model), Scene(model)
    scene.update(data)
    before = assert_like_mj_ray(model, data, scene)
    model.hfield_data[:] = 1 - model.hfield_data
    scene.update(data)
    assert_differ(before, assert_like_mj_ray(model, data, scene))


def dim(model: mujoco.MjModel) -> None:
    model.geom_rgba[0, 3] = 0


def dim_material(model: mujoco.MjModel) -> None:
    model.mat_rgba[0, 3] = 0


def take_material_off(model: mujoco.MjModel) -> None:
    model.geom_rgba[1, 3] = 0
    model.geom_matid[1] = -1


def other_group(model: mujoco.MjModel) -> None:
    model.geom_group[0] = 3


def no_collision(model: mujoco.MjModel) -> None:
    model.geom_contype[1] = model.geom_conaffinity[1] = 0


LOOKS: dict[str, tuple[Edit, Filter]] = {
    "alpha": (dim, Filter()),
    "alpha of a material": (dim_material, Filter()),
    "material": (take_material_off, Filter()),
    "group": (other_group, Filter(geom_groups=[0])),
    "contype and conaffinity": (no_collision, Filter(geometry="collision")),
}


@pytest.mark.parametrize(("edit", "filter_"), LOOKS.values(), ids=LOOKS)
def test_an_edited_look_is_seen_by_the_next_cast(edit: Edit, filter_: Filter) -> None:
    model = pair()
    data, scene = posed(model), Scene(model)
    scene.update(data)
    before = scene.cast(*rays(0), filter=filter_).numpy()
    saved = {name: getattr(model, name).copy() for name in ("geom_rgba", "mat_rgba", "geom_matid", "geom_group")}
    edit(model)
    after = scene.cast(*rays(0), filter=filter_).numpy()
    assert_none_wrong(model, data, *rays(0), after, filter_)
    assert_differ(before, after)
    for name, values in saved.items():
        getattr(model, name)[:] = values
    model.geom_contype[:] = model.geom_conaffinity[:] = 1
    np.testing.assert_array_equal(scene.cast(*rays(0), filter=filter_).numpy().geom_id, before.geom_id)


def test_geoms_and_mocap_bodies_that_are_moved_are_seen() -> None:
    model = one_of("box")
    data, scene = posed(model), Scene(model)
    scene.update(data)
    before = assert_like_mj_ray(model, data, scene)
    model.geom_pos[0] += (0, 0.6, 0.2)
    model.geom_quat[0] = (0.8, 0.6, 0, 0)
    mujoco.mj_kinematics(model, data)
    scene.update(data)
    moved = assert_like_mj_ray(model, data, scene)
    assert_differ(before, moved)
    data.mocap_pos[0] = (0.3, -0.9, 0.1)
    mujoco.mj_kinematics(model, data)
    scene.update(data)
    assert_differ(moved, assert_like_mj_ray(model, data, scene))


def compiled_anew(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjModel:
    """A model with the first mesh of `model` alone, at its present vertices and pose."""
    count, faces = model.mesh_vertnum[0], model.mesh_facenum[0]
    vertices = model.mesh_vert[:count] @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    spec = mujoco.MjSpec()
    spec.add_mesh(name="it", uservert=vertices.ravel(), userface=model.mesh_face[:faces].ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="it")
    return spec.compile()


def test_an_edited_mesh_is_seen_once_it_is_refreshed() -> None:
    model = one_of("mesh")
    data, scene = posed(model), Scene(model)
    scene.update(data)
    hits = scene.cast(*rays(0)).numpy()
    for factor in ((0.5, 0.8, 0.3), (3, 2, 2)):
        model.mesh_vert[:] *= factor
        scene.refresh("cube")
        with pytest.raises(InputError, match=r"'cube' has been edited, expected scene\.update\(data\) first"):
            scene.cast((0, 0, 0), (1, 0, 0))
        scene.update(data)
        judge = compiled_anew(model, data)
        before, hits = hits, assert_like_mj_ray(judge, posed(judge), scene)
        assert_differ(before, hits)


def test_refresh_takes_height_fields_and_assets_that_no_geom_uses() -> None:
    model = one_of("hfield")
    data, scene = posed(model), Scene(model)
    for name in ("hill", "tent"):
        scene.refresh(name)
    scene.update(data)
    assert_like_mj_ray(model, data, scene)


def test_refresh_proposes_the_nearest_name() -> None:
    expected = r"no mesh or height field 'cubes', expected one of cube, tent, hill; did you mean 'cube'\?"
    with pytest.raises(InputError, match=expected):
        Scene(one_of("mesh")).refresh("cubes")


def test_a_name_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"Scene\.refresh: name: got NoneType, expected str"):
        Scene(one_of("mesh")).refresh(None)  # type: ignore[arg-type]


def nan_elevation(model: mujoco.MjModel) -> None:
    model.hfield_data[5] = np.nan


def infinite_elevation(model: mujoco.MjModel) -> None:
    model.hfield_data[5] = np.inf


def nan_base(model: mujoco.MjModel) -> None:
    model.hfield_size[:, 3] = np.nan


def endless_base(model: mujoco.MjModel) -> None:
    model.hfield_size[:, 3] = 1e30


def no_width(model: mujoco.MjModel) -> None:
    model.hfield_size[:, 0] = 0


def nan_size(model: mujoco.MjModel) -> None:
    model.geom_size[1, 0] = np.nan


def other_type(model: mujoco.MjModel) -> None:
    model.geom_type[1] = mujoco.mjtGeom.mjGEOM_BOX


BAD: dict[str, tuple[Edit, str]] = {
    "elevation": (nan_elevation, r"hfield 'hill': row 1, column 1: got .*nan.*, expected finite numbers"),
    "elevation without end": (
        infinite_elevation,
        r"hfield 'hill': row 1, column 1: got .*inf.*, expected finite numbers",
    ),
    "base": (nan_base, r"hfield 'hill': size: got .*nan.*, expected up to 1e\+18 m"),
    "base of 1e30 m": (endless_base, r"hfield 'hill': size: got .*1e\+30.*, expected up to 1e\+18 m"),
    "no width": (no_width, r"hfield 'hill': size: got \[0\.0, .*, and half sizes above 0 m"),
    "size": (nan_size, r"geom ball: size: got \[nan, 0\.0, 0\.0\], expected finite numbers"),
    "type": (other_type, "geom_type or geom_dataid has changed; make a new Scene"),
}


@pytest.mark.parametrize(("edit", "message"), BAD.values(), ids=BAD)
def test_an_edit_that_cannot_be_shown_is_refused_until_it_is_mended(edit: Edit, message: str) -> None:
    model = model_of('<geom type="hfield" hfield="hill" pos="2 0 0"/><geom name="ball" size="0.4" pos="3 1 1"/>')
    data, scene = posed(model), Scene(model)
    scene.update(data)
    edited = model.hfield_size, model.hfield_data, model.geom_size, model.geom_type
    good = [values.copy() for values in edited]
    edit(model)
    for _ in range(2):
        with pytest.raises(InputError, match=message):
            scene.update(data)
        with pytest.raises(InputError, match=r"the last update failed, expected scene\.update\(data\) first"):
            scene.cast(*rays(0))
    for values, before in zip(edited, good, strict=True):
        values[:] = before
    scene.update(data)
    assert_like_mj_ray(model, data, scene)


def test_a_mesh_that_cannot_be_shown_is_refused_by_name() -> None:
    model = one_of("mesh")
    data, scene = posed(model), Scene(model)
    model.mesh_vert[3, 1] = np.inf
    scene.refresh("cube")
    for _ in range(2):
        with pytest.raises(InputError, match=r"mesh 'cube': face \d+: vertex 3: got .*inf"):
            scene.update(data)


def test_a_rig_sees_every_edit() -> None:
    mesh = '<mesh name="cube" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"/>'
    assert mesh in ASSETS
    model = model_of(
        '<geom name="ball" size="0.5" pos="2 0 0"/><geom type="mesh" mesh="cube" pos="6 0 0"/>'
        '<geom name="wall" type="plane" size="0 0 1" zaxis="-1 0 0" pos="9 0 0"/>'
    )
    beam = rigcast.Lidar(name="beam", mount=Mount(), elevation_deg=[0], columns=1)
    data, rig = mujoco.MjData(model), rigcast.Rig(model, [beam], "cpu")

    def reading() -> float:
        return float(rig.sense(data)["beam"].range.numpy()[0, 0])

    assert reading() == pytest.approx(1.5)
    model.geom_size[0, 0] = 0.75
    assert reading() == pytest.approx(1.25)
    model.geom_pos[0, 0] = 3
    assert reading() == pytest.approx(2.25)
    model.geom_rgba[0, 3] = 0
    assert reading() == pytest.approx(5)
    model.mesh_vert[:] *= 0.5
    rig.scene.refresh("cube")
    assert reading() == pytest.approx(5.5)
    model.geom_rgba[1, 3] = 0
    assert reading() == pytest.approx(9)
    model.geom_rgba[0, 3] = 1
    assert reading() == pytest.approx(2.25)
