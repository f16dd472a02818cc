"""Write docs/accuracy.md: rigcast and its peers on the same hard rays, judged by mj_ray with the same code.

    python benchmarks/accuracy.py          needs the extras `dev` and `benchmark`; takes a few minutes

A peer that is not installed is named in the report as missing.
"""

import copy
import platform
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import warp as wp
from judged import Batch, Row, judge, rows
from pictures import picture, sheet, view

import rigcast
from rigcast.bench.casters import Caster, Floats, load_casters
from rigcast.bench.casters.with_rigcast import RigcastCaster
from rigcast.oracle import Verdict
from rigcast.quiet import quiet_warp

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests" / "oracle"))
import scenes  # noqa: E402  the random scenes and rays of the tests
from other_kinds import other_batches  # noqa: E402

PAGE = ROOT / "docs" / "accuracy.md"
FOLDER = ROOT / "docs" / "accuracy"
SEEDS = range(8)
RAYS = 60  # of each kind in each scene
PICTURED = 4  # the seed of the random scene in the pictures
FAR = (1.0e4, 2.0e4)  # [m] from the origin
WAREHOUSE_RAYS = 600  # of each sensor
COMPARED = ("rigcast", "mj_multiRay", "MuJoCo-LiDAR", "mujoco_warp")


def random_batches(far: bool) -> Iterator[Batch]:
    """Yield rays of every kind in random scenes; far: the whole scene 10 to 20 km from the origin."""
    for seed in SEEDS:
        model = seen_by_all(scenes.scene(seed))
        data = posed(model, scenes.state(model, seed, 1))
        by = offset(seed) if far else np.zeros(3)
        there = moved(data, by)
        for kind in scenes.KINDS:
            origins, directions = (part[:RAYS] for part in scenes.rays(model, data, seed, 1, kind))
            yield Batch(model, there, origins + by, unit(directions))


def warehouse_batches() -> Iterator[Batch]:
    """Yield random rays of each of the demo's sensors, in the world without what the sensor's filter hides."""
    rig, data = driving()
    rng = np.random.default_rng(0)
    rays = rig.rays(data)
    for sensor in rig.sensors:
        of = rays[sensor.name]
        directions = of.directions.reshape(-1, 3)
        origins = np.broadcast_to(of.origins, of.directions.shape).reshape(-1, 3)
        drawn = rng.choice(len(directions), WAREHOUSE_RAYS, replace=False)
        seen = out_of_the_way(rig.model, data, sensor.filter)
        yield Batch(rig.model, seen, origins[drawn].astype(float), unit(directions[drawn].astype(float)))


def driving() -> tuple[rigcast.Rig, mujoco.MjData]:
    """Return the demo's rig and its world after 0.5 s of driving."""
    rig = rigcast.load_rig(ROOT / "configs" / "demo.yaml", device="cpu")
    data = mujoco.MjData(rig.model)
    mujoco.mj_resetDataKeyframe(rig.model, data, rig.model.keyframe("drive").id)
    for _ in range(round(0.5 / rig.model.opt.timestep)):
        mujoco.mj_step(rig.model, data)
    return rig, posed(rig.model, data)


def out_of_the_way(model: mujoco.MjModel, data: mujoco.MjData, filter: rigcast.Filter) -> mujoco.MjData:
    """Return a copy in which geoms that the filter hides, and transparent ones, lie 1000 km below everything."""
    there = copy.copy(data)
    there.geom_xpos[~filter.visible(model), 2] -= 1e6
    return there


def views() -> Iterator[tuple[str, Batch]]:
    """Yield what the pictures show: the warehouse from a corner, and one random scene, near and far."""
    rig, data = driving()
    world = out_of_the_way(rig.model, data, rigcast.Filter())
    eye = np.array([5.5, -2.9, 3.2])
    directions = view(eye, np.array([-2.5, 0.6, 0.5]))
    yield "warehouse", Batch(rig.model, world, np.tile(eye, (len(directions), 1)), directions)
    model = seen_by_all(scenes.scene(PICTURED))
    data = posed(model, scenes.state(model, PICTURED, 1))
    eye = np.array([5.0, -5.0, 4.0])
    directions = view(eye, np.zeros(3))
    for name, by in (("random_near", np.zeros(3)), ("random_far", offset(PICTURED))):
        yield name, Batch(model, moved(data, by), np.tile(eye + by, (len(directions), 1)), directions)


def seen_by_all(model: mujoco.MjModel) -> mujoco.MjModel:
    """Make all geoms opaque, in place, and return the model: not every peer leaves out what mj_ray does."""
    model.geom_matid[:] = -1
    model.geom_rgba[:, 3] = 1.0
    return model


def posed(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """Return a copy after mj_forward, in which everything that the casters read is up to date."""
    forward = copy.copy(data)
    mujoco.mj_forward(model, forward)
    return forward


def moved(data: mujoco.MjData, by: Floats) -> mujoco.MjData:
    """Return a copy with all bodies and geoms moved by a vector [m]."""
    there = copy.copy(data)
    for poses in (there.xpos, there.xipos, there.geom_xpos):
        poses += by
    return there


def offset(seed: int) -> Floats:
    """Return a vector (3,) 10 to 20 km long [m] in a random direction."""
    rng = np.random.default_rng((seed, 9))
    towards = rng.normal(size=3)
    vector: Floats = towards / np.linalg.norm(towards) * rng.uniform(*FAR)
    return vector


def unit(vectors: Floats) -> Floats:
    normalised: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return normalised


def table(batches: list[Batch], casters: list[type[Caster]]) -> str:
    """Return one table: for each type of geom, the rows of all casters."""
    return lines_of({c.name: list(rows(batches, [judge(c, batch) for batch in batches])) for c in casters})


def table_of_other_kinds() -> str:
    """Return the table of SDF geoms, flexes, skins and props."""
    with tempfile.TemporaryDirectory() as folder:
        batches = list(other_batches(Path(folder)))
        found = [judge(partial(RigcastCaster, props=batch.props), batch) for batch in batches]
    return lines_of({RigcastCaster.name: list(rows(batches, found))})


def lines_of(by_caster: dict[str, list[Row]]) -> str:
    """Return the lines of a table, type by type."""
    order = list(dict.fromkeys(row.geom_type for found in by_caster.values() for row in found))
    order = [*(name for name in order if name not in ("none", "all")), "none", "all"]
    lines = [
        "| geom | caster | rays | agree | edge band | wrong | worst [m] | 99.9 % [m] |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name in order:
        for caster, found in by_caster.items():
            lines += [line(caster, row) for row in found if row.geom_type == name]
    return "\n".join(lines)


def line(caster: str, row: Row) -> str:
    """Return one line of a table."""
    wrong = f"{row.wrong} ({row.wrong / row.rays:.1%})" if row.wrong else "**0**"
    errors = " | ".join("" if np.isnan(error) else f"{error:.1e}" for error in (row.worst, row.p999))
    return f"| {row.geom_type} | {caster} | {row.rays} | {row.agree} | {row.edge} | {wrong} | {errors} |"


def draw(casters: list[type[Caster]]) -> str:
    """Write the pictures, return the lines that show them."""
    FOLDER.mkdir(exist_ok=True)
    lines = []
    for name, batch in views():
        pictures = {}
        for caster in casters:
            found = judge(caster, batch)
            wrong = (found.verdict == Verdict.WRONG).mean()
            pictures[f"{caster.name}: {wrong:.2%} wrong"] = picture(batch, found)
        sheet(pictures).quantize(64).save(FOLDER / f"{name}.png", optimize=True)
        lines.append(f"![{CAPTIONS[name]}](accuracy/{name}.png)\n\n*{CAPTIONS[name]}*\n")
    return "\n".join(lines)


CAPTIONS = {
    "warehouse": "The demo's warehouse.",
    "random_near": "A random scene at the origin.",
    "random_far": "The same scene more than 10 km away: float32 poses are no longer where the geoms are.",
}

OTHER_KINDS = """## What the others do not cast against: SDF geoms, flexes, skins, props

- Flexes and skins, which `mj_ray` does not see, are compared with `mj_rayFlex` and `mju_raySkin`, ray by ray.
- Props are compared with `mj_ray` on a model of their meshes.
- SDF geoms are compared with `mj_ray` on a mesh geom with the mesh that rigcast casts against; [SDF geoms](sdf.md) has
  the difference from `mj_ray`'s sphere tracing.

The scenes are those of mujoco_warp's tests for SDF geoms, ropes, cloth, soft bodies and moving skins, and three meshes
as props, each near the origin and 10 km away.
"""

HEAD = """# Accuracy

*Written by `make accuracy` (`python benchmarks/accuracy.py`); not edited by hand.*

Every ray is compared with MuJoCo's `mj_ray`, in float64, by the single definition in `rigcast.oracle.judge`. With t in
metres and n_ref the reference normal:

- it **agrees** when hit or miss, geom, distance (|t - t_ref| <= 1e-5 (1 + t) / max(|d . n_ref|, 1e-3)) and normal are
  those of `mj_ray`;
- it is **in the edge band** when a ray moved by at most 1e-5 (1 + t) and turned by at most 1e-5 rad makes `mj_ray` give
  that answer;
- otherwise it is **wrong**.

*Worst* and *99.9 %* are of |t - t_ref| over rays that agree. A ray counts under the type of the geom that `mj_ray`
hits, or, if only the caster hits, under the caster's; `none` is where both miss.

- Each caster gets the same rays, through the same code, on the CPU.
- Filters and transparency are not part of this: nothing in the random scenes is transparent, and what the warehouse's
  sensors must not see is moved out of the way.
- MuJoCo-LiDAR reports distances only; its ids and normals are taken from `mj_ray`, in its favour. Its rays are cast one
  by one, so that each has its own origin, with a cutoff of 1000 km.

Two things to know about the random scenes: two of the six kinds of rays run exactly at vertices and edges or within
faces, hence the many in the edge band. And a plane is one-sided in `mj_ray` but two-sided in MuJoCo-LiDAR, where it
then hides what is behind it, of whatever type.
"""


def main() -> None:
    """Judge all casters, write the page and its pictures."""
    quiet_warp()
    casters, missing = load_casters(COMPARED)
    sets = {
        f"Random scenes of all geom types: {len(scenes.KINDS)} kinds of hard rays in {len(SEEDS)} scenes": list(
            random_batches(far=False)
        ),
        "The same scenes, 10 to 20 km from the origin": list(random_batches(far=True)),
        "The demo's warehouse, rays of its sensors": list(warehouse_batches()),
    }
    versions = ", ".join(f"{caster.name} {caster.version}" for caster in casters)
    machine = f"MuJoCo {mujoco.__version__}, Warp {wp.__version__}, numpy {np.__version__}, {platform.machine()}"
    parts = [HEAD, f"Compared: {versions}; with {machine}.\n"]
    parts += [f"Not compared: {reason}\n" for reason in missing]
    parts += [f"## {title}\n\n{table(batches, casters)}\n" for title, batches in sets.items()]
    parts += [f"{OTHER_KINDS}\n{table_of_other_kinds()}\n"]
    parts += ["## Where they disagree\n\nRed: wrong. Orange: edge band. Grey: agrees, darker farther away.\n"]
    PAGE.write_text("\n".join([*parts, draw(casters)]))


if __name__ == "__main__":
    main()
