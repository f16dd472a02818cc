"""Write docs/performance.md from a run of `rigcast bench`.

python benchmarks/performance.py            measures, for about ten minutes; needs the extras `dev` and `benchmark`
python benchmarks/performance.py FILE       from the JSON of `rigcast bench all --triangles 10000000 --json FILE`
"""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from floor import Visits, visits, visits_in_worlds
from in_worlds import OnGpu, cells, of_worlds, on_gpu
from in_worlds import bars as bars_on_gpu
from steps import Step, steps

from rigcast.bench.race import Result, Speed
from rigcast.bench.report.charts import draw_results, draw_scaling
from rigcast.bench.report.record import Record
from rigcast.bench.workloads import Unavailable
from rigcast.quiet import quiet_warp

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "performance.md"
FOLDER = ROOT / "docs" / "performance"
PROSE = ROOT / "benchmarks" / "prose"
MEASURED = ROOT / "out" / "bench.json"
COMMAND = ("all", "--triangles", "10000000", "--json", str(MEASURED))


def main(arguments: Sequence[str]) -> None:
    """Measure if need be, write the page and its pictures."""
    path = Path(arguments[0]) if arguments else MEASURED
    if not arguments:
        MEASURED.parent.mkdir(exist_ok=True)
        subprocess.run([str(Path(sys.executable).parent / "rigcast"), "bench", *COMMAND], check=True)
    measured = Record.read(path)
    FOLDER.mkdir(exist_ok=True)
    draw_results(measured.results, FOLDER / "casters.png")
    draw_scaling(measured.scaling, FOLDER / "scaling.png")
    quiet_warp()
    gpu = on_gpu(measured)
    lines = [
        *page(measured, gpu),
        *of_worlds(measured.worlds, gpu, _counted(), FOLDER),
        *of_design(steps()),
        *(prose("steps"), prose("limits")),
    ]
    PAGE.write_text("\n".join(lines) + "\n")


def page(measured: Record, gpu: OnGpu | None) -> Iterator[str]:
    """Yield the sections on measurements in one world, and the table of targets."""
    yield HEAD.format(**vars(measured), packages=measured.packages, meanwhile=_meanwhile(measured.load, measured.cores))
    yield from _comparison(measured.results)
    yield BARS
    yield "| | bar | measured | reached |\n|---|---|---|---|"
    yield from bars(measured)
    for bar in bars_on_gpu(gpu):
        yield _bar(*bar)
    yield FIGURES
    yield "| | median | lowest | highest | |\n|---|--:|--:|--:|---|"
    for figure in measured.figures:
        yield f"| {figure.what} | {cells(figure.value)} | {figure.unit} |"
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
    """Geometric mean over all results of rigcast's rays per second over a caster's; NaN without results."""
    ratios = [s.ratio.median for result in results for s in result.speeds if s.caster == caster]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else float("nan")


def bars(measured: Record) -> Iterator[str]:
    """Yield the lines of the table of targets."""
    embree = [s.ratio.median for r in measured.results for s in r.speeds if s.caster == "Open3D"]
    if embree:
        yield _bar("rays/s over Embree's, the lowest of all scenes", ">= 2", min(embree), min(embree) >= 2)
    for caster, least in (("Open3D", 3), ("mj_multiRay", 100), ("MuJoCo-LiDAR", 12), ("mujoco_warp", 12)):
        mean = geometric_mean(measured.results, caster)
        yield _bar(f"rays/s over those of {caster}, geometric mean", f">= {least}", mean, mean >= least)
    figures = {figure.key: figure for figure in measured.figures}
    for figure, bar in ((figures[key], bar) for key, bar in FIGURE_BARS if key in figures):
        value = figure.value.median
        sign, limit = bar.split()
        reached = value <= float(limit) if sign == "<=" else value >= float(limit)
        yield _bar(figure.what, f"{bar} {figure.unit}", value, reached)
    for series in measured.scaling:
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


def of_design(found: Sequence[Step]) -> Iterator[str]:
    """Yield the section on what makes the cast fast."""
    yield prose("design")
    yield STEPS
    yield "| step | left out | " + " | ".join(found[0].gains) + " |\n|---|---|" + "--:|" * len(found[0].gains)
    for step in found:
        gains = " | ".join(f"{gain.median:.2f}" for gain in step.gains.values())
        yield f"| {step.name} | {step.without} | {gains} |"


def prose(name: str) -> str:
    """A section written by hand, of benchmarks/prose."""
    return (PROSE / f"{name}.md").read_text().rstrip()


def _counted() -> list[Visits]:
    """Visits of the lidar in many worlds first, if its robot is available, then those of three scenes."""
    try:
        in_worlds = [visits_in_worlds()]
    except Unavailable:
        in_worlds = []
    return [*in_worlds, *visits()]


def _meanwhile(load: float, cores: int) -> str:
    """Say whether other work ran on the machine: `load` is how many threads wanted to run before it began."""
    if load < 0.25 * cores:
        return "Nothing else ran on the machine."
    return f"Meanwhile other work ran on the machine ({load:.1f} threads for {cores} cores): trust ratios, not speeds."


HEAD = """# Performance

*Written by `make performance` (`python benchmarks/performance.py`); not edited by hand.*

Measured on {processor} ({machine}), {threads} threads of {cores} cores, {rounds} rounds in turn, with
{packages}. {meanwhile}

The short version is the first table and [the targets](#targets). Then come
[many worlds](#in-many-worlds) and [GPUs](#on-a-gpu), [what makes it fast](#what-makes-it-fast) and
[what falls short](#what-falls-short-and-why), with all that was tried without gain.

## Beside other casters

A frame is: poses are updated, all rays of a sensor are cast, and distances, ids and normals (those that the caster
reports) are handed over as numpy arrays.

- The casters take turns on the same rays and keep what they need between frames. In its turn a caster makes frames for
  a tenth of a second, after one that does not count. It drops each frame when it has the next, as a simulation does
  that goes on with the same scene.
- Embree, through Open3D, has all triangles in one static mesh, so it has nothing to update.
- rigcast and Embree run on all threads, the other casters on one.
- A caster that takes more than 2 s for a frame is timed on 4000 of its rays.

![Millions of rays per second of every caster in every scene](performance/casters.png)

Rays per second of rigcast over those of each other caster: by the clock, and in brackets by the CPU time of all
threads. CPU time is disturbed less by other work on the machine, and shows what a caster does with one thread.
"""
RIGHT = """
Is a caster fast because it is wrong? This is the fraction of 4000 rays that have the hits, misses and distances of
mj_ray, to 1e-5 (1 + t) / max(|cos|, 1e-3), and the fraction to 1 cm. Embree gets round shapes as triangles with corners
on the surface.
"""
BARS = """
## Targets
"""
FIGURES = """
## rigcast alone

Updates, small frames, tree builds and starts are CPU times. The demo has four sensors, with lidar and stereo errors.
"""
GROWTH = """
## Growth

![Rays per second of a depth camera by rays, triangles, geoms, threads and worlds](performance/scaling.png)
"""
STEPS = """
**What a step is worth.** Each was left out by itself, with everything else kept. The numbers are rays per CPU second
with the step over those without it (for threads: per second by the clock).
"""
if __name__ == "__main__":
    main(sys.argv[1:])
