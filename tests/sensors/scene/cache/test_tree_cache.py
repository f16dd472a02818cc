"""Triangle trees on disk are read if they are whole; else they are built."""

import multiprocessing
from collections.abc import Callable
from dataclasses import fields
from multiprocessing.pool import ThreadPool
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast import InputError, Scene
from rigcast.kernels.world.arrays import TriangleTree
from rigcast.kernels.world.triangle_tree import build_triangle_tree
from rigcast.sensors.scene.cache import on_disk as disk_cache
from rigcast.sensors.scene.cache import trees as tree_cache
from rigcast.sensors.scene.cache.trees import cached_triangle_tree
from rigcast.sensors.scene.parts.height_fields import hfield_triangles
from rigcast.sensors.scene.parts.model_geometry import Asset, read_model

HILLS = np.random.default_rng(0).random((30, 30), dtype=np.float32)
VERTICES, FACES = hfield_triangles(np.array([1.0, 1.0, 0.3, 0.1]), HILLS)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RIGCAST_CACHE", str(tmp_path / "trees"))
    return tmp_path / "trees"


@pytest.fixture
def builds(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list of the numbers of faces of trees that are built, not read."""
    built: list[int] = []

    def build(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> TriangleTree:
        built.append(len(faces))
        return build_triangle_tree(vertices, faces)

    monkeypatch.setattr(tree_cache, "build_triangle_tree", build)
    return built


def assert_same(got: TriangleTree, expected: TriangleTree) -> None:
    for field in fields(TriangleTree):
        a, b = (np.asarray(getattr(tree, field.name)) for tree in (got, expected))
        assert a.dtype == b.dtype, field.name
        assert a.tobytes() == b.tobytes(), field.name
    assert type(got.dropped) is int


def test_second_start_reads_the_same_tree(builds: list[int]) -> None:
    first, second = cached_triangle_tree(VERTICES, FACES), cached_triangle_tree(VERTICES, FACES)
    assert builds == [len(FACES)]
    assert_same(second, first)
    assert_same(second, build_triangle_tree(VERTICES, FACES))


def test_any_other_input_is_another_tree(builds: list[int]) -> None:
    moved = VERTICES.copy()
    moved[0, 2] = np.nextafter(moved[0, 2], 1.0)
    for vertices, faces in ((VERTICES, FACES), (moved, FACES), (VERTICES, FACES[::-1]), (VERTICES, FACES[:-1])):
        cached_triangle_tree(vertices, faces)
    assert len(builds) == 4


def test_another_builder_is_another_tree(builds: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    cached_triangle_tree(VERTICES, FACES)
    monkeypatch.setattr(disk_cache, "_makers", lambda: b"of another version")
    cached_triangle_tree(VERTICES, FACES)
    assert len(builds) == 2


@pytest.mark.parametrize("spoil", [lambda b: b[:0], lambda b: b[: len(b) // 2], lambda b: bytes(len(b))], ids=range(3))
def test_file_that_is_not_whole_is_built_anew(spoil: Callable[[bytes], bytes], builds: list[int], folder: Path) -> None:
    cached_triangle_tree(VERTICES, FACES)
    (file,) = folder.iterdir()
    file.write_bytes(spoil(file.read_bytes()))
    assert_same(cached_triangle_tree(VERTICES, FACES), build_triangle_tree(VERTICES, FACES))
    cached_triangle_tree(VERTICES, FACES)  # it was written anew
    assert len(builds) == 2


def test_one_flipped_bit_is_noticed(builds: list[int], folder: Path) -> None:
    cached_triangle_tree(VERTICES, FACES)
    (file,) = folder.iterdir()
    seed = 1
    for at in np.random.default_rng(seed).integers(0, file.stat().st_size, 40):
        whole = bytearray(file.read_bytes())
        whole[at] ^= 16
        file.write_bytes(whole)
        assert_same(cached_triangle_tree(VERTICES, FACES), build_triangle_tree(VERTICES, FACES))
    assert len(builds) > 30, f"seed {seed}"  # a few of a zip file's bytes say nothing, such as its dates


def test_off_writes_nothing(builds: list[int], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIGCAST_CACHE", "off")
    cached_triangle_tree(VERTICES, FACES)
    cached_triangle_tree(VERTICES, FACES)
    assert len(builds) == 2
    assert not folder.exists()


def test_small_trees_are_not_kept(folder: Path) -> None:
    cached_triangle_tree(VERTICES, FACES[: tree_cache.FEWEST_FACES - 1])
    assert not folder.exists()


def test_faults_are_those_of_the_builder(folder: Path) -> None:
    bad = FACES.copy()
    bad[5, 1] = -7
    with pytest.raises(ValueError, match="face 5: got vertex -7"):
        cached_triangle_tree(VERTICES, bad)
    assert not folder.exists()


def test_folder_that_cannot_be_written_is_one_warning(folder: Path) -> None:
    folder.write_text("a file where the folder should be")
    with pytest.warns(RuntimeWarning, match="nothing can be kept there"):
        assert_same(cached_triangle_tree(VERTICES, FACES), build_triangle_tree(VERTICES, FACES))


def test_trees_used_longest_ago_make_room(builds: list[int], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def kept(last: int) -> set[Path]:
        before = set(folder.glob("*.npz"))
        cached_triangle_tree(VERTICES, FACES[:-last])
        return set(folder.glob("*.npz")) - before

    (oldest,), (older,) = kept(1), kept(2)
    cached_triangle_tree(VERTICES, FACES[:-1])  # used again, so the other is now the oldest
    monkeypatch.setattr(disk_cache, "MAX_BYTES", int(2.5 * oldest.stat().st_size))
    (newest,) = kept(3)
    assert set(folder.glob("*.npz")) == {oldest, newest}
    assert older not in (oldest, newest)
    assert len(builds) == 3


def _start(_: int) -> int:
    return len(cached_triangle_tree(VERTICES, FACES).blocks)


def test_several_processes_at_once(folder: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        assert len(set(pool.map(_start, range(6)))) == 1
    assert len(list(folder.iterdir())) == 1


def test_folders_that_others_remove_meanwhile_are_passed_over(folder: Path) -> None:
    """Writers have temporary folders, which disappear while others look for room."""
    with ThreadPool(4) as pool:
        pool.map(lambda k: disk_cache.keep_arrays({"k": np.zeros(k)}, folder / f"{k}.npz"), range(150))
    assert len(list(folder.glob("*.npz"))) == 150


def test_scene_reads_its_height_field_and_keeps_nothing(builds: list[int], folder: Path) -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco>
      <asset><hfield name="hills" nrow="30" ncol="30" size="1 1 .3 .1"/></asset>
      <worldbody><geom type="hfield" hfield="hills"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = Scene(model, "cpu")
    model.hfield_data[:] = HILLS.ravel()
    scene.update(data)
    assert not builds
    assert not folder.exists()
    assert float(scene.cast((0.0, 0.0, 5.0), (0.0, 0.0, -1.0)).numpy().distance) < 5.0
    model.hfield_data[0] = np.nan
    with pytest.raises(InputError, match="hfield 'hills'"):
        scene.update(data)


def _meshes(spheres: int, move: float = 0.0) -> mujoco.MjModel:
    """Spheres of 320 faces each, the last one moved."""
    points = np.random.default_rng(3).normal(size=(spheres, 162, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    points[-1, 0] *= 1.0 + move
    assets = "".join(f'<mesh name="m{k}" vertex="{" ".join(map(str, v.ravel()))}"/>' for k, v in enumerate(points))
    geoms = "".join(f'<geom type="mesh" mesh="m{k}"/>' for k in range(spheres))
    return mujoco.MjModel.from_xml_string(f"<mujoco><asset>{assets}</asset><worldbody>{geoms}</worldbody></mujoco>")


def test_small_meshes_of_a_model_are_kept_in_one_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = _meshes(5)
    first = read_model(model)
    with monkeypatch.context() as patched:
        patched.setattr(Asset, "tree", None)  # which builds
        second = read_model(model)
    (file,) = folder.iterdir()
    for kept, built, asset in zip(second.trees, first.trees, first.assets, strict=True):
        assert_same(kept, built)
        assert_same(kept, asset.tree(model))
    read_model(_meshes(5, 1e-3))
    assert len(list(folder.iterdir())) == 2
    file.write_bytes(file.read_bytes()[:-100])
    assert_same(read_model(model).trees[4], first.trees[4])


def test_few_small_meshes_are_not_kept(folder: Path) -> None:
    read_model(_meshes(2))
    assert not folder.exists()


def test_a_fault_in_a_small_mesh_names_it(folder: Path) -> None:
    model = _meshes(5)
    model.mesh_vert[model.mesh_vertadr[3]] = np.nan
    with pytest.raises(InputError, match="mesh 'm3'"):
        read_model(model)
    assert not folder.exists()
