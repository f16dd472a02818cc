"""The geometry of a scene is MuJoCo's: the same triangles and solids, in boxes that contain them."""

from collections import Counter

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

import rigcast
from rigcast import InputError
from rigcast.kernels.shapes import solids
from rigcast.kernels.world.arrays import TriangleTree
from rigcast.sensors.scene.parts.height_fields import hfield_triangles
from rigcast.sensors.scene.parts.model_geometry import read_model, unsupported_parts

Floats = NDArray[np.floating]
SIZE = np.array([1.5, 0.7, 0.4, 0.25])  # half x, half y, height of 1, depth of the base

ELEVATIONS = {
    "2 x 2": np.array([[0.1, 0.9], [0.4, 0.3]]),
    "3 x 5": np.random.default_rng(0).random((3, 5)),
    "7 x 4": np.random.default_rng(1).random((7, 4)),
    "flat": np.zeros((3, 3)),
    "plateau": np.ones((3, 4)),
    "hill": np.pad(np.random.default_rng(2).random((3, 4)), 1),
    "half of the border at 0": np.where(np.arange(5) < 3, 0.0, np.random.default_rng(3).random((4, 5))),
}


def split(data: Floats) -> tuple[Floats, Floats]:
    """Corners (n, 3, 3) of the surface with its sides, and of the base, of a height field."""
    vertices, faces = hfield_triangles(SIZE, data.astype(np.float32))
    corners = vertices[faces]
    return corners[:-12], corners[-12:]


def volume(corners: Floats) -> float:
    """Signed volume inside closed triangles: the sum of a . (b x c) / 6."""
    return float(np.linalg.det(corners).sum() / 6)


def open_edges(corners: Floats) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Directed edges of triangles with an area that no other triangle has in the opposite direction."""
    has_area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any(axis=1)
    points = [[tuple(p) for p in triangle] for triangle in corners[has_area].tolist()]
    edges = Counter((t[i], t[(i + 1) % 3]) for t in points for i in range(3))
    assert set(edges.values()) <= {1}, "two faces run the same edge in the same direction"
    return [(a, b) for a, b in edges if (b, a) not in edges]


@pytest.mark.parametrize("data", ELEVATIONS.values(), ids=ELEVATIONS)
def test_a_height_field_is_closed_down_to_its_foot(data: Floats) -> None:
    terrain, base = split(data)
    assert open_edges(base) == []
    foot = np.array(open_edges(terrain))
    np.testing.assert_array_equal(foot[..., 2], 0)
    # what is left open is the outline of the base, once around: its area by the shoelace formula
    (a, b) = foot[:, 0], foot[:, 1]
    area = (a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]).sum() / 2
    assert area == pytest.approx(4 * SIZE[0] * SIZE[1])


@pytest.mark.parametrize("data", ELEVATIONS.values(), ids=ELEVATIONS)
def test_a_height_field_is_wound_outwards(data: Floats) -> None:
    terrain, base = split(data)
    assert volume(base) == pytest.approx(4 * SIZE[0] * SIZE[1] * SIZE[3])
    rows, columns = data.shape
    z = SIZE[2] * data.astype(np.float32)
    cell = 4 * SIZE[0] * SIZE[1] / ((rows - 1) * (columns - 1))
    thirds = 2 * z[:-1, :-1] + 2 * z[1:, 1:] + z[:-1, 1:] + z[1:, :-1]
    assert volume(terrain) == pytest.approx(cell * thirds.sum() / 6)
    normals = np.cross(terrain[:, 1] - terrain[:, 0], terrain[:, 2] - terrain[:, 0])
    cells = 2 * (rows - 1) * (columns - 1)
    assert (normals[:cells, 2] > 0).all(), "the surface faces up"
    assert (np.sum(normals[cells:] * terrain[cells:].mean(axis=1), axis=1) >= 0).all(), "the sides face away"


@pytest.mark.parametrize("data", ELEVATIONS.values(), ids=ELEVATIONS)
def test_cells_are_numbered_row_by_row_and_split_as_mujoco_does(data: Floats) -> None:
    rows, columns = data.shape
    terrain, _ = split(data)
    x, y = np.linspace(-SIZE[0], SIZE[0], columns), np.linspace(-SIZE[1], SIZE[1], rows)

    def vertex(r: int, c: int) -> list[float]:
        return [x[c], y[r], SIZE[2] * np.float32(data[r, c])]

    for r in range(rows - 1):
        for c in range(columns - 1):
            k = r * (columns - 1) + c
            below_diagonal = [vertex(r, c), vertex(r, c + 1), vertex(r + 1, c + 1)]
            above_diagonal = [vertex(r, c), vertex(r + 1, c + 1), vertex(r + 1, c)]
            np.testing.assert_array_equal(terrain[2 * k], below_diagonal, err_msg=f"cell {r}, {c}")
            np.testing.assert_array_equal(terrain[2 * k + 1], above_diagonal, err_msg=f"cell {r}, {c}")


def test_mj_ray_finds_the_same_surface() -> None:
    elevation = np.random.default_rng(5).random((4, 6))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><hfield name="h" nrow="4" ncol="6" size="{" ".join(map(str, SIZE))}"/></asset>
        <worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>"""
    )
    model.hfield_data[:] = elevation.ravel()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    terrain, _ = split(elevation)
    for triangle in terrain[: 2 * 3 * 5]:
        above, down = triangle.mean(axis=0) + np.array([0, 0, 2.0]), np.array([0, 0, -1.0])
        distance = mujoco.mj_ray(model, data, above, down, None, 1, -1, np.zeros(1, np.int32))
        assert distance == pytest.approx(2.0, abs=1e-6)


ASSETS = """
<mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 0 1" scale="1 2 0.5"/>
<mesh name="tetra" vertex="0 0 0  0.3 0 0  0 0.4 0  0 0 0.1"/>
<mesh name="unused" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
<hfield name="hills" nrow="2" ncol="3" size="1.1 0.9 0.3 0.2" elevation="0 1 0 0.5 0.2 0.1"/>
<hfield name="dunes" nrow="3" ncol="2" size="2.1 0.7 0.1 0.3" elevation="0 1 0 0.5 0.2 0.1"/>
"""
# name: attributes, kind
GEOMS = {
    "floor": ('type="plane" size="0 0 1"', solids.PLANE),
    "table": ('type="plane" size="0.7 1.1 1"', solids.PLANE),
    "strip": ('type="plane" size="0.7 0 1"', solids.PLANE),
    "wedge": ('type="mesh" mesh="wedge"', solids.TRIANGLES),
    "sphere": ('type="sphere" size="0.1"', solids.SPHERE),
    "hills": ('type="hfield" hfield="hills"', solids.TRIANGLES),
    "capsule": ('type="capsule" size="0.1 0.7"', solids.CAPSULE),
    "tetra": ('type="mesh" mesh="tetra" pos="0 0 3"', solids.TRIANGLES),
    "ellipsoid": ('type="ellipsoid" size="0.1 0.7 1.3"', solids.ELLIPSOID),
    "wedge2": ('type="mesh" mesh="wedge" pos="3 0 0" euler="0 0 30"', solids.TRIANGLES),
    "cylinder": ('type="cylinder" size="0.3 0.1"', solids.CYLINDER),
    "dunes": ('type="hfield" hfield="dunes"', solids.TRIANGLES),
    "hills2": ('type="hfield" hfield="hills" pos="0 0 -2"', solids.TRIANGLES),
    "box": ('type="box" size="0.1 0.7 1.3"', solids.BOX),
    "fitted": ('type="box" mesh="tetra"', solids.BOX),
}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    geoms = "".join(f'<geom name="{name}" {attributes}/>' for name, (attributes, _) in GEOMS.items())
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{ASSETS}</asset><worldbody>{geoms}</worldbody></mujoco>")


def triangles(tree: TriangleTree) -> dict[int, Floats]:
    """Corners (3, 3) of each face of a tree."""
    blocks, lanes = np.nonzero(tree.blocks["face"] >= 0)
    corners = [[tree.blocks[f"{axis}{corner}"][blocks, lanes] for axis in "xyz"] for corner in range(3)]
    return dict(zip(tree.blocks["face"][blocks, lanes].tolist(), np.transpose(corners, (2, 0, 1)), strict=True))


def test_every_geom_becomes_a_shape_of_its_kind_and_size(model: mujoco.MjModel) -> None:
    geometry = read_model(model)
    assert geometry.shapes.kind.tolist() == [kind for _, kind in GEOMS.values()]
    assert geometry.supported.all()
    np.testing.assert_array_equal(geometry.shapes.size, model.geom_size.astype(np.float32))


def test_every_mesh_and_height_field_in_use_has_one_tree_shared_by_its_geoms(model: mujoco.MjModel) -> None:
    geometry = read_model(model)
    tree = {name: int(geometry.shapes.tree[model.geom(name).id]) for name in GEOMS}
    with_tree = [name for name, (_, kind) in GEOMS.items() if kind == solids.TRIANGLES]
    assert tree["wedge"] == tree["wedge2"]
    assert tree["hills"] == tree["hills2"]
    assert {tree[name] for name in with_tree} == set(range(4))
    assert len(geometry.trees) == 4
    assert {tree[name] for name in GEOMS.keys() - set(with_tree)} == {-1}


@pytest.mark.parametrize("name", ["wedge", "tetra"])
def test_a_mesh_has_the_models_vertices_and_faces(model: mujoco.MjModel, name: str) -> None:
    geometry, mesh = read_model(model), model.mesh(name)
    vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    faces = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
    found = triangles(geometry.trees[geometry.shapes.tree[model.geom(name).id]])
    assert sorted(found) == list(range(len(faces)))
    for face, corners in found.items():
        np.testing.assert_array_equal(corners, vertices[faces[face]], err_msg=f"face {face}")


def extremes(model: mujoco.MjModel, name: str) -> Floats:
    """Points (n, 3) whose bounding box is that of a geom in its own frame; +-inf where it is unbounded."""
    if name in ("wedge", "wedge2", "tetra"):
        mesh = model.mesh(name.rstrip("2"))
        return np.array(model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]])
    if name in ("hills", "hills2", "dunes"):
        x, y, top, depth = model.hfield(name.rstrip("2")).size  # MuJoCo scales elevations to 0..1
        return np.array([[-x, -y, -depth], [x, y, top]])
    a, b, c = model.geom(name).size
    reach = {
        "floor": [np.inf, np.inf, 0],
        "table": [0.7, 1.1, 0],
        "strip": [0.7, np.inf, 0],
        "sphere": [a, a, a],
        "capsule": [a, a, a + b],
        "cylinder": [a, a, b],
    }.get(name, [a, b, c])
    return np.array([np.negative(reach), reach])


@pytest.mark.parametrize("name", GEOMS)
def test_a_local_box_holds_its_geom_and_is_no_larger(model: mujoco.MjModel, name: str) -> None:
    shapes = read_model(model).shapes
    geom = model.geom(name).id
    center, half = shapes.center[geom].astype(np.float64), shapes.half[geom].astype(np.float64)
    points = extremes(model, name)
    lower, upper = points.min(axis=0), points.max(axis=0)
    assert (center - half <= lower).all(), f"got from {center - half}, expected to hold {lower}"
    assert (center + half >= upper).all(), f"got to {center + half}, expected to hold {upper}"
    np.testing.assert_allclose(center + half, upper, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(center - half, lower, rtol=1e-5, atol=1e-6)


def bare_sdf(*attributes: str) -> mujoco.MjModel:
    """A ball, and SDF geoms without meshes, which have only a distance function."""
    mesh = '<asset><mesh name="m" vertex="-1 -1 -1  1 -1 -1  0 1 -1  0 0 1"/></asset>'
    geoms = "".join(f'<geom type="sdf" mesh="m" {each}/>' for each in attributes)
    ball = '<geom name="ball" size="0.1" pos="3 0 0"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{mesh}<worldbody>{ball}{geoms}</worldbody></mujoco>")
    model.geom_dataid[1:] = -1
    return model


UNSUPPORTED = [
    pytest.param(['name="blob"'], "sdf geom 'blob'", id="named"),
    pytest.param([""], "sdf geom 1 (unnamed)", id="unnamed"),
    pytest.param(['name="a"', 'name="b"'], "sdf geom 'a', sdf geom 'b'", id="all at once"),
]


@pytest.mark.parametrize(("attributes", "parts"), UNSUPPORTED)
def test_what_rays_cannot_hit_is_refused_by_name(attributes: list[str], parts: str) -> None:
    model = bare_sdf(*attributes)
    assert ", ".join(unsupported_parts(model)) == parts
    with pytest.raises(InputError) as caught:
        rigcast.Scene(model)
    assert f"rays cannot hit {parts};" in str(caught.value)


@pytest.mark.parametrize(("attributes", "parts"), UNSUPPORTED)
def test_what_rays_cannot_hit_is_left_out_with_a_warning(attributes: list[str], parts: str) -> None:
    model = bare_sdf(*attributes)
    with pytest.warns(UserWarning, match="rays cannot hit") as caught:
        scene = rigcast.Scene(model, on_unsupported="warn")
    assert [parts in str(warning.message) for warning in caught] == [True]
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    scene.update(data)
    hits = scene.cast((0, 0.01, 5), [(0, 0, -1), (3, 0, -5)]).numpy()
    assert hits.geom_id.tolist() == [-1, model.geom("ball").id]
    assert hits.distance[0] == np.inf


def test_a_model_all_of_which_rays_can_hit_is_silent(model: mujoco.MjModel) -> None:
    assert unsupported_parts(model) == []
