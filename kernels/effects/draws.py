"""Random numbers for many rays, drawn before they are used: on the CPU for sixteen rays at once, on CUDA singly."""

from collections.abc import Callable

import warp as wp

from rigcast.kernels.launching.slices import prepare_over_rays, prepare_over_runs
from rigcast.kernels.packets.packet import LANES, lanes

from .random import M0, M1, W0, W1, WORD, RandomSource, as_uniform, cosine_of, normal_radius, random_numbers

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "max_unroll": 1})

BYTES_PER_DRAW = 16
word_lanes = wp.types.vector(length=16, dtype=wp.uint32)


@wp.struct
class Words:
    """Four 32-bit words for each of sixteen rays."""

    c0: word_lanes
    c1: word_lanes
    c2: word_lanes
    c3: word_lanes


@wp.struct
class Draws:
    """Random numbers, one vec4 per ray. A struct, because Warp compiles a kernel twice if arrays are its arguments."""

    numbers: wp.array[wp.vec4]


@wp.func
def philox_lanes(source: RandomSource, i: int, draw: int) -> Words:
    """Philox4x32-10 for rays i to i + LANES - 1; equals rigcast.kernels.effects.random.random_bits for each."""
    c0 = word_lanes(wp.uint32(draw))
    c1 = word_lanes()
    c2 = word_lanes(source.frame)
    c3 = word_lanes()
    for j in range(LANES):
        c1[j] = wp.uint32(i + j)
    if source.worlds.shape[0] > 0:
        for j in range(LANES):
            c1[j] = wp.uint32((i + j) % source.rays)
            c3[j] = source.worlds[(i + j) / source.rays]
    k0 = wp.uint32(source.key[0])
    k1 = wp.uint32(source.key[1])
    for _ in range(10):
        for j in range(LANES):
            p0 = M0 * wp.uint64(c0[j])
            p1 = M1 * wp.uint64(c2[j])
            c0[j] = wp.uint32(p1 >> WORD) ^ c1[j] ^ k0
            c2[j] = wp.uint32(p0 >> WORD) ^ c3[j] ^ k1
            c1[j] = wp.uint32(p1)
            c3[j] = wp.uint32(p0)
        k0 += W0
        k1 += W1
    words = Words()
    words.c0 = c0
    words.c1 = c1
    words.c2 = c2
    words.c3 = c3
    return words


@wp.func
def draw_lanes(source: RandomSource, i: int, draw: int, numbers: wp.array[wp.vec4]) -> None:
    """Write the numbers of rays i to i + LANES - 1; equals rigcast.kernels.effects.random.random_numbers for each."""
    words = philox_lanes(source, i, draw)
    c0 = words.c0
    c1 = words.c1
    first = lanes()
    second = lanes()
    for j in range(LANES):
        radius = normal_radius(as_uniform(c0[j]))
        v = as_uniform(c1[j])
        first[j] = radius * cosine_of(v, 0)
        second[j] = radius * cosine_of(v, 1)
    for j in range(LANES):
        numbers[i + j] = wp.vec4(first[j], second[j], as_uniform(words.c2[j]), as_uniform(words.c3[j]))


@wp.kernel
def draw_one(first: int, source: RandomSource, draw: int, draws: Draws) -> None:
    """Draw the numbers of one ray per thread."""
    i = first + wp.tid()
    draws.numbers[i] = random_numbers(source, i, draw)


@wp.kernel
def draw_run(first: int, run: int, source: RandomSource, draw: int, draws: Draws) -> None:
    """Draw the numbers of a run of rays per thread. run: rays per thread."""
    i = (first + wp.tid()) * run
    end = wp.min(i + run, draws.numbers.shape[0])
    while i + LANES <= end:
        draw_lanes(source, i, draw, draws.numbers)
        i += LANES
    while i < end:
        draws.numbers[i] = random_numbers(source, i, draw)
        i += 1


def drawn(source: RandomSource, draw: int, count: int, device: wp.DeviceLike) -> Draws:
    """Random numbers of `count` rays, drawn once; see `prepare_draws`."""
    draws, launches = prepare_draws(source, draw, count, device)
    for launch in launches:
        launch()
    return draws


def prepare_draws(
    source: RandomSource, draw: int, count: int, device: wp.DeviceLike, times: int = 1
) -> tuple[Draws, list[Callable[[], object]]]:
    """Random numbers (times * count,) of `count` rays: for each, two standard normal and two uniform numbers in (0, 1),
    all independent; and the launches that draw them, each time from what `source` is by then. Draw k of ray i is entry
    k * count + i and has the number draw + k in the source."""
    draws = Draws()
    draws.numbers = wp.empty(times * count, dtype=wp.vec4, device=device)
    prepare, kernel = (prepare_over_rays, draw_one) if wp.get_device(device).is_cuda else (prepare_over_runs, draw_run)
    launches = []
    for k in range(times if count else 0):
        part = Draws()
        part.numbers = draws.numbers[k * count : (k + 1) * count] if times > 1 else draws.numbers
        launches.append(prepare(kernel, count, [source, draw + k], [part], device))
    return draws, launches
