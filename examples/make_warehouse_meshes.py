"""Make the mesh files and the ramp of the warehouse demo (configs/warehouse).

    python examples/make_warehouse_meshes.py [FOLDER]

Every part is lofted: rings of equally many points, neighbouring rings joined by triangles, the two end rings
closed by fans, all wound outward. Parts that touch or overlap stay as they are: ray casting needs no union.
Metres, z up; robot links start at their joint and extend along +x.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from trimesh import Trimesh

Points = NDArray[np.float64]

WAREHOUSE = Path(__file__).resolve().parent.parent / "configs" / "warehouse"


def loft(rings: Sequence[ArrayLike], closed: bool = False) -> Trimesh:
    """Join rings of n points, each (n, 3), into a solid with flat ends or, `closed`, into a torus."""
    points = np.asarray(rings, dtype=np.float64)
    count, n = points.shape[:2]
    grid = np.arange(count * n).reshape(count, n)
    lower, upper = (grid, np.roll(grid, -1, 0)) if closed else (grid[:-1], grid[1:])
    lower_next, upper_next = np.roll(lower, -1, 1), np.roll(upper, -1, 1)
    sides = [np.stack([lower, lower_next, upper_next], -1), np.stack([lower, upper_next, upper], -1)]
    faces = [side.reshape(-1, 3) for side in sides]
    if not closed:
        fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], -1)
        faces += [grid[0][fan[:, ::-1]], grid[-1][fan]]
    mesh = Trimesh(points.reshape(-1, 3), np.concatenate(faces))
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def join(*parts: Trimesh) -> Trimesh:
    return trimesh.util.concatenate(parts)


def moved(mesh: Trimesh, offset: ArrayLike) -> Trimesh:
    return mesh.copy().apply_translation(offset)


def turned(mesh: Trimesh, angle_deg: float, axis: ArrayLike) -> Trimesh:
    return mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(np.radians(angle_deg), axis))


def at_height(outline: ArrayLike, z: float) -> Points:
    xy = np.asarray(outline, dtype=np.float64)
    return np.column_stack([xy, np.full(len(xy), z)])


def rectangle(x0: float, x1: float, y0: float, y1: float) -> Points:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def circle(radius: float, sides: int) -> Points:
    angle = np.arange(sides) * 2 * np.pi / sides
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def box(lower: ArrayLike, upper: ArrayLike) -> Trimesh:
    (x0, y0, z0), (x1, y1, z1) = np.asarray(lower, float), np.asarray(upper, float)
    return loft([at_height(rectangle(x0, x1, y0, y1), z) for z in (z0, z1)])


def cylinder(radius: float, z0: float, z1: float, sides: int = 20) -> Trimesh:
    return loft([at_height(circle(radius, sides), z) for z in (z0, z1)])


def lying(radius: float, half_width: float, sides: int = 20) -> Trimesh:
    """A cylinder about the y axis."""
    return turned(cylinder(radius, -half_width, half_width, sides), 90, [1, 0, 0])


def bar(start: ArrayLike, end: ArrayLike, thickness: float) -> Trimesh:
    """A square beam between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    beam = loft([at_height(circle(thickness / np.sqrt(2), 4), z) for z in (0.0, length)])
    return moved(beam.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], end - start)), start)


def wheel() -> Trimesh:
    """A lugged tyre of radius 0.13 about the y axis, with a hub and five spokes."""
    profile = [(0.085, -0.04), (0.12, -0.045), (0.13, -0.025), (0.13, 0.025), (0.12, 0.045), (0.085, 0.04)]
    lugs = np.where(np.arange(32) % 2 == 0, 1.0, 0.975)
    tyre = loft([at_height(circle(r, 32) * (lugs[:, None] if r > 0.1 else 1.0), y) for r, y in profile], closed=True)
    tyre = turned(tyre, 90, [1, 0, 0])
    spoke = box([0.02, -0.02, -0.012], [0.09, 0.02, 0.012])
    return join(tyre, lying(0.03, 0.05, 12), *(turned(spoke, 72 * k, [0, 1, 0]) for k in range(5)))


def base_shell() -> Trimesh:
    """The robot's body: chamfered corners, a narrower deck and a raked nose."""

    def ring(x0: float, x1: float, y: float, cut: float, z: float) -> Points:
        corners = [(x0 + cut, -y), (x1 - cut, -y), (x1, cut - y), (x1, y - cut)]
        corners += [(x1 - cut, y), (x0 + cut, y), (x0, y - cut), (x0, cut - y)]
        return at_height(corners, z)

    hull = loft(
        [
            ring(-0.38, 0.36, 0.19, 0.03, -0.07),
            ring(-0.42, 0.44, 0.225, 0.05, -0.01),
            ring(-0.42, 0.42, 0.225, 0.05, 0.10),
            ring(-0.37, 0.33, 0.17, 0.05, 0.17),
        ]
    )
    bumper = loft([ring(0.40, 0.47, 0.21, 0.02, z) for z in (-0.01, 0.05)])
    return join(hull, bumper, box([-0.36, -0.15, 0.17], [-0.02, 0.15, 0.185]))


def mast() -> Trimesh:
    """A tapered post with a sensor head, a bracket for the low lidar and a plate for the top one."""
    post = loft([at_height(circle(r, 8), z) for r, z in ((0.06, 0.0), (0.035, 0.12), (0.03, 0.72))])
    head = loft([at_height(rectangle(-0.05, x, -0.11, 0.11), z) for x, z in ((0.05, 0.60), (0.07, 0.63), (0.07, 0.70))])
    plate = cylinder(0.06, 0.78, 0.80)
    bracket = join(box([0.0, -0.02, 0.25], [0.15, 0.02, 0.28]), moved(cylinder(0.055, 0.28, 0.295), [0.13, 0, 0]))
    return join(post, head, cylinder(0.03, 0.70, 0.79, 8), plate, bracket)


def link(length: float, root: float, tip: float, half_width: float) -> Trimesh:
    """An arm link in the xz plane: a tapered beam between two round joint housings about y."""
    beam = [
        [(x, -half_width * w, -h), (x, half_width * w, -h), (x, half_width * w, h), (x, -half_width * w, h)]
        for x, h, w in (
            (0.0, root * 0.7, 0.8),
            (length * 0.5, (root + tip) * 0.3, 0.55),
            (length, tip * 0.7, 0.8),
        )
    ]
    ends = [lying(root, half_width), moved(lying(tip, half_width), [length, 0, 0])]
    return join(loft(beam), *ends, moved(lying(tip * 0.5, half_width * 1.25, 12), [length, 0, 0]))


def turntable() -> Trimesh:
    yoke = [box([-0.045, y - 0.012, 0.03], [0.045, y + 0.012, 0.13]) for y in (-0.062, 0.062)]
    return join(loft([at_height(circle(r, 20), z) for r, z in ((0.085, 0.0), (0.08, 0.03), (0.07, 0.045))]), *yoke)


def palm() -> Trimesh:
    """The tool flange: a short cylinder along x, a cross beam for the fingers, a camera housing on top."""
    flange = turned(cylinder(0.035, 0.0, 0.05), 90, [0, 1, 0])
    return join(
        flange,
        box([0.045, -0.07, -0.025], [0.08, 0.07, 0.025]),
        box([0.0, -0.045, 0.045], [0.035, 0.045, 0.07]),
    )


def finger() -> Trimesh:
    outline = [(-0.012, -0.006), (0.012, -0.010), (0.012, 0.010), (-0.012, 0.010)]
    rings = [[(x, s * y, s * z) for z, y in outline] for x, s in ((0.0, 1.0), (0.06, 1.0), (0.1, 0.55))]
    return loft(rings)


def pallet() -> Trimesh:
    """A EUR pallet, 1.2 x 0.8 x 0.144, standing on z = 0."""
    bottom = [box([-0.6, y - 0.05, 0], [0.6, y + 0.05, 0.022]) for y in (-0.35, 0, 0.35)]
    xy = [(x, y) for x in (-0.53, 0, 0.53) for y in (-0.35, 0, 0.35)]
    blocks = [box([x - 0.07, y - 0.05, 0.022], [x + 0.07, y + 0.05, 0.1]) for x, y in xy]
    stringers = [box([x - 0.07, -0.4, 0.1], [x + 0.07, 0.4, 0.122]) for x in (-0.53, 0, 0.53)]
    boards = [box([-0.6, y - 0.06, 0.122], [0.6, y + 0.06, 0.144]) for y in (-0.34, -0.17, 0, 0.17, 0.34)]
    return join(*bottom, *blocks, *stringers, *boards)


def crate() -> Trimesh:
    """An open container, 0.6 x 0.4 x 0.3, drawn in millimetres: the scene scales it."""
    rings = [
        at_height(rectangle(-x, x, -y, y), z)
        for x, y, z in (
            (260, 160, 0),
            (290, 190, 270),
            (300, 200, 275),
            (300, 200, 300),
            (280, 180, 300),
            (250, 150, 15),
        )
    ]
    ribs = [box([x - 8, -193, 20], [x + 8, 193, 24]) for x in (-150, 0, 150)]
    handles = [box([s * 300 - 12, -60, 240], [s * 300 + 12, 60, 255]) for s in (-1, 1)]
    return join(loft(rings), *ribs, *handles)


def rack() -> Trimesh:
    """The steel frame of a rack, 3.0 x 1.0 x 3.2: four posts, braces at both ends, beams front and back."""
    posts = [box([x - 0.04, y - 0.04, 0], [x + 0.04, y + 0.04, 3.2]) for x in (-1.46, 1.46) for y in (-0.46, 0.46)]
    levels = np.linspace(0.2, 3.0, 5)
    braces = [
        bar([x, -0.46 * s, low], [x, 0.46 * s, high], 0.04)
        for x in (-1.46, 1.46)
        for s, low, high in zip((1, -1, 1, -1), levels[:-1], levels[1:], strict=True)
    ]
    beams = [box([-1.46, y - 0.02, z - 0.12], [1.46, y + 0.02, z]) for y in (-0.46, 0.46) for z in (0.25, 1.35, 2.45)]
    return join(*posts, *braces, *beams)


def forklift() -> Trimesh:
    """A counterbalance truck without its carriage, facing +x: chassis, overhead guard, mast, wheels."""
    chassis = loft([at_height(rectangle(x0, 0.75, -y, y), z) for x0, y, z in ((-0.9, 0.45, 0.15), (-1.0, 0.5, 0.5))])
    tail = loft([at_height(rectangle(x0, -0.3, -0.5, 0.5), z) for x0, z in ((-1.0, 0.5), (-1.05, 0.75), (-0.8, 1.0))])
    seat = join(box([-0.3, -0.25, 0.5], [0.15, 0.25, 0.75]), box([-0.35, -0.25, 0.75], [-0.22, 0.25, 1.2]))
    corners = [((-0.55, 0.9), (-0.4, 2.1)), ((0.7, 0.5), (0.4, 2.1))]
    guard = [bar([x0, y, z0], [x1, y, z1], 0.05) for (x0, z0), (x1, z1) in corners for y in (-0.43, 0.43)]
    roof = [box([x, -0.45, 2.08], [x + 0.06, 0.45, 2.14]) for x in np.linspace(-0.45, 0.4, 6)]
    rails = [box([0.78, y - 0.05, 0.08], [0.90, y + 0.05, 2.3]) for y in (-0.33, 0.33)]
    yokes = [box([0.78, -0.33, z], [0.84, 0.33, z + 0.08]) for z in (0.5, 2.2)]
    xyr = [(x, y, r) for x, r in ((-0.65, 0.2), (0.5, 0.26)) for y in (-0.48, 0.48)]
    wheels = [moved(lying(r, 0.09, 16), [x, y, r]) for x, y, r in xyr]
    return join(chassis, tail, seat, *guard, *roof, *rails, *yokes, *wheels)


def forks() -> Trimesh:
    """The carriage that the truck lifts: a back plate and two forks along +x, their top at z = 0."""
    tines = [
        loft(
            [
                [(x, y - 0.06, -h), (x, y + 0.06, -h), (x, y + 0.06, 0), (x, y - 0.06, 0)]
                for x, h in ((0, 0.05), (1.1, 0.015))
            ]
        )
        for y in (-0.2, 0.2)
    ]
    plate = [box([-0.05, -0.4, z], [0.0, 0.4, z + 0.12]) for z in (-0.05, 0.35)]
    return join(*tines, *plate, *(box([-0.04, y - 0.02, 0], [0, y + 0.02, 1.0]) for y in (-0.38, -0.13, 0.13, 0.38)))


def fan() -> Trimesh:
    """Five twisted blades about the x axis, radius 0.7."""
    twist = np.radians([55, 40, 30])
    rings = [
        [(u * c * np.sin(a) - v * np.cos(a), u * c * np.cos(a) + v * np.sin(a), r) for u, v in corners]
        for a, r, c in zip(twist, (0.08, 0.4, 0.7), (0.10, 0.13, 0.16), strict=True)
        for corners in [((-1, -0.006), (1, -0.006), (1, 0.006), (-1, 0.006))]
    ]
    blade = loft(rings)
    hub = turned(cylinder(0.12, -0.08, 0.08, 16), 90, [0, 1, 0])
    return join(hub, *(turned(blade, 72 * k, [1, 0, 0]) for k in range(5)))


def ramp() -> Image.Image:
    """Heights of the ramp, 0..255, row 0 at +y: up, a worn plateau, down; 0.06 m between samples along x."""
    x = np.linspace(-1.8, 1.8, 61)
    y = np.linspace(1.1, -1.1, 23)[:, None]
    flank = np.clip((1.8 - np.abs(x)) / 1.2, 0, 1)
    smooth = flank * flank * (3 - 2 * flank)
    ruts = 0.06 * np.cos(9 * x) * np.sin(4 * y + 2 * x) + 0.04 * np.cos(17 * y)
    return Image.fromarray(np.round(255 * np.clip(smooth * (0.9 + ruts), 0, 1)).astype(np.uint8))


PARTS: dict[str, Trimesh] = {
    "wheel.stl": wheel(),
    "base.stl": base_shell(),
    "mast.stl": mast(),
    "turntable.stl": turntable(),
    "upper_arm.stl": link(0.34, 0.06, 0.05, 0.048),
    "forearm.stl": link(0.30, 0.048, 0.04, 0.04),
    "wrist.stl": link(0.09, 0.038, 0.032, 0.032),
    "palm.stl": palm(),
    "finger.stl": finger(),
    "rack.stl": rack(),
    "forklift.stl": forklift(),
    "forks.stl": forks(),
    "fan.stl": fan(),
    "pallet.obj": pallet(),
    "crate.obj": crate(),
}


def main(folder: Path = WAREHOUSE) -> None:
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    for name, mesh in PARTS.items():
        path = folder / "meshes" / name
        mesh.export(path)
        print(f"{path}: {len(mesh.faces)} triangles, {path.stat().st_size / 1000:.1f} kB")
    ramp().save(folder / "meshes" / "ramp.png")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
