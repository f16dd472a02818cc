"""The sections of docs/performance.md on many worlds and on GPUs, from the JSON of `rigcast bench worlds`.

on_gpu.json is that of a run on a GPU, kept because not every machine has one:
rigcast bench worlds --caster mujoco_warp --json benchmarks/on_gpu.json
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from floor import Visits

from rigcast.bench.figure import Spread
from rigcast.bench.report.charts import draw_worlds
from rigcast.bench.report.record import Record
from rigcast.bench.worlds.measure import Batch, OnDevice

ON_GPU = Path(__file__).parent / "on_gpu.json"
WORLDS = 4096


class OnGpu(NamedTuple):
    """What was measured on a GPU, with these packages."""

    found: OnDevice
    packages: str


def on_gpu(measured: Record) -> OnGpu | None:
    """Return what was measured on a GPU, in this run or else in the one that is kept."""
    kept = [Record.read(ON_GPU)] if ON_GPU.exists() else []
    for run in (measured, *kept):
        if run.worlds is not None and run.worlds.limits:
            return OnGpu(run.worlds, run.packages)
    return None


def of_worlds(cpu: OnDevice | None, gpu: OnGpu | None, counted: Sequence[Visits], folder: Path) -> Iterator[str]:
    """Yield both sections, and draw the GPU's chart. counted: the lidar in many worlds first, if it was counted."""
    either = cpu if gpu is None else gpu.found
    if either is not None:
        yield WORLDS_HEAD.format(geoms=either.geoms, triangles=either.triangles, shares=_shares(either))
    if cpu is not None and not cpu.limits:
        yield "On the CPU, where mujoco_warp runs on one thread, M rays/s:\n"
        yield from _speeds(cpu)
    if gpu is None:
        yield NOT_MEASURED
    else:
        draw_worlds(gpu.found.by_way(), folder / "worlds.png")
        yield GPU.format(device=gpu.found.device, packages=gpu.packages)
        yield from _speeds(gpu.found)
        yield from _parts(gpu.found)
    yield FLOOR
    yield "| scene and rays | nodes | blocks | patches | bytes | bytes, once a warp | operations |"
    yield "|---|--:|--:|--:|--:|--:|--:|"
    for one in counted:
        counts = f"{one.nodes:.1f} | {one.blocks:.2f} | {one.patches:.2f}"
        yield f"| {one.name} | {counts} | {one.bytes:.0f} | {one.bytes_in_warp:.0f} | {one.operations:.0f} |"
    if gpu is None:
        yield FLOOR_OF_DATA_SHEET.format(rays=1e-9 * 4.8e12 / max(one.bytes for one in counted))
    elif counted[0].name.startswith("a G1"):
        yield from _distance(gpu.found, counted[0])


def bars(gpu: OnGpu | None) -> Iterator[tuple[str, str, float, bool]]:
    """Yield the targets on a GPU: what, bar, measured, reached."""
    if gpu is None:
        return
    batch = _batch(gpu.found)
    where, speed = f"{gpu.found.device}, {batch.worlds} worlds of 1024 rays", _grays(batch)
    yield f"{where}: rays/s", ">= 1.5 G/s", speed, speed >= 1.5
    for ours, theirs in _pairs(batch):
        ratio = _mrays(batch)[ours] / _mrays(batch)[theirs]
        yield f"{where}: rays/s of {ours} over those of {theirs}", ">= 3", ratio, ratio >= 3


def _batch(found: OnDevice) -> Batch:
    """The batch of WORLDS, or else the largest."""
    batches = sorted(found.batches, key=lambda batch: batch.worlds)
    return next((batch for batch in batches if batch.worlds == WORLDS), batches[-1])


def _mrays(batch: Batch) -> dict[str, float]:
    return {way.name: way.mrays.median for way in batch.ways}


def _grays(batch: Batch) -> float:
    """G rays/s of the fastest way of rigcast."""
    return 1e-3 * max(mrays for name, mrays in _mrays(batch).items() if name.startswith("rigcast"))


def _pairs(batch: Batch) -> list[tuple[str, str]]:
    """Pairs of a way of rigcast and the same way of mujoco_warp, where both were measured."""
    ways = _mrays(batch)
    pairs = [("rigcast", "mujoco_warp"), ("rigcast, graph", "mujoco_warp, graph")]
    return [(ours, theirs) for ours, theirs in pairs if ours in ways and theirs in ways]


def _speeds(found: OnDevice) -> Iterator[str]:
    ways, pairs = list(_mrays(found.batches[0])), _pairs(found.batches[0])
    ratios = [f"rigcast / mujoco_warp{', of graphs' if 'graph' in ours else ''}" for ours, _ in pairs]
    yield f"| worlds | {' | '.join([*ways, *ratios])} |\n|--:|{'--:|' * (len(ways) + len(ratios))}"
    for batch in found.batches:
        mrays = _mrays(batch)
        speeds = [f"{speed:.3g}" for speed in mrays.values()]
        speeds += [f"{mrays[ours] / mrays[theirs]:.2f}" for ours, theirs in pairs]
        yield f"| {batch.worlds} | {' | '.join(speeds)} |"


def _parts(found: OnDevice) -> Iterator[str]:
    batch = _batch(found)
    yield f"\nOf {batch.worlds} worlds:\n"
    yield "| | median | lowest | highest | |\n|---|--:|--:|--:|---|"
    for way in batch.ways:
        yield f"| {way.name}: a frame | {cells(way.ms)} | ms |"
    for part in batch.parts:
        yield f"| {part.what} | {cells(part.value)} | {part.unit} |"
    yield "\n| of the rays in 16 of the worlds | distance as mj_ray's | to 1 cm | geom |\n|---|--:|--:|--:|"
    for right in batch.right:
        yield f"| {right.caster} | {right.agree:.3%} | {right.close:.3%} | {right.geom:.3%} |"
    if batch.same is not None:
        yield f"\nOf all rays both casters have {batch.same:.4%} alike, the geom and the distance to 1 cm."


def cells(value: Spread) -> str:
    """The cells of a table with the median, the lowest and the highest."""
    return f"{value.median:.3g} | {value.lowest:.3g} | {value.highest:.3g}"


def _distance(found: OnDevice, one: Visits) -> Iterator[str]:
    """The most rays/s that the device would allow, and the share of it that rigcast reaches."""
    batch = _batch(found)
    grays, limits = _grays(batch), {limit.key: limit for limit in found.limits}
    yield DISTANCE.format(grays=grays, worlds=batch.worlds)
    yield "| | of a ray | of the device | G rays/s at most | measured, of that |\n|---|--:|--:|--:|--:|"
    for key, what, needs in (
        ("memory", "bytes from memory, each ray for itself", one.bytes),
        ("memory", "bytes from memory, once a warp", one.bytes_in_warp),
        ("cache", "bytes from the second-level cache, each ray for itself", one.bytes),
        ("cache", "bytes from the second-level cache, once a warp", one.bytes_in_warp),
        ("operations", "operations", one.operations),
    ):
        has, unit = limits[key].value.median, limits[key].unit
        yield f"| {what} | {needs:.0f} | {has:.0f} {unit} | {has / needs:.2f} | {grays * needs / has:.1%} |"


def _shares(found: OnDevice) -> str:
    """What the rays hit, in percent of the rays."""
    return ", ".join(f"{100 * share:.0f} % {what}" for what, share in _batch(found).seen.items())


WORLDS_HEAD = """
## In many worlds

`rigcast bench worlds` puts a Unitree G1 on a height field with solids on it, {geoms} geoms with {triangles} triangles,
in each world at another place and in another posture. What the 16 x 64 rays of the lidar above its head hit:
{shares}.

Poses are float32 on the device, as mujoco_warp has them.

- A frame of rigcast is `rig.sense(poses, out=frames)`: trees over the geoms are updated, the sensor is placed, rays are
  cast and read into arrays on the device.
- mujoco_warp gets its rays ready made in the world. Its frame is `refit_bvh` and `rays`, or `rays` alone ("no refit").
"""
GPU = """
## On a GPU

{device}, {packages}. M rays/s; *graph* is a CUDA graph of the frame, replayed:

![M rays per second by the number of worlds](performance/worlds.png)
"""
NOT_MEASURED = """
## On a GPU: not measured

Nothing here was run on a GPU. What can be said is the floor.
"""
FLOOR = """
**The floor** is how many nodes, triangle blocks and height-field patches a ray must visit with these trees even if it
knew its hit beforehand: those whose boxes it enters before its hit. It is counted for each ray, and for warps of 32
neighbouring rays with what they share counted once. A node is 112 bytes and 4 boxes of 15 operations, a block 416 bytes
and 8 triangles of 60 operations, a patch 64 bytes and as many triangles (making these is left out); a ray reads 24
bytes and writes 24.
"""
FLOOR_OF_DATA_SHEET = """
An H200 moves 4.8 TB/s: if every node came from its memory once for every ray, {rays:.2g} G rays/s would be the
most. Trees of a few MB stay in its second-level cache of 50 MB, which is faster, and its 67 T operations a second would
allow more still. How far the kernel is from that has to be measured where there is a GPU.
"""
DISTANCE = """
The same run measured how fast the device reads 2 GB (memory), reads 16 MB over and over (second-level cache), and
computes products and sums, none of them fused. The fastest way of rigcast, {grays:.3g} G rays/s in {worlds} worlds,
compares with these limits as follows:
"""
