"""Write docs/performance.md from a run of `rigcast bench`.

python benchmarks/performance.py            measures, for about ten minutes; needs the extras `dev` and `benchmark`
python benchmarks/performance.py FILE       from the JSON of `rigcast bench all --triangles 10000000 --json FILE`
"""

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from floor import Visits, visits
from steps import Step, steps

from rigcast.bench.charts import draw_results, draw_scaling
from rigcast.bench.figure import Spread
from rigcast.bench.race import Result, Speed
from rigcast.bench.scaling import Series
from rigcast.quiet import quiet_warp

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "performance.md"
FOLDER = ROOT / "docs" / "performance"
MEASURED = ROOT / "out" / "bench.json"
SPREADS = ("mrays", "ratio", "cpu_ratio")
COMMAND = ("all", "--triangles", "10000000", "--json", str(MEASURED))


def main(arguments: Sequence[str]) -> None:
    """Measure if need be, write the page and its pictures."""
    path = Path(arguments[0]) if arguments else MEASURED
    if not arguments:
        MEASURED.parent.mkdir(exist_ok=True)
        subprocess.run([str(Path(sys.executable).parent / "rigcast"), "bench", *COMMAND], check=True)
    measured = json.loads(path.read_text())
    results, scaling = list(map(_result, measured["results"])), list(map(_series, measured["scaling"]))
    FOLDER.mkdir(exist_ok=True)
    draw_results(results, FOLDER / "casters.png")
    draw_scaling(scaling, FOLDER / "scaling.png")
    quiet_warp()
    PAGE.write_text("\n".join([*page(measured, results, scaling), *of_steps(steps()), *of_floor(visits())]) + "\n")


def page(measured: dict[str, Any], results: Sequence[Result], scaling: Sequence[Series]) -> Iterator[str]:
    """Yield the lines that come of the measurements."""
    figures = {figure["key"]: figure for figure in measured["figures"]}
    versions = ", ".join(f"{name} {version}" for name, version in measured["versions"].items())
    yield HEAD.format(**measured, packages=versions, meanwhile=_meanwhile(measured["load"], measured["cores"]))
    yield from _comparison(results)
    yield BARS
    yield "| | bar | measured | reached |\n|---|---|---|---|"
    yield from bars(results, figures, scaling)
    yield FIGURES
    yield "| | median | lowest | highest | |\n|---|--:|--:|--:|---|"
    for figure in figures.values():
        values = " | ".join(f"{figure['value'][name]:.3g}" for name in ("median", "lowest", "highest"))
        yield f"| {figure['what']} | {values} | {figure['unit']} |"
    yield GROWTH


def _comparison(results: Sequence[Result]) -> Iterator[str]:
    names = list(dict.fromkeys(speed.caster for result in results for speed in result.speeds))
    others = names[1:]
    yield f"| scene and rays | geoms | triangles | rigcast, M rays/s | {' | '.join(others)} |"
    yield f"|---|--:|--:|--:|{'--:|' * len(others)}"
    for result in results:
        by_name = {speed.caster: speed for speed in result.speeds}
        where = f"{result.workload}, {result.sensor} {' x '.join(map(str, result.shape))}"
        ratios = " | ".join(_ratio(by_name[name]) if name in by_name else "" for name in others)
        speed = f"{by_name['rigcast'].mrays.median:.3g}"
        yield f"| {where} | {result.geoms} | {result.triangles} | {speed} | {ratios} |"
    means = " | ".join(f"**{geometric_mean(results, name):.2f}**" for name in others)
    yield f"| geometric mean | | | | {means} |"
    yield RIGHT
    yield f"| scene and rays | {' | '.join(names)} |\n|---|{'--:|' * len(names)}"
    for result in results:
        right = {speed.caster: f"{speed.agree:.2%}, {speed.close:.2%}" for speed in result.speeds}
        cells = " | ".join(right.get(name, "") for name in names)
        yield f"| {result.workload}, {result.sensor} | {cells} |"


def _ratio(speed: Speed) -> str:
    return f"{speed.ratio.median:.2f} ({speed.cpu_ratio.median:.2f})"


def geometric_mean(results: Sequence[Result], caster: str) -> float:
    """Of rigcast's rays per second over a caster's."""
    ratios = [s.ratio.median for result in results for s in result.speeds if s.caster == caster]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else float("nan")


def bars(results: Sequence[Result], figures: dict[str, Any], scaling: Sequence[Series]) -> Iterator[str]:
    """Yield the lines of the table of what was to be reached."""
    embree = [s.ratio.median for r in results for s in r.speeds if s.caster == "Open3D"]
    if embree:
        yield _bar("rays/s over Embree's, the lowest of all scenes", ">= 2", min(embree), min(embree) >= 2)
    for caster, least in (("Open3D", 3), ("mj_multiRay", 100), ("MuJoCo-LiDAR", 12), ("mujoco_warp", 12)):
        mean = geometric_mean(results, caster)
        yield _bar(f"rays/s over those of {caster}, geometric mean", f">= {least}", mean, mean >= least)
    for key, bar in FIGURE_BARS:
        if key in figures:
            value = figures[key]["value"]["median"]
            sign, limit = bar.split()
            reached = value <= float(limit) if sign == "<=" else value >= float(limit)
            yield _bar(figures[key]["what"], f"{bar} {figures[key]['unit']}", value, reached)
    for series in scaling:
        if series.varies == "triangles" and len(series.sizes) > 1:
            speed = [mrays.median for mrays in series.mrays]
            worst = max(a / b for a, b in pairwise(speed))
            yield _bar("time per ray with ten times the triangles, the worst step", "<= 1.4 times", worst, worst <= 1.4)


FIGURE_BARS = (
    ("pattern_rosette", ">= 0.6"),
    ("pattern_wide", ">= 0.6"),
    ("pattern_odd", ">= 0.6"),
    ("outputs", "<= 1.25"),
    ("origins_warehouse_embree", ">= 1.0"),
    ("origins_room_embree", ">= 1.0"),
    ("update_130", "<= 0.3"),
    ("update_1600", "<= 2"),
    ("small_less", "<= 60"),
    ("tree_build", "<= 1.5"),
    ("memory_read", "<= 120"),
    ("memory_built", "<= 120"),
    ("start_in all", "<= 2.0"),
    ("start_cold", "<= 25"),
)


def _bar(what: str, bar: str, value: float, reached: bool) -> str:
    return f"| {what} | {bar} | {value:.3g} | {'yes' if reached else '**no**'} |"


def of_steps(found: Sequence[Step]) -> Iterator[str]:
    """Yield the section on what makes the cast fast."""
    yield STEPS
    yield "| step | left out | " + " | ".join(found[0].gains) + " |\n|---|---|" + "--:|" * len(found[0].gains)
    for step in found:
        gains = " | ".join(f"{gain.median:.2f}" for gain in step.gains.values())
        yield f"| {step.name} | {step.without} | {gains} |"
    yield TRIED


def of_floor(found: Sequence[Visits]) -> Iterator[str]:
    """Yield the section on GPUs."""
    yield GPU
    yield "| scene and rays | nodes | blocks | bytes | operations |\n|---|--:|--:|--:|--:|"
    for one in found:
        yield f"| {one.name} | {one.nodes:.1f} | {one.blocks:.2f} | {one.bytes:.0f} | {one.operations:.0f} |"
    yield GPU_END.format(rays=1e-9 * 4.8e12 / max(one.bytes for one in found))


def _meanwhile(load: float, cores: int) -> str:
    """Say whether other work ran on the machine: `load` is how many threads wanted to run before it began."""
    if load < 0.25 * cores:
        return "Nothing else ran on the machine."
    return f"Meanwhile other work ran on the machine ({load:.1f} threads for {cores} cores): trust ratios, not speeds."


def _spread(read: dict[str, float]) -> Spread:
    return Spread(**read)


def _result(read: dict[str, Any]) -> Result:
    speeds = [Speed(**(speed | {key: _spread(speed[key]) for key in SPREADS})) for speed in read["speeds"]]
    return Result(**(read | {"shape": tuple(read["shape"]), "speeds": tuple(speeds)}))


def _series(read: dict[str, Any]) -> Series:
    return Series(read["varies"], tuple(read["sizes"]), tuple(map(_spread, read["mrays"])))


HEAD = """# Performance

*Written by `make performance` (`python benchmarks/performance.py`); not edited by hand.*

Measured on {processor} ({machine}), {threads} threads of {cores} cores, {rounds} rounds in turn, with
{packages}. {meanwhile}

## Beside other casters

A frame is: poses brought up to date, all rays of a sensor cast, and distances, ids and normals, of those that the
caster reports, handed over as numpy. The casters take turns on the same rays and keep what they need between frames. In
its turn a caster makes as many frames as take a tenth of a second, after one that does not count: as in a simulation,
that goes on with the same scene.
Embree, through Open3D, has all triangles in one mesh that does not move, so it has nothing to bring up to date.
rigcast and Embree run on all threads, the other casters on one. A caster that takes more than 2 s for a frame is timed
on 4000 of its rays.

![Millions of rays per second of every caster in every scene](performance/casters.png)

Rays per second of rigcast over those of each other caster: by the clock, and in brackets by the CPU time of all
threads, which other work on the machine disturbs less, and which shows what a caster does with one thread.
"""
RIGHT = """
No caster is fast by being wrong unseen: here is which fraction of 4000 rays has mj_ray's hits, misses and distances to
1e-5 (1 + t) / max(|cos|, 1e-3), and which to 1 cm. Embree sees round shapes as triangles with corners on the surface.
"""
BARS = """
## What was to be reached
"""
FIGURES = """
## rigcast alone

Updates, small frames, trees and starts by CPU time. The demo has four sensors, with effects of lidars and stereo.
"""
GROWTH = """
## Growth

![Rays per second of a depth camera by rays, triangles, geoms, threads and worlds](performance/scaling.png)
"""
STEPS = """
## What makes it fast, and what each step gives

How rays are cast is told in [casting](casting.md). Each step was left out alone and everything else kept; the numbers
are rays per CPU second with it, over those without it (for threads: per second by the clock).
"""
TRIED = """
*Packets*: 16 rays that go the same way share the way through the trees, the boxes that they are held against, and the
products that an edge of a triangle needs; what is left for each ray is two multiplications an edge, in loops over 16
rays that the compiler turns into vector instructions. *The surface-area heuristic* splits a mesh where rays are least
likely to need both sides. *Trees and packets on disk* are read at the second start with the same model and rig, and not
built and sorted.

The vectors are as wide as the CPU's: Warp compiles kernels where they run, for the CPU that it finds there, and can
compile for no other. With Warp 1.19 `warp.config.cpu_compiler_flags` can make them narrower or switch them off, which
changes no bit of any answer (`tests/kernels/test_cpu_flags.py`). Older versions of Warp have no such option.

Some steps cannot be left out of the code as it is. Each was measured when it was made, in ns of one thread's CPU time
per ray, before and after, on a machine in use (noise of 10 to 30 %); depth camera first, lidar second:

- Functions within a shape take small structs, in place of a call that copied 2 KB per triangle: G1 202 to 173 and
  217 to 175, warehouse 94 to 84 and 112 to 99, room 67 to 64 and 153 to 128.
- Packets of 16 rays along a row, where the rows of a lidar are far apart: lidar on the G1 199 to 129, on the height
  field 1474 to 401.
- Boxes within a mesh held against all 16 rays and their own best hits: aloha_pot 351 to 178 and 165 to 64, G1 180 to
  153 and 122 to 144, height field 165 to 214 and 384 to 425.
- Edges of triangles and boxes of nodes taken out of their structs before the loops over them, where an element of a
  field was a copy of all of it, and the lowest bit of a mask by one instruction: G1 lidar 129 to 120, aloha_pot depth
  156 to 143, height field 156 to 142 and 338 to 328.
- The geometry by reference to what decides in float64, in place of a copy of 912 bytes for every block: G1 136 to 120
  and 115 to 111, aloha_pot 144 to 131 and 72 to 71, height field 131 to 127 and 275 to 263.
- Blocks and nodes asked for when their boxes are entered, before they are needed: G1 120 to 114 and 111 to 99, height
  field 127 to 109 and 263 to 212.
- Triangles whose edges no ray of a packet passes are left before the division; conditions on distances are selects of
  distances in place of numbers 0 and 1, which became 16-bit vectors; boxes are held against the rays of a packet slab
  by slab in place of three cross products: G1 102 to 98 and 94 to 89, aloha_pot 122 to 117 and 46 to 43, height field
  106 to 100 and 197 to 176, warehouse 74 to 76 and 98 to 102.
- Boxes of a node seen from the origin, and widened, all eight at once and not one by one: G1 96 to 92 and 91 to 87,
  aloha_pot 116 to 109 and 38 to 37, height field 105 to 97 and 174 to 168.
- Trees built depth first, with boxes moved in place: 1 M triangles 2.6 to 2.2 s.
- Of a reading that takes time, what stands still placed once, and not for every firing: a VLP-16 with motion in the
  warehouse of 188 geoms, 4930 firings, 128 to 40 ms of CPU time a frame.
- Rays with unrelated origins, in the warehouse: their loop in a function of its own, as Warp compiles a kernel's body
  twice, and what is called from two places is not inlined but given a copy of the geometry, 900 bytes: 562 to 507.
  Masks of boxes in one instruction, by native code: to 464. The nearest box entered at once, without a way over the
  stack: to 449. All together 565 to 430, in the room 497 to 380, on the G1 469 to 358, aloha_pot 146 to 82.
- The same rays with all that a ray is in one struct, and none within it, which would stay in memory and be copied for
  every shape; triangles of a block that are missed left out by a mask: 420 to 374, room 390 to 355, G1 358 to 326,
  aloha_pot 92 to 85, height field 464 to 437.
- The same rays with the geometry by reference and no array in the struct of a ray, which is copied for every mesh:
  what is written in pieces and read as a whole waits until it is in the cache. Comparisons in place of calls that ask
  whether numbers are finite, the child of a node read alone, a stack of 72 entries and not 96, which Warp sets to zero
  for every tree: warehouse 407 to 352, room 384 to 341, G1 328 to 276. Turns of 512 rays in place of slices of 8192,
  with all that, on two threads by the clock: 0.81 and 0.83 of the time.
- The pose of rays that are given in the world made once: `Scene.cast` of one ray 535 to 420 us.
- Whether poses are finite seen from their smallest and largest number where BLAS would take all threads for a product,
  which wait for each other on a machine in use: `Scene.update` of 1600 geoms 4.0 to 0.43 ms there.
- Shapes without bounds, and what has no place, hung from the root of the tree over the others, and not from a root
  above both: two nodes less for every ray that goes alone or in a packet.
- Directions that are given as numpy arrays made unit vectors by a kernel, on all threads, not by numpy on one, and
  rays read where they are: 150 to 30 for each ray of `Scene.cast`.
- Sides of a split weighed by the blocks that their triangles fill, in place of the triangles: 7.6 of 8 lanes are filled
  and not 6.0, a million triangles take 66 MB and not 82; G1 168 to 162 and 168 to 169, aloha_pot 180 to 175 and 93 to
  87, height field 213 to 215 and 469 to 445.
- Nodes of eight grown from the root, and not collapsed from a binary tree; a bin as one struct; boxes, corners and
  normals by kernels: 1 M triangles 2.0 to 1.2 s of CPU time, on all threads.
- Memory that the C library keeps after a build given back: with the filled blocks, 176 to 81 bytes per triangle of a
  scene whose tree was built, 93 to 80 where it was read.
- Height fields compared with what they were where they are, not copied first: `Scene.update` of one with 10 M triangles
  5.2 to 3.4 ms.
- The demo's rays read from disk as packets, not sorted: its rig made in 0.3 s of CPU time in place of 1.4 s.
- A start, in CPU time: Python's collector of cycles, which walked all modules several times over, rests until the rig
  is there, and what was made counts as old then: 0.52 to 0.11 s of it. Origins of rays told apart by sorting columns,
  not by `np.unique`, which compares rows: twice 58 to 1.5 ms for a VLP-16. Packets from disk used where they were read:
  10 ms less for each camera. Effects, Pillow and `numpy.ma` imported by those who need them. The demo's start in all,
  in turn with that before and with second views in packets, 3.05 to 2.25 s; `rigcast --help`, without MuJoCo, 0.55 to
  0.2; `rigcast schema` and `presets NAME`, without Warp, 2.2 to 0.9 and 2.6 to 1.2.
- A start that compiles, in CPU time of the compiler: kernels for rays that go alone have a Warp module of their own,
  which a rig of packets needs not and `Scene.cast` alone: of 15 s for both 13 and 6, as they share functions. Arrays of
  the kernel that grows trees come in a struct, as Warp compiles a kernel twice that takes arrays by themselves: 2.6 to
  1.8 s. Of what is left, 3 s are Warp's own headers, once for a process, and 2 s its writing of C++.
- Rays from a stereo camera's second imager to what the first has seen, in its packets and not one by one: a frame of
  640 x 480 pixels 166 to 103 and 176 to 91 ms.
- Small frames: the arrays of a frame that nobody holds serve again, their launches are prepared once, and a scene of
  geoms alone is brought up to date without copies: one ray among ten geoms 940 to 140 us.
- Hits become readings where they are cast, not by a kernel of their own; kernels take structs in place of up to 18
  arguments, each of which Warp packs anew for a launch; the state is copied by one call of MuJoCo's; threads are
  counted where there is work for several, and colours compared once for all sensors: the same ray 113 to 80 us. All
  but 5 of these are Python's: 20 for launching two kernels, 9 for handing the range over as numpy, 6 for making the
  frame. The same steps timed one by one in a loop take half as long, when the CPU finds their code in its cache.
- Packets for patterns that are others in each reading, of rays that follow each other, unsorted, and their directions
  worked out coordinate by coordinate: Livox Avia, pattern included, 23.4 to 9.6 ms of CPU time for 24000 rays (casting
  alone 13 to 5.2; sorted by numpy 3.7, which takes 35; along a Hilbert curve 4.1).
- Light through wedges as vectors as long as the refractive index, of which a face changes one coordinate or what is
  along its normal, line by line in place of sample by sample, and directions used where numpy wrote them: a new pattern
  2.8 to 2.3 ms, packets included, one thread, and with all that is faster since 8.0 to 7.5 ms a frame. Of them 1.2 make
  the pattern, 0.9 the packets, 3.6 cast, and an even grid of as many rays takes 4.0, of which 3.1 cast.
- Packets of rays from one origin each, and of all rays of a sensor with `motion` where the world stands still: VLP-16,
  28928 rays, 19.2 to 4.6 ms.
- Tiles taken by each thread when it is done with its last ones, in place of every second run of them: frames of two
  threads on a machine in use, by the clock, warehouse 13.5 to 8.3 ms (lidar) and 50.8 to 27.3 ms (depth).
- A thread that reads hits takes 1024 rays, and a thread of the CPU makes one launch, in place of a thread for each ray
  and a launch for each 8192: ids, points and z-depth of 640 x 480 rays, with two threads, 40 to 21 ns a ray.
- The next tile's packets, and the cache lines that a tile's hits will be written to, asked for before it is cast:
  warehouse 72 to 70 and 100 to 94, with more to gain where others use the memory.
- Hits written as they are worked out, in place of structs of lanes that functions handed on, which were copied and set
  to zero: warehouse 75 to 65 and 99 to 90, room 56 to 49 and 99 to 90, G1 102 to 100 and 87 to 84.
- Which rays of a packet enter a box kept for every node and block, and up to six taken one by one, each against all
  eight boxes or triangles at once: lidar on the height field 194 to 182, with 10 M triangles 393 to 342, aloha_pot 34
  to 32, G1 86 to 87; depth up to 6 % slower, with 10 M triangles 244 to 225 (lower quartiles of a machine in use).

*Tried, without gain:* vectors of 512 bits by `-mprefer-vector-width=512`, on a CPU that has 256; kernels without
`-march=native`, which were as fast within noise, as Warp generates code for the CPU at hand either way; packets halved
by expected cost; packets of 2 x 8 or 16 x 1 pixels for cameras, which help in one scene and harm in another; the test
of boxes against all rays at leaves only; the lowest bit of a mask by the exponent of a float; asking for blocks before
their boxes are held against all rays, and not after, which fetches too many; 32 bins in place of 16 where trees are
split; rays in the order of the image within a packet, which made the warehouse 2 to 8 % slower; where triangles are hit
worked out over all 16 rays in place of ray by ray, which is the same; the same of closed forms ray by ray, 1 to 8 %
slower; clearing packets lazily, whose time goes into loading them; nodes and blocks that begin on cache lines; packets
of a tile that take turns, a node or block each, so that none waits for memory: the height field's lidar 10 to 15 %
faster, with most other rays 5 to 15 % slower; masks of 16 lanes in one instruction; packets
of a rosette of 4 to 8 samples of each line in place of all lines of 3 (Avia's cast 2 to 8 % faster, Mid-360's 2 to 9 %
slower), or sorted by cells of a Morton or Hilbert curve (5 to 15 % faster, less than sorting takes); its pattern in
blocks that fit the cache.

*For a start, without gain:* LLVM's own thresholds of inlining, with which kernels compile in three quarters of the time
and take 1.6 times as long; a tenth of Warp's, with which they are as fast and compile in nine tenths, but which would
be in the way of the user's compiler flags; `-O1`, which saves a sixth of it. Modules are not compiled in several
threads: each would compile Warp's headers anew, and Warp 1.12 has no lock on the functions that modules share.

*Where time goes:* on the G1's depth image about a quarter into boxes, 10 % into edges of triangles, 18 % into
triangles, and the rest into the tree over shapes, clearing packets and writing hits, which in the warehouse, with few
triangles, were half and are about a quarter; 5 % is waiting for memory. The height field's lidar gains least over
Embree: of its 16 rays in a row one alone enters 43 % of the blocks, and one or two 74 %; with 10 M triangles one alone
89 %. They share little but the way to there, and there 37 % of the time is waiting for nodes and blocks to come from
memory.

*Two threads* of this machine take more CPU time than one for the same frame, as those that share a core do: 10.9 ms
and not 8.3 for the warehouse's lidar, 52 and not 45 for the G1's depth image. So they are 1.5 to 1.7 times as fast at
most.

*Ten times the triangles* cost more the smaller they are beside what lies between two rays. On the height field a packet
of the depth camera looks at 7.1 nodes and 3.2 blocks and is held against 13 triangles at 1 M triangles, and at 12, 6.7
and 39 at 10 M, while its rays enter 28 blocks in both, each counted for itself: they share less. The memory is not what
holds it up: parts of the image cast after the caches were swept take 80 to 95 ns a ray more than cast again at once, at
10 k triangles as at 10 M. Embree's time per ray grows from 1 M to 10 M by 1.45 (depth) and 1.68 (lidar), ours by 1.9
and 1.8. A tree over 10 M triangles takes 12 to 14 s of CPU time to build, 66 bytes per triangle, and at most 2 GB in
the whole process meanwhile.

*Rays with unrelated origins* share nothing and go one by one. In the warehouse a third of their time goes into 5 nodes
of the tree over the shapes, half into 2.2 shapes, of which 0.6 are meshes, and a sixth into what is read and written;
they enter no more nodes than they would if they knew their hit beforehand. Rays that are each cast 200 times over, so
that no branch is mispredicted, take 0.73 of the time. *Without gain:* rays in the order of a Morton curve over origins
and directions, which makes the cast itself up to 10 % faster, less than it takes to sort them; all but the nearest box
of a node unsorted on the stack (packets 3 to 13 % slower); trees over the shapes made of binary ones at the least cost
(3 % fewer nodes); all boxes of a node sorted by a network of six steps and pushed at once, without a branch, and the
nearest one by three minima (0.97 to 1.04 of the time); the cache lines of a hit asked for before its ray is cast.
"""
GPU = """
## On a GPU: not measured

Nothing here was run on a GPU. What can be said is the floor: how many nodes and blocks of triangles a ray has to look
at with these trees even if it knew its hit beforehand (those whose boxes it enters before its hit), counted for 200
rays each. A node is 224 bytes and 8 boxes of 15 operations, a block 416 bytes and 8 triangles of 60 operations; a ray
brings 24 bytes and takes 24 away.
"""
GPU_END = """
An H200 moves 4.8 TB/s: if every node came from its memory once for every ray, {rays:.2g} G rays/s would be the
most. Trees of a few MB stay in its second-level cache of 50 MB, which is faster, and its 67 T operations a second would
allow more still. How far the kernel is from that has to be measured where there is a GPU.
"""

if __name__ == "__main__":
    main(sys.argv[1:])
