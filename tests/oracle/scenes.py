"""Random MuJoCo scenes of every supported geom type, and rays through them, each a function of a seed.

`scene(seed)` is the model, `state(model, seed, k)` its k-th state and `rays(model, data, seed, k, kind)` the
rays of a kind through that state: a failure names these, and `python -i tests/oracle/scenes.py SEED STATE
KIND RAY` replays it.
"""

import sys
from collections.abc import Callable

import mujoco
import numpy as np
import numpy.typing as npt
import trimesh

Floats = npt.NDArray[np.float64]
Rng = np.random.Generator

ROOM = 3.0  # geoms have their centres within this of the origin along each axis [m]
SOLIDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
RAYS = 600  # of each kind in each state
MATERIALS = {"opaque": 1.0, "faint": 0.01, "clear": 0.0}


def scene(seed: int) -> mujoco.MjModel:
    """Return a random model: planes, hfields, and a forest of moving bodies with solids and meshes."""
    return mujoco.MjModel.from_xml_string(scene_xml(seed))


def scene_xml(seed: int) -> str:
    """Return the MJCF of a random scene, all of it in one string."""
    rng = np.random.default_rng((seed, 0))
    meshes = {f"mesh{i}": mesh_xml(f"mesh{i}", rng) for i in range(3)}
    hfields = {f"hfield{i}": hfield_xml(f"hfield{i}", rng) for i in range(2)}
    static = [plane_xml(rng), plane_xml(rng)] + [hfield_geom_xml(name, rng) for name in hfields]
    static += [geom_xml(rng, tuple(meshes)) for _ in range(2)]
    bodies = [body_xml(rng, tuple(meshes), depth=0, name=f"b{i}") for i in range(4)]
    materials = [f'<material name="{name}" rgba="1 1 1 {alpha}"/>' for name, alpha in MATERIALS.items()]
    assets = "\n".join([*materials, *meshes.values(), *hfields.values()])
    return f"<mujoco><asset>{assets}</asset><worldbody>" + "\n".join(static + bodies) + "</worldbody></mujoco>"


def state(model: mujoco.MjModel, seed: int, k: int) -> mujoco.MjData:
    """Return the k-th random state of a model, its poses computed."""
    rng = np.random.default_rng((seed, 1, k))
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 0.5 * k)
    mujoco.mj_kinematics(model, data)
    return data


def numbers(values: npt.ArrayLike) -> str:
    """Return numbers as the text of an MJCF attribute."""
    return " ".join(f"{value:.9g}" for value in np.ravel(values))


def mesh_xml(name: str, rng: Rng) -> str:
    """Return a mesh asset: one of several shapes, scaled unevenly, mirrored one time in three."""
    shapes: tuple[Callable[[], trimesh.Trimesh], ...] = (
        lambda: trimesh.creation.torus(0.5, 0.2, major_sections=16, minor_sections=9),
        lambda: trimesh.creation.annulus(0.2, 0.5, 0.6, sections=9),
        lambda: trimesh.creation.cone(0.5, 1.0, sections=7),
        lambda: trimesh.creation.box((0.8, 0.5, 0.3)),
        lambda: bumpy_sphere(rng),
    )
    mesh = shapes[rng.integers(len(shapes))]()
    scale = np.exp(rng.uniform(-1, 0.7, 3)) * np.where(rng.random() < 1 / 3, (-1, 1, 1), (1, 1, 1))
    return (
        f'<mesh name="{name}" scale="{numbers(scale)}" vertex="{numbers(mesh.vertices)}" '
        f'face="{" ".join(map(str, mesh.faces.ravel()))}"/>'
    )


def bumpy_sphere(rng: Rng) -> trimesh.Trimesh:
    """Return a sphere with every vertex pulled in or out: closed, and not convex."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    mesh.vertices *= rng.uniform(0.6, 1.2, (len(mesh.vertices), 1))
    return mesh


def hfield_xml(name: str, rng: Rng) -> str:
    """Return a height field asset with valleys down to its base and uneven cells."""
    rows, columns = rng.integers(2, 12, 2)
    heights = np.maximum(rng.uniform(-0.5, 1, (rows, columns)), 0)
    size = [*rng.uniform(0.5, 2.5, 2), rng.uniform(0.2, 1.2), rng.uniform(0.05, 0.5)]
    grid = f'nrow="{rows}" ncol="{columns}" elevation="{numbers(heights)}"'
    return f'<hfield name="{name}" size="{numbers(size)}" {grid}/>'


def pose_xml(rng: Rng, reach: float = ROOM) -> str:
    """Return a random position, and an orientation that is turned by quarters one time in two."""
    quarter = np.eye(4)[rng.integers(4)] + np.eye(4)[rng.integers(4)]
    quaternion = quarter if rng.random() < 0.5 else rng.normal(size=4)
    return f'pos="{numbers(rng.uniform(-reach, reach, 3))}" quat="{numbers(quaternion)}"'


def look_xml(rng: Rng) -> str:
    """Return the attributes on which the visibility of a geom depends: group, collisions, alpha, material."""
    alpha = rng.choice([1.0, 1.0, 1.0, 0.01, 0.0])
    material = rng.choice(["", "", "", *MATERIALS])
    collides = rng.integers(2)
    return f'group="{rng.integers(6)}" contype="{collides}" conaffinity="{collides}" rgba="1 1 1 {alpha}" ' + (
        f'material="{material}"' if material else ""
    )


def plane_xml(rng: Rng) -> str:
    """Return a plane: infinite along x, y, both or neither, tilted or level."""
    size = np.where(rng.random(2) < 0.4, 0, rng.uniform(0.5, 4, 2))
    return f'<geom type="plane" size="{numbers(size)} 1" {pose_xml(rng)} {look_xml(rng)}/>'


def hfield_geom_xml(name: str, rng: Rng) -> str:
    """Return a height field in a pose of its own."""
    return f'<geom type="hfield" hfield="{name}" {pose_xml(rng)} {look_xml(rng)}/>'


def geom_xml(rng: Rng, meshes: tuple[str, ...], reach: float = ROOM) -> str:
    """Return a solid of 2 cm to 1.5 m or a mesh."""
    kind = rng.choice([*SOLIDS, "mesh", "mesh"])
    what = f'mesh="{rng.choice(meshes)}"' if kind == "mesh" else f'size="{numbers(np.exp(rng.uniform(-4, 0.4, 3)))}"'
    return f'<geom type="{kind}" {what} {pose_xml(rng, reach)} {look_xml(rng)}/>'


def body_xml(rng: Rng, meshes: tuple[str, ...], depth: int, name: str) -> str:
    """Return a body with one to three overlapping geoms, at most one joint, and children."""
    joint = rng.choice(["<freejoint/>" if depth == 0 else '<joint type="ball"/>', '<joint axis="1 2 3"/>', ""])
    geoms = [geom_xml(rng, meshes, reach=0.2) for _ in range(rng.integers(1, 4))]
    children = [body_xml(rng, meshes, depth + 1, f"{name}_{i}") for i in range(rng.integers(0, 3 - depth))]
    mass = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    pose = pose_xml(rng, ROOM / (1 + depth))
    return f'<body name="{name}" {pose}>{joint}{mass}{"".join(geoms + children)}</body>'


def rays(model: mujoco.MjModel, data: mujoco.MjData, seed: int, k: int, kind: str) -> tuple[Floats, Floats]:
    """Return origins and directions, (RAYS, 3) each, of one of KINDS; directions are 1e-3 to 1e3 long."""
    rng = np.random.default_rng((seed, 2, k, tuple(KINDS).index(kind)))
    origins, directions = KINDS[kind](model, data, rng, RAYS)
    lengths = 10.0 ** rng.uniform(-3, 3, (RAYS, 1))
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True) * lengths


def _everywhere(model: mujoco.MjModel, data: mujoco.MjData, rng: Rng, count: int) -> tuple[Floats, Floats]:
    del model, data
    return rng.uniform(-1.5 * ROOM, 1.5 * ROOM, (count, 3)), rng.normal(size=(count, 3))


def _towards(model: mujoco.MjModel, data: mujoco.MjData, rng: Rng, count: int) -> tuple[Floats, Floats]:
    origins, _ = _everywhere(model, data, rng, count)
    geoms = rng.integers(model.ngeom, size=count)
    reach = np.where(model.geom_rbound[geoms] > 0, model.geom_rbound[geoms], 2.0)[:, None]
    return origins, data.geom_xpos[geoms] + reach * rng.uniform(-0.6, 0.6, (count, 3)) - origins


def _inside(model: mujoco.MjModel, data: mujoco.MjData, rng: Rng, count: int) -> tuple[Floats, Floats]:
    geoms = rng.integers(model.ngeom, size=count)
    return _points(model, data, geoms, rng.uniform(-0.6, 0.6, (count, 3))), rng.normal(size=(count, 3))


def _axis_aligned(model: mujoco.MjModel, data: mujoco.MjData, rng: Rng, count: int) -> tuple[Floats, Floats]:
    """Along the world's axes or a geom's own, from anywhere or exactly from the faces of the geom's box."""
    axes = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))
    geoms = rng.integers(model.ngeom, size=count)
    within = rng.uniform(-1, 1, (count, 3))
    within[np.arange(count), rng.integers(3, size=count)] = rng.choice([-1.0, 0.0, 1.0], count)
    origins = np.where(
        rng.random((count, 1)) < 0.3,
        rng.uniform(-1.5 * ROOM, 1.5 * ROOM, (count, 3)),
        _points(model, data, geoms, within),
    )
    turned = np.einsum("nij,nj->ni", data.geom_xmat[geoms].reshape(-1, 3, 3), axes)
    return origins, np.where(rng.random((count, 1)) < 0.5, axes, turned)


def _grazing(model: mujoco.MjModel, data: mujoco.MjData, rng: Rng, count: int) -> tuple[Floats, Floats]:
    """Past a face of a geom's box, almost or exactly in the face's own plane."""
    geoms = rng.integers(model.ngeom, size=count)
    start, end = rng.uniform(-2, 2, (2, count, 3))
    face = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
    each = np.arange(count)
    start[each, face[0]] = face[1]
    end[each, face[0]] = face[1] * (1 - rng.choice([0, 1e-6, 1e-4, 1e-2], count))
    origins = _points(model, data, geoms, start)
    return origins, _points(model, data, geoms, end) - origins


def _vertices(model: mujoco.MjModel, data: mujoco.MjData, rng: Rng, count: int) -> tuple[Floats, Floats]:
    """From anywhere exactly at a vertex, or the middle of an edge, of a mesh."""
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    origins, directions = _everywhere(model, data, rng, count)
    for ray, geom in enumerate(rng.choice(meshes, count) if len(meshes) else ()):
        mesh = model.geom_dataid[geom]
        face = model.mesh_face[model.mesh_faceadr[mesh] + rng.integers(model.mesh_facenum[mesh])]
        corners = model.mesh_vert[model.mesh_vertadr[mesh] + face].astype(float)
        target = corners[0] if rng.random() < 0.5 else corners[:2].mean(axis=0)
        directions[ray] = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ target - origins[ray]
    return origins, directions


KINDS: dict[str, Callable[[mujoco.MjModel, mujoco.MjData, Rng, int], tuple[Floats, Floats]]] = {
    "everywhere": _everywhere,
    "towards": _towards,
    "inside": _inside,
    "axis_aligned": _axis_aligned,
    "grazing": _grazing,
    "vertices": _vertices,
}


def _points(model: mujoco.MjModel, data: mujoco.MjData, geoms: npt.NDArray[np.int64], unit: Floats) -> Floats:
    """Return the world positions of points given in units of the half sizes of the geoms' boxes."""
    centre, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    infinite = half > 1e3  # planes
    local = np.where(infinite, 0, centre) + unit * np.where(infinite, ROOM, half)
    turned = np.einsum("nij,nj->ni", data.geom_xmat[geoms].reshape(-1, 3, 3), local)
    points: Floats = data.geom_xpos[geoms] + turned
    return points


if __name__ == "__main__":
    from rigcast import oracle

    seed, k, kind, ray = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    model = scene(seed)
    data = state(model, seed, k)
    origins, directions = rays(model, data, seed, k, kind)
    print("origin", origins[ray].tolist(), "direction", directions[ray].tolist())
    print(oracle.Oracle(model, data).cast(origins[ray], directions[ray : ray + 1]))
