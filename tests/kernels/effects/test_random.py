"""Random numbers: the published ones, the same on every device, evenly spread and independent."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type"

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from confidence import assert_even, assert_normal, assert_uncorrelated
from numpy.typing import NDArray

from rigcast.kernels.effects import draws
from rigcast.kernels.effects.random import (
    RandomSource,
    cosine_of,
    log_of,
    philox,
    random_bits,
    random_numbers,
    random_source,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]
SEED = 7
COUNT = 250_000


@wp.kernel
def _philox(counter: wp.array[wp.vec4ui], key: wp.array[wp.vec2ui], out: wp.array[wp.vec4ui]) -> None:
    i = wp.tid()
    out[i] = philox(counter[i], key[i])


@wp.kernel
def _draw(
    source: RandomSource,
    draw: int,
    bits: wp.array[wp.vec4ui],
    numbers: wp.array[wp.vec4],
) -> None:
    i = wp.tid()
    bits[i] = random_bits(source, i, draw)
    numbers[i] = random_numbers(source, i, draw)


@wp.kernel
def _functions(v: wp.array[float], logarithm: wp.array[float], cosine: wp.array[float], sine: wp.array[float]) -> None:
    i = wp.tid()
    logarithm[i] = log_of(v[i])
    cosine[i] = cosine_of(v[i], 0)
    sine[i] = cosine_of(v[i], 1)


def philox_reference(counter: NDArray[np.uint32], key: NDArray[np.uint32], rounds: int = 10) -> NDArray[np.uint32]:
    """(n, 4) words of Philox4x32 for counters (n, 4) and keys (n, 2), in numpy's 64-bit integers."""
    c, k = (np.asarray(words, np.uint64).T.copy() for words in (counter, key))
    word, low = np.uint64(32), np.uint64(0xFFFFFFFF)
    for _ in range(rounds):
        p0, p1 = np.uint64(0xD2511F53) * c[0], np.uint64(0xCD9E8D57) * c[2]
        c = np.stack([(p1 >> word) ^ c[1] ^ k[0], p1 & low, (p0 >> word) ^ c[3] ^ k[1], p0 & low])
        k = (k + np.array([[0x9E3779B9], [0xBB67AE85]], np.uint64)) & low
    return c.T.astype(np.uint32)


def worlds(*names: int, device: str = "cpu") -> wp.array:
    return wp.array(names, dtype=wp.uint32, device=device)


def drawn(source: RandomSource, draw: int = 0, count: int = COUNT, device: str = "cpu") -> dict[str, NDArray[Any]]:
    """Bits (n, 4), normal and uniform numbers (n, 2) of n rays, computed ray by ray."""
    bits, numbers = (wp.empty(count, dtype=dtype, device=device) for dtype in (wp.vec4ui, wp.vec4))
    wp.launch(_draw, count, inputs=[source, draw], outputs=[bits, numbers], device=device)
    normal, uniform = np.split(numbers.numpy(), 2, axis=1)
    return {"bits": bits.numpy(), "normal": normal, "uniform": uniform}


def as_uniform(bits: NDArray[np.uint32]) -> NDArray[np.float64]:
    return ((bits >> 9) + 0.5) / 2**23


def philox_on(device: str, counter: NDArray[np.uint32], key: NDArray[np.uint32]) -> NDArray[np.uint32]:
    out = wp.empty(len(counter), dtype=wp.vec4ui, device=device)
    inputs = [wp.array(counter, dtype=wp.vec4ui, device=device), wp.array(key, dtype=wp.vec2ui, device=device)]
    wp.launch(_philox, len(counter), inputs=inputs, outputs=[out], device=device)
    return out.numpy()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    # "philox4x32 10" in kat_vectors of Random123, https://github.com/DEShawResearch/random123/tree/main/tests
    [
        ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ],
)
def test_the_published_vectors_come_out(device: str, counter: str, key: str, expected: str) -> None:
    counters, keys, words = (
        np.array([[int(word, 16) for word in text.split()]], np.uint32) for text in (counter, key, expected)
    )
    np.testing.assert_array_equal(philox_on(device, counters, keys), words)
    np.testing.assert_array_equal(philox_reference(counters, keys), words)


@pytest.mark.parametrize("device", DEVICES)
def test_integers_are_those_of_the_reference_bit_for_bit(device: str) -> None:
    rng = np.random.default_rng(SEED)
    counter = rng.integers(0, 2**32, (100_000, 4), np.uint32)
    key = rng.integers(0, 2**32, (100_000, 2), np.uint32)
    np.testing.assert_array_equal(philox_on(device, counter, key), philox_reference(counter, key))


@pytest.mark.parametrize("device", DEVICES)
def test_a_draw_is_a_function_of_seed_sensor_world_frame_ray_and_draw(device: str) -> None:
    source = random_source(SEED, "top", frame=2**32 + 11, worlds=worlds(13, device=device), rays=COUNT)
    counter = np.stack([np.full(1000, 5), np.arange(1000), np.full(1000, 11), np.full(1000, 13)], axis=-1)
    key = np.tile(np.array([source.key[0], source.key[1]], np.uint32), (1000, 1))
    expected = philox_reference(counter.astype(np.uint32), key)
    got = drawn(source, draw=5, count=1000, device=device)
    np.testing.assert_array_equal(got["bits"], expected)
    np.testing.assert_array_equal(got["uniform"], as_uniform(expected)[:, 2:])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("rays", [None, 1, 7, 1000, 100_000])
@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 5003])
def test_numbers_of_many_rays_are_those_of_each_bit_for_bit(count: int, rays: int | None, device: str) -> None:
    if rays is None:
        source = random_source(SEED, "top", frame=3)
    else:
        source = random_source(SEED, "top", 3, worlds(*range(9, 9 + 5003, 1), device=device), rays)
    made, launches = draws.prepare_draws(source, 4, count, device, times=2)
    for launch in launches:
        launch()
    got = made.numbers.numpy()
    each = [drawn(source, draw, count, device) for draw in (4, 5)]
    expected = np.concatenate([np.concatenate([one["normal"], one["uniform"]], axis=1) for one in each])
    np.testing.assert_array_equal(got, expected)


def test_numbers_drawn_one_by_one_are_those_of_sixteen_rays_at_once() -> None:
    source, one = random_source(SEED, "top", frame=3), draws.Draws()
    one.numbers = wp.empty(1003, dtype=wp.vec4, device="cpu")
    wp.launch(draws.draw_one, 1003, inputs=[0, source, 4], outputs=[one], device="cpu")
    np.testing.assert_array_equal(draws.drawn(source, 4, 1003, "cpu").numbers.numpy(), one.numbers.numpy())


@pytest.mark.parametrize("device", DEVICES)
def test_normal_numbers_are_box_muller_within_ulps(device: str) -> None:
    """To 4 ulps of the radius, the sum of the errors of logarithm, square root, cosine or sine, and product."""
    got = drawn(random_source(SEED, "top", frame=0), device=device)
    u, v = as_uniform(got["bits"])[:, :2].T
    radius, angle = np.sqrt(-2 * np.log(u)), 2 * np.pi * v
    expected = radius * np.array([np.cos(angle), np.sin(angle)])
    error = np.abs(got["normal"] - expected.T) / radius[:, None]
    assert error.max() <= 4 * 2.0**-23, f"got {error.max() * 2**23:.1f} ulps"


@pytest.mark.parametrize("device", DEVICES)
def test_logarithms_cosines_and_sines_of_all_uniform_numbers_are_right_to_an_ulp(device: str) -> None:
    v = (np.arange(2**23) + 0.5) / 2**23
    values = [wp.empty(len(v), dtype=float, device=device) for _ in range(3)]
    wp.launch(_functions, len(v), inputs=[wp.array(v, dtype=float, device=device)], outputs=values, device=device)
    exact = np.log(v), np.cos(2 * np.pi * v), np.sin(2 * np.pi * v)
    for name, got, expected, size in zip(
        ("ln", "cos", "sin"), values, exact, (1 + np.abs(exact[0]), 1, 1), strict=True
    ):
        ulps = np.abs(got.numpy() - expected) / size * 2**23
        assert ulps.max() <= 1, f"{name} {v[ulps.argmax()]}: off by {ulps.max():.2f} ulps"


@pytest.mark.cuda
def test_numbers_have_the_same_bits_on_every_device() -> None:
    source = random_source(SEED, "top", frame=0)
    on_cpu, on_cuda = (draws.drawn(source, 0, COUNT, device).numbers.numpy() for device in ("cpu", "cuda:0"))
    np.testing.assert_array_equal(on_cuda, on_cpu)


def test_numbers_of_a_seed_do_not_change_from_version_to_version() -> None:
    source = random_source(SEED, "top", frame=0)
    assert [f"{int(word):08x}" for word in source.key] == ["f62b50cd", "265463c3"]


@pytest.mark.parametrize("kind", ["bits", "uniform"])
def test_uniform_numbers_are_evenly_spread(kind: str) -> None:
    """10^6 numbers in 2^12 bins, by their upper bits; words also by their middle and lower bits."""
    values = drawn(random_source(SEED, "top", frame=0))[kind]
    if kind == "uniform":
        assert 0 < values.min() < values.max() < 1
        assert_even(np.bincount((values.reshape(-1) * 4096).astype(int), minlength=4096))
        return
    for shift in (20, 10, 0):
        assert_even(np.bincount((values.reshape(-1) >> np.uint32(shift)) & 4095, minlength=4096), f"shift {shift}")


def test_neighbouring_numbers_are_evenly_spread_in_pairs() -> None:
    """Pairs of numbers of one ray, and of neighbouring rays, in 64 x 64 squares."""
    cell = (drawn(random_source(SEED, "top", frame=0))["uniform"] * 64).astype(int)
    for what, a, b in (("one ray", cell[:, 0], cell[:, 1]), ("two rays", cell[:-1, 0], cell[1:, 0])):
        assert_even(np.bincount(64 * a + b, minlength=4096), what)


def test_normal_numbers_are_normal() -> None:
    values = drawn(random_source(SEED, "top", frame=0))["normal"]
    assert_normal(values, 0.0, 1.0)
    assert np.abs(values).max() <= math.sqrt(2 * 24 * math.log(2))
    assert_uncorrelated(values[:, 0], values[:, 1], "the two")
    assert_uncorrelated(values[:, 0] ** 2, values[:, 1] ** 2, "squares of the two")


@pytest.mark.parametrize(
    ("other", "draw"),
    [
        (random_source(SEED + 1, "top", frame=0), 0),
        (random_source(SEED, "top2", frame=0), 0),
        (random_source(SEED, "top", frame=1), 0),
        (random_source(SEED, "top", frame=0, worlds=worlds(1), rays=COUNT), 0),
        (random_source(SEED, "top", frame=0), 1),
    ],
    ids=["seed", "sensor", "frame", "world", "draw"],
)
def test_numbers_that_differ_in_one_thing_are_independent(other: RandomSource, draw: int) -> None:
    a = drawn(random_source(SEED, "top", frame=0))["normal"]
    b = drawn(other, draw)["normal"]
    assert_uncorrelated(a, b)
    assert_uncorrelated(a**2, b**2)


def test_rays_are_independent_at_every_lag() -> None:
    values = drawn(random_source(SEED, "top", frame=0))["normal"][:, 0]
    for lag in (1, 2, 16, 64, 1024, 1808, 65536):
        assert_uncorrelated(values[lag:], values[:-lag], f"lag {lag}")
