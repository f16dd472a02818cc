"""Rays at what only rigcast casts against: SDF geoms by their meshes, flexes, skins and props."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import deformables
import mujoco
import numpy as np
import scenes
import trimesh
from judged import Batch

import rigcast
from rigcast.bench.casters import Floats

RAYS = 2000  # of each batch
STATES = 3
FAR = np.array((7e3, -7e3, 1e3))  # [m]
SDF_SCENES = ("cow", "mesh", "nutbolt", "tactile")


def other_batches(folder: Path) -> Iterator[Batch]:
    """Yield rays at each kind, near the origin and 10 km away; the props' mesh files are written to the folder."""
    for batch in (*_sdf(), *_deformable(), *_props(folder)):
        yield batch
        there = deformables.shifted(batch.data, FAR)
        props = tuple(_moved(prop) for prop in batch.props)
        yield Batch(batch.model, there, batch.origins + FAR, batch.directions, props)


def _sdf() -> Iterator[Batch]:
    """The SDF scenes of mujoco_warp's tests."""
    package = importlib.util.find_spec("mujoco_warp")
    assert package is not None
    assert package.origin is not None
    for name in SDF_SCENES:
        file = Path(package.origin).parent / "test_data" / "collision_sdf" / f"{name}.xml"
        model = mujoco.MjModel.from_xml_path(str(file))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        geoms = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SDF)
        rng = np.random.default_rng(len(name))
        of = rng.choice(geoms, RAYS)
        reach = model.geom_rbound[of, None]
        targets = data.geom_xpos[of] + 0.7 * reach * rng.uniform(-1, 1, (RAYS, 3))
        origins = data.geom_xpos[of] + 2 * reach * _unit(rng.normal(size=(RAYS, 3)))
        yield Batch(model, data, origins, _unit(targets - origins))


def _deformable() -> Iterator[Batch]:
    """The moving flexes and skins of the tests."""
    for xml in (f"<worldbody>{deformables.FLEXES['all']}</worldbody>", deformables.SKINS):
        model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
        for k in range(STATES):
            data = deformables.moved(model, 0, k)
            rays = deformables.rays_towards(deformables.targets(model, data), 0, k)
            yield Batch(model, data, *rays)


def _props(folder: Path) -> Iterator[Batch]:
    """Three meshes, one of them on a body, scaled and mirrored."""
    rng = np.random.default_rng(0)
    shapes = {
        "cone": trimesh.creation.cone(0.4, 0.8),
        "ring": trimesh.creation.torus(0.5, 0.2),
        "ball": scenes.bumpy_sphere(rng),
    }
    for name, mesh in shapes.items():
        mesh.export(folder / f"{name}.ply")
    props = (
        rigcast.Prop(name="cone", file=folder / "cone.ply", mount=rigcast.Mount(body="cart", euler_deg=(10, 20, 30))),
        rigcast.Prop(name="ring", file=folder / "ring.ply", mount=rigcast.Mount(pos=(1.5, 0, 0)), scale=(-1, 1, 2)),
        rigcast.Prop(name="ball", file=folder / "ball.ply", mount=rigcast.Mount(pos=(0, 2, 0)), scale=0.5),
    )
    xml = '<mujoco><worldbody><body name="cart"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    centers = np.array([(0, 0, 0), (1.5, 0, 0), (0, 2, 0)], float)[rng.integers(3, size=RAYS)]
    targets = centers + 0.4 * rng.normal(size=(RAYS, 3))
    origins = centers + 3 * _unit(rng.normal(size=(RAYS, 3)))
    yield Batch(model, data, origins, _unit(targets - origins), props)


def _moved(prop: rigcast.Prop) -> rigcast.Prop:
    """Return the prop moved by FAR if it is mounted on the world; one on a body moves with it."""
    if prop.mount.parent != "world":
        return prop
    place = tuple((np.array(prop.mount.pos) + FAR).tolist())
    return prop.model_copy(update={"mount": prop.mount.model_copy(update={"pos": place})})


def _unit(vectors: Floats) -> Floats:
    normalised: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return normalised
