"""Props are hit as MuJoCo hits the same mesh in its own model; bad files and paths are refused by name."""

import json
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from judged_casts import assert_none_wrong
from numpy.typing import NDArray
from small_scenes import assert_missed, model_of, posed

import rigcast
from rigcast import Filter, InputError, Lidar, Mount, Prop, Scene
from rigcast.cli import main
from rigcast.sensors.meshes import read_mesh
from rigcast.sensors.scene.hits import NumpyHits

RAYS = 500
CARRIER = '<body name="cart" pos="1 0.2 -0.3" euler="20 -30 50"><freejoint/><geom name="axle" size="0.05"/></body>'
EXPORTS = {
    "binary.stl": {"file_type": "stl"},
    "ascii.stl": {"file_type": "stl_ascii"},
    "box.obj": {"file_type": "obj"},
    "binary.ply": {"file_type": "ply"},
    "ascii.ply": {"file_type": "ply", "encoding": "ascii"},
    "box.glb": {"file_type": "glb"},
}


def wedge() -> trimesh.Trimesh:
    """An ellipsoid of triangles off the origin, about 1 m across, with a different radius along each axis."""
    points = np.random.default_rng(5).normal(size=(9, 3)) * (0.5, 0.3, 0.4)
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.vertices = mesh.vertices * (0.5, 0.3, 0.4) + 0.1 * points[0]
    return mesh


def exported(mesh: trimesh.Trimesh | trimesh.Scene, file: Path, **how: str) -> Path:
    content = mesh.export(**how)
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


@pytest.fixture
def mesh_file(tmp_path: Path) -> Path:
    return exported(wedge(), tmp_path / "wedge.ply", file_type="ply")


def rays(seed: int, around: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    origins = around + 3 * rng.normal(size=(RAYS, 3))
    return origins, around + 0.4 * rng.normal(size=(RAYS, 3)) - origins


def in_mujoco(prop: Prop, parent: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjModel:
    """A model of the parent's geoms at their poses, and of the prop's mesh, scaled and placed, as a mesh geom."""
    pose, mesh = prop.mount.bind(parent).pose(data), trimesh.load_mesh(prop.file, process=False)
    vertices = (mesh.vertices * np.broadcast_to(prop.scale, 3)) @ pose[:3, :3].T + pose[:3, 3]
    faces = mesh.faces[:, ::-1] if np.prod(np.sign(np.broadcast_to(prop.scale, 3))) < 0 else mesh.faces
    spec = mujoco.MjSpec()
    for geom in range(parent.ngeom):
        spec.worldbody.add_geom(size=parent.geom_size[geom], pos=data.geom_xpos[geom])
    spec.add_mesh(name="it", uservert=vertices.ravel(), userface=faces.ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="it")
    return spec.compile()


MOUNTS = {
    "world": (Mount(pos=(0.5, -1, 2), quat=(0.5, 0.1, -0.7, 0.3)), 0),
    "body": (Mount(body="cart", pos=(0.1, 0.2, 0.5), euler_deg=(10, 20, 30)), 1),
}


@pytest.mark.parametrize("scale", [1.0, 0.25, (1.5, 0.4, 0.8), (-1.0, 1.0, 1.0), -2.0], ids=str)
@pytest.mark.parametrize(("mount", "body"), MOUNTS.values(), ids=MOUNTS)
def test_a_prop_is_hit_where_mujoco_hits_the_same_mesh(
    mesh_file: Path, mount: Mount, body: int, scale: float | tuple[float, float, float]
) -> None:
    model = model_of(CARRIER)
    prop = Prop(name="it", file=mesh_file, mount=mount, scale=scale)
    data, scene = posed(model), Scene(model, "cpu", [prop])
    scene.update(data)
    around = mount.bind(model).pose(data)[:3, 3]
    hits = scene.cast(*rays(0, around)).numpy()
    of_prop = hits.prop_id == 0
    assert of_prop.sum() > 5
    np.testing.assert_array_equal(hits.geom_id[of_prop], -1)
    assert (hits.face[of_prop] >= 0).all()
    judge = in_mujoco(prop, model, data)
    as_geom = np.where(of_prop, judge.ngeom - 1, hits.geom_id)
    renamed = hits._replace(geom_id=as_geom, prop_id=np.full_like(hits.prop_id, -1))
    assert_none_wrong(judge, posed(judge), *rays(0, around), renamed)
    rig = rigcast.Rig(model, [Lidar(name="eye", mount=mount, elevation_deg=[0], columns=8)], "cpu", props=[prop])
    np.testing.assert_array_equal(rig.sense(data)["eye"].body_id.numpy(), body)


def cast(scene: Scene, filter_: Filter | None = None) -> NumpyHits:
    return scene.cast([[-5, 0, 0], [-5, 0, 2], [-5, 0, 4]], [[1, 0, 0]] * 3, filter=filter_).numpy()


def test_ids_are_places_in_the_list_and_files_in_use_twice_are_read_once(mesh_file: Path) -> None:
    mounts = [Mount(), Mount(pos=(0, 0, 2)), Mount(pos=(1, 0, 4))]
    props = [Prop(name=f"p{k}", file=mesh_file, mount=mount) for k, mount in enumerate(mounts)]
    model = model_of("")
    scene = Scene(model, "cpu", props)
    scene.update(posed(model))
    hits = cast(scene)
    np.testing.assert_array_equal(hits.prop_id, [0, 1, 2])
    np.testing.assert_allclose(hits.distance - hits.distance[0], [0, 0, 1], atol=1e-6)
    assert len({id(tree) for part in scene._parts for tree in part.trees}) == 1


def test_a_prop_goes_where_its_body_goes(mesh_file: Path) -> None:
    model = model_of('<body name="lift" mocap="true"><geom size="0.01" pos="0 0 -9"/></body>')
    data = posed(model)
    scene = Scene(model, "cpu", [Prop(name="load", file=mesh_file, mount=Mount(body="lift"))])
    for place, expected in (((0, 0, 0), [0, -1, -1]), ((0, 0, 4), [-1, -1, 0]), ((0, 9, 0), [-1, -1, -1])):
        data.mocap_pos[0] = place
        mujoco.mj_kinematics(model, data)
        scene.update(data)
        np.testing.assert_array_equal(cast(scene).prop_id, expected)


FILTERS = {
    "all": (Filter(), [0, 1, 2]),
    "excluded": (Filter(exclude_bodies=["free"]), [0, -1, 2]),
    "excluded subtree": (Filter(exclude_bodies=["free"], exclude_subtree=True), [0, -1, -1]),
    "moving": (Filter(static=False), [-1, 1, 2]),
    "groups": (Filter(geom_groups=[4]), [0, 1, 2]),
    "collision": (Filter(geometry="collision"), [0, 1, 2]),
    "visual": (Filter(geometry="visual"), [0, 1, 2]),
}


@pytest.mark.parametrize(("filter_", "expected"), FILTERS.values(), ids=FILTERS)
def test_a_prop_is_filtered_with_its_body(mesh_file: Path, filter_: Filter, expected: list[int]) -> None:
    model = model_of(
        '<body name="free" pos="0 0 2"><freejoint/><geom size="0.01" pos="0 9 0"/>'
        '<body name="arm" pos="0 0 2"><geom size="0.01" pos="0 9 0"/></body></body>'
    )
    mounts = [Mount(), Mount(body="free"), Mount(body="arm")]
    scene = Scene(model, "cpu", [Prop(name=f"p{k}", file=mesh_file, mount=m) for k, m in enumerate(mounts)])
    scene.update(posed(model))
    np.testing.assert_array_equal(cast(scene, filter_).prop_id, expected)


def test_a_prop_whose_pose_is_not_finite_is_named_once_and_not_hit(mesh_file: Path) -> None:
    model = model_of(CARRIER)
    data = posed(model)
    scene = Scene(model, "cpu", [Prop(name="load", file=mesh_file, mount=Mount(body="cart"))])
    data.xpos[1, 0] = np.nan
    with pytest.warns(RuntimeWarning, match="pose not finite at t = 0 s, not hit: prop 'load'"):
        scene.update(data)
    assert_missed(cast(scene))
    scene.update(data)


@pytest.mark.parametrize(("name", "how"), EXPORTS.items(), ids=EXPORTS)
def test_every_format_gives_the_same_triangles(tmp_path: Path, name: str, how: dict[str, str]) -> None:
    mesh = wedge()
    vertices, faces = read_mesh(exported(mesh, tmp_path / name, **how))
    np.testing.assert_allclose(vertices[faces], mesh.triangles, atol=1e-6)


def test_a_glb_scene_is_flattened_with_its_transforms(tmp_path: Path) -> None:
    part, scene = wedge(), trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0.2, 0.3))
    mirror = np.diag([1.0, -1.0, 2.0, 1.0])
    for k, transform in enumerate((np.eye(4), turn, mirror)):
        scene.add_geometry(part, node_name=f"n{k}", transform=transform)
    vertices, faces = read_mesh(exported(scene, tmp_path / "scene.glb", file_type="glb"))
    volumes = np.linalg.det(vertices[faces]).reshape(3, -1).sum(axis=1) / 6
    np.testing.assert_allclose(np.sort(volumes), part.volume * np.array([1, 1, 2]), rtol=1e-5)
    for transform in (turn, mirror):
        there = trimesh.transform_points(part.vertices, transform)
        gaps = np.linalg.norm(there[:, None] - vertices[None], axis=-1).min(axis=1)
        assert gaps.max() < 1e-6


def test_materials_and_foreign_letters_in_an_obj_are_ignored(tmp_path: Path) -> None:
    file = tmp_path / "a.obj"
    head = "mtllib gone.mtl\n# caf\xe9\no one\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    file.write_bytes(f"{head}usemtl red\nf 1 2 3 4\nusemtl blue\nf -1 -2 -3\n".encode("latin-1"))
    vertices, faces = read_mesh(file)
    normals = np.cross(*np.diff(vertices[faces], axis=1).transpose(1, 0, 2))
    assert sorted(normals[:, 2].tolist(), reverse=True) == [1, 1, -1]


def test_relative_indices_in_an_obj_count_from_their_face(tmp_path: Path) -> None:
    """trimesh itself counts them from the end of the file."""
    file = tmp_path / "a.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3/1/1 -2/2/1 \\\n-1/3/1\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf -3 -2 6\n")
    vertices, faces = read_mesh(file)
    expected = [[[0, 0, z], [1, 0, z], [0, 1, z]] for z in (0, 5)]
    np.testing.assert_array_equal(vertices[faces], expected)


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
BOX = trimesh.creation.box()
# What is no STL trimesh takes for text where charset-normalizer is installed, and finds nothing in it.
_NO_STL = r"(broken: neither whole \.stl binary nor text|no triangles in it)"
BAD_FILES: dict[str, tuple[str, bytes | None, str]] = {
    "missing": ("a.stl", None, "cannot be read: No such file"),
    "format": ("a.step", b"ISO-10303", r"not a mesh file, expected one of \.stl, \.obj, \.ply, \.glb"),
    "empty STL": ("a.stl", b"", "no triangles in it"),
    "empty OBJ": ("a.obj", b"", "no triangles in it"),
    "empty PLY": ("a.ply", b"", "broken, or not a .ply file: Not a ply file!"),
    "empty GLB": ("a.glb", b"", "broken, or not a .glb file"),
    "truncated STL": ("a.stl", BOX.export(file_type="stl")[:-30], _NO_STL),
    "truncated PLY": ("a.ply", BOX.export(file_type="ply")[:-30], "broken, or not a .ply file"),
    "truncated GLB": ("a.glb", BOX.export(file_type="glb")[:-30], "broken, or not a .glb file"),
    "count of 4e9": ("a.stl", b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 50, _NO_STL),
    "random STL": ("a.stl", np.random.default_rng(0).bytes(999), _NO_STL),
    "random PLY": ("a.ply", np.random.default_rng(0).bytes(999), "broken"),
    "random GLB": ("a.glb", np.random.default_rng(0).bytes(999), "broken"),
    "points": ("a.ply", PLY.replace("face 1", "face 0").encode() + b"0 0 0\n1 0 0\n0 1 0\n", "no triangles in it"),
    "index in PLY": (
        "a.ply",
        PLY.encode() + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
        "face 0: got vertex 9, expected 0 to 2",
    ),
    "index in OBJ": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 7\n", "index 6 is out of bounds"),
    "index 0 in OBJ": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "face with vertex 0, expected 1 to 3"),
    "index -4 in OBJ": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", "face with vertex -4, expected 1 to 3"),
    "NaN": ("a.ply", PLY.encode() + b"0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", r"vertex 1: got .*nan.*, expected finite"),
    "inf": ("a.ply", PLY.encode() + b"0 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n", r"vertex 1: got .*inf.*, expected finite"),
    "huge": (
        "a.ply",
        PLY.encode() + b"0 0 0\n1e30 0 0\n0 1 0\n3 0 1 2\n",
        r"got \[1\.0+.*e\+30.*expected finite numbers up to",
    ),
    "no area": ("a.ply", PLY.encode() + b"0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n", "no triangle in it has an area"),
}


@pytest.mark.parametrize(("name", "content", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_bad_file_is_refused_by_name(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match=rf"^prop 'it': .*/a\.\w+: .*{message}"):
        Scene(model_of(""), "cpu", [Prop(name="it", file=file)])


def test_triangles_without_area_are_left_out_and_counted(tmp_path: Path) -> None:
    file = tmp_path / "a.obj"
    file.write_text("v 0 -1 -1\nv 0 1 -1\nv 0 0 1\nf 1 2 3\nf 1 1 2\nf 2 3 3\n")
    with pytest.warns(UserWarning, match=r"prop 'it': .*a\.obj: 2 triangles without area left out") as caught:
        scene = Scene(model_of(""), "cpu", [Prop(name="it", file=file)])
    assert [warning.filename for warning in caught] == [__file__]
    scene.update(posed(model_of("")))
    assert scene.cast((-1, 0, 0), (1, 0, 0)).numpy().face == 0


BAD_SPECS = {
    "scale 0": ({"scale": 0}, "Prop 'it': scale: must be one number or three, none of them 0, got 0"),
    "two scales": ({"scale": (1, 2)}, r"scale: must be one number or three, none of them 0, got \(1, 2\)"),
    "text": ({"scale": "big"}, "scale: must be one number or three, none of them 0, got 'big'"),
    "inf": ({"scale": float("inf")}, "scale: must be one number or three, none of them 0, got inf"),
    "name": ({"name": "a/b"}, "name: .*must match"),
    "key": ({"fiel": "a"}, "unknown key 'fiel', .*did you mean 'file'"),
}


@pytest.mark.parametrize(("given", "message"), BAD_SPECS.values(), ids=BAD_SPECS)
def test_a_bad_specification_is_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Prop(**{"name": "it", "file": "a.stl", **given})  # type: ignore[arg-type]


def test_mounts_and_names_are_checked_against_the_model_and_each_other(mesh_file: Path) -> None:
    model = model_of(CARRIER)
    with pytest.raises(InputError, match=r"prop 'it': mount\.body: no body 'crt' .* did you mean 'cart'"):
        Scene(model, "cpu", [Prop(name="it", file=mesh_file, mount=Mount(body="crt"))])
    with pytest.raises(InputError, match="props: names must differ, got 'it' more than once"):
        rigcast.Rig(model, [], "cpu", props=[Prop(name="it", file=mesh_file)] * 2)


RIG = """\
model: world.xml
props:
  - {{name: load, file: {file}, mount: {{body: cart}}{more}}}
sensors:
  - {{name: eye, type: lidar, mount: {{pos: [1, 0.2, -0.3]}}, elevation_deg: [0], columns: 8}}
"""


def rig_file(tmp_path: Path, file: str, more: str = "") -> Path:
    folder = tmp_path / "rig"
    folder.mkdir(exist_ok=True)
    (folder / "world.xml").write_text(f"<mujoco><worldbody>{CARRIER}</worldbody></mujoco>")
    exported(wedge(), folder / "wedge.ply", file_type="ply")
    exported(wedge(), tmp_path / "other.ply", file_type="ply")
    (folder / "rig.yaml").write_text(RIG.format(file=file, more=more))
    return folder / "rig.yaml"


@pytest.mark.parametrize(
    ("file", "more"),
    [("wedge.ply", ""), ("./wedge.ply", ", scale: [1, 1, -1]"), ("../other.ply", ", allow_outside: true, scale: 2")],
)
def test_a_rig_file_has_props(tmp_path: Path, file: str, more: str) -> None:
    rig = rigcast.load_rig(rig_file(tmp_path, file, more), device="cpu")
    hits = rig.cast(mujoco.MjData(rig.model))["eye"].numpy()
    np.testing.assert_array_equal(hits.prop_id[hits.geom_id < 0], 0)
    assert np.isfinite(hits.distance).all()


BAD_KEYS = {
    "outside": ("../other.ply", "", r"3:24: props\[0\]\.file: '\.\./other\.ply' is outside of the rig file's folder"),
    "link": ("link.ply", "", r"3:24: props\[0\]\.file: 'link\.ply' is outside of the rig file's folder"),
    "absolute": ("/etc/hosts", "", r"3:24: props\[0\]\.file: '/etc/hosts' is outside"),
    "zero byte": ('"a\\0.ply"', "", r"3:24: props\[0\]\.file: .* is outside"),
    "missing": ("gone.ply", "", r"3:24: props\[0\]\.file: .*gone\.ply: cannot be read: No such file"),
    "folder": (".", "", r"3:24: props\[0\]\.file: .*: not a mesh file"),
    "no text": ("7", "", r"3:24: props\[0\]\.file: must be the path of a file, got 7"),
    "scale": ("wedge.ply", ", scale: [1, 0, 1]", r"3:\d+: props\[0\]\.scale: must be one number or three"),
    "body": ("wedge.ply", ", mont: 1", r"3:\d+: props\[0\]: unknown key|3:\d+: props\[0\]\.mont: unknown key 'mont'"),
}


@pytest.mark.parametrize(("file", "more", "message"), BAD_KEYS.values(), ids=BAD_KEYS)
def test_a_bad_prop_of_a_rig_file_is_shown_in_its_place(tmp_path: Path, file: str, more: str, message: str) -> None:
    rig = rig_file(tmp_path, file, more)
    (rig.parent / "link.ply").symlink_to(tmp_path / "other.ply")
    with pytest.raises(InputError, match=rf"rig\.yaml:{message}"):
        rigcast.load_rig(rig, device="cpu")


def test_names_repeated_in_a_rig_file_are_shown_in_their_place(tmp_path: Path) -> None:
    rig = rig_file(tmp_path, "wedge.ply")
    again = "  - {name: load, file: wedge.ply, mount: {body: crt}}\nsensors:"
    rig.write_text(rig.read_text().replace("sensors:", again))
    with pytest.raises(InputError) as caught:
        rigcast.load_rig(rig, device="cpu")
    assert "rig.yaml:4:12: props[1].name: 'load' is the name of props[0] already" in str(caught.value)


def test_rigcast_check_judges_props(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, found = rig_file(tmp_path, "wedge.ply"), tmp_path / "found.json"
    arguments = ["check", str(rig), "--rays", "100", "--device", "cpu", "--json", str(found)]
    monkeypatch.setattr("sys.argv", ["rigcast", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert ": 0 of" in capsys.readouterr().out
    assert json.loads(found.read_text())["wrong"] == 0
