"""Triangles of meshes in a model, and in STL, OBJ, PLY and GLB files, read by trimesh."""

import io
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rigcast.sensors.errors import InputError
from rigcast.sensors.names import expected_one_of

SUFFIXES = (".stl", ".obj", ".ply", ".glb")

_RELATIVE_FACE = re.compile(r"^\s*f\s(?:.*\s)?(?:-|0+(?:[/\s]|$))", re.MULTILINE)  # has an index below 1


def mesh_of_model(model: mujoco.MjModel, mesh: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Vertices (n, 3) [m] and faces (m, 3) of a mesh in the frame of its geoms; views of the model's arrays."""
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
    return vertices, model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]


def read_mesh(file: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 3) and faces (m, 3) of a mesh file, its parts placed as the file says and joined.

    Coordinates are taken as they stand: units and up axis (y in glTF) are for the mount and scale to set right.
    Materials are ignored.

    Raises:
        InputError: a file that is missing, of another format, broken, or without triangles, a face that names a
            vertex out of range, or a vertex that is not finite.
    """
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{file}: not a mesh file, {expected_one_of(suffix, SUFFIXES)}")
    try:
        content = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from None
    try:
        vertices, faces = _joined(_load(content, suffix.removeprefix(".")))
    except ImportError:  # trimesh looks for a guesser of text encodings when all else has failed
        raise InputError(f"{file}: broken: neither whole {suffix} binary nor text") from None
    except Exception as error:  # parsers raise anything on broken files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file}: broken, or not a {suffix} file: {reason:.200}") from None
    if not len(faces):
        raise InputError(f"{file}: no triangles in it")
    _require_sound(file, vertices, faces)
    return vertices, faces


def _load(content: bytes, file_type: str) -> Any:
    import trimesh  # imported here, because rigs without props do not need it

    if file_type == "obj":  # comments and names are often not in UTF-8
        content = _with_absolute_indices(content.decode(errors="replace")).encode()
    stream = io.BytesIO(content)
    return trimesh.load(stream, file_type=file_type, force="scene", process=False, skip_materials=True)


def _with_absolute_indices(obj: str) -> str:
    """The OBJ text with absolute vertex indices; trimesh misreads relative ones (-1: the last before the face)."""
    obj = obj.replace("\\\n", " ")
    if not _RELATIVE_FACE.search(obj):
        return obj
    lines, count = [], 0
    for line in obj.splitlines():
        words = line.split()
        if words[:1] == ["f"]:
            indices = [_absolute(int(word.split("/")[0]), count) for word in words[1:]]
            line = " ".join(["f", *map(str, indices)])
        count += words[:1] == ["v"]
        lines.append(line)
    return "\n".join(lines)


def _absolute(index: int, count: int) -> int:
    if not 0 < abs(index) <= count:
        raise ValueError(f"face with vertex {index}, expected 1 to {count} or -{count} to -1")
    return index if index > 0 else count + 1 + index


def _joined(scene: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces of all meshes of a trimesh scene in its frame, without points and curves."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not hasattr(mesh, "faces"):
            continue
        is_mirrored = np.linalg.det(transform[:3, :3]) < 0
        with np.errstate(all="ignore"):  # what is not finite is reported with its vertex
            vertices.append(np.asarray(mesh.vertices, np.float64) @ transform[:3, :3].T + transform[:3, 3])
        faces.append(np.asarray(mesh.faces, np.int64)[:, :: -1 if is_mirrored else 1] + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def _require_sound(file: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    out_of_range = (faces < 0) | (faces >= len(vertices))
    if out_of_range.any():
        face, corner = np.argwhere(out_of_range)[0]
        raise InputError(f"{file}: face {face}: got vertex {faces[face, corner]}, expected 0 to {len(vertices) - 1}")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise InputError(f"{file}: vertex {bad[0]}: got {vertices[bad[0]].tolist()}, expected finite numbers")
