"""Returns: echoes are grouped by gaps and chosen by range and power, as in a plain loop over sorted echoes."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from rigcast.kernels.effects.lidars.echoes import Echoes, new_echoes
from rigcast.kernels.effects.lidars.returns import DUAL, FIRST, LAST, STRONGEST, prepare_choice

SEED = 5
GAP = 0.75


class Group(NamedTuple):
    distance: float
    power: float
    shape: int


NONE = Group(np.inf, 0.0, -1)


def made(distance: NDArray[np.float32], power: NDArray[np.float32]) -> Echoes:
    """Echoes with these distances and powers (beams, slots); the shape of each is its slot."""
    beams, slots = distance.shape
    echoes = new_echoes(slots, beams, "cpu")
    echoes.distance.assign(distance.T.reshape(-1))
    echoes.power.assign(power.T.reshape(-1))
    shape = np.repeat(np.arange(slots, dtype=np.int32), beams)
    echoes.shape.assign(shape)
    echoes.face.assign(10 * shape)
    echoes.normal.assign(np.repeat(np.arange(slots, dtype=np.float32), 3 * beams).reshape(-1, 3))
    return echoes


def choose(echoes: Echoes, beams: int, gap: float, least: float, mode: int) -> Echoes:
    returns = new_echoes(2 if mode == DUAL else 1, beams, "cpu")
    prepare_choice(echoes, beams, gap, least, mode, returns)()
    return returns


def groups_of(distance: NDArray[np.float32], power: NDArray[np.float32], gap: float) -> list[Group]:
    """The groups of the echoes of one beam, nearest first."""
    order = [k for k in np.argsort(distance, kind="stable") if np.isfinite(distance[k])]
    split = np.flatnonzero(np.diff(distance[order]) > gap) + 1
    parts = [part for part in np.split(np.array(order, int), split) if len(part)]
    return [
        Group(
            float(np.average(distance[part], weights=np.maximum(power[part], 1e-20))),
            float(power[part].sum()),
            int(part[np.argmax(power[part])]),
        )
        for part in parts
    ]


def expected(groups: list[Group], least: float, mode: int) -> list[Group]:
    seen = [group for group in groups if group.power >= least]
    if not seen:
        return [NONE, NONE] if mode == DUAL else [NONE]
    ranked = sorted(seen, key=lambda group: -group.power)
    if mode != DUAL:
        return [{FIRST: seen[0], LAST: seen[-1], STRONGEST: ranked[0]}[mode]]
    second = seen[-1] if seen[-1] is not ranked[0] else (ranked[1] if len(ranked) > 1 else NONE)
    return [ranked[0], second]


@pytest.mark.parametrize("mode", [FIRST, LAST, STRONGEST, DUAL])
@pytest.mark.parametrize("least", [0.0, 0.4])
@pytest.mark.parametrize("slots", [1, 7, 40])
def test_returns_are_those_of_the_reference(mode: int, least: float, slots: int) -> None:
    rng = np.random.default_rng(SEED)
    distance = rng.uniform(0.5, 2 + 0.7 * slots, (400, slots)).astype(np.float32)
    distance[rng.random(distance.shape) < 0.2] = np.inf
    power = rng.random(distance.shape).astype(np.float32)
    returns = choose(made(distance, power), len(distance), GAP, least, mode)
    got = zip(returns.distance.numpy(), returns.power.numpy(), returns.shape.numpy(), strict=True)
    want = [g for d, p in zip(distance, power, strict=True) for g in expected(groups_of(d, p, GAP), least, mode)]
    for k, (g, w) in enumerate(zip(got, want, strict=True)):
        what = f"seed {SEED}, return {k}: got {g}, expected {w}"
        assert g[2] == w.shape, what
        if w is not NONE:
            np.testing.assert_allclose(g[:2], w[:2], rtol=1e-5, err_msg=what)
        else:
            assert g[0] == np.inf, what
    shape = returns.shape.numpy()
    np.testing.assert_array_equal(returns.face.numpy(), np.where(shape < 0, -1, 10 * shape))
    np.testing.assert_array_equal(returns.normal.numpy()[:, 0], np.where(shape < 0, 0, shape))


def test_echoes_just_within_the_gap_are_one_and_just_beyond_it_two() -> None:
    distance = np.array([[4.0, 4.74], [4.0, 4.76]], np.float32)
    returns = choose(made(distance, np.array([[3.0, 1.0]] * 2, np.float32)), 2, GAP, 0.0, DUAL)
    np.testing.assert_allclose(returns.distance.numpy(), [4.185, np.inf, 4.0, 4.76], rtol=1e-6)
    np.testing.assert_allclose(returns.power.numpy(), [4.0, 0.0, 3.0, 1.0])


def test_one_echo_keeps_its_range_bit_for_bit_and_a_black_one_has_a_range_too() -> None:
    rng = np.random.default_rng(SEED)
    distance = rng.uniform(0, 300, (5000, 1)).astype(np.float32)
    for power in (rng.random(distance.shape), np.zeros(distance.shape)):
        returns = choose(made(distance, power.astype(np.float32)), len(distance), GAP, 0.0, STRONGEST)
        np.testing.assert_array_equal(returns.distance.numpy(), distance[:, 0])


@pytest.mark.parametrize("mode", [FIRST, LAST, STRONGEST, DUAL])
@pytest.mark.parametrize("least", [0.0, 0.4])
def test_a_beam_with_one_slot_has_the_returns_of_one_whose_other_slots_are_empty(mode: int, least: float) -> None:
    """Bit for bit, although `choose_only` does not search for groups."""
    rng = np.random.default_rng(SEED)
    distance, power = np.full((4000, 3), np.inf, np.float32), np.zeros((4000, 3), np.float32)
    special = np.array([np.inf, np.nan, 0.0, 1e-30, 3e38], np.float32)
    distance[:, 0] = np.where(rng.random(4000) < 0.5, rng.uniform(0, 100, 4000), rng.choice(special, 4000))
    special = np.array([np.nan, 0.0, 0.4, np.nextafter(np.float32(0.4), np.float32(0)), 1e-30], np.float32)
    power[:, 0] = np.where(rng.random(4000) < 0.5, rng.random(4000), rng.choice(special, 4000))
    one = choose(made(distance[:, :1], power[:, :1]), len(distance), GAP, least, mode)
    several = choose(made(distance, power), len(distance), GAP, least, mode)
    for field in ("distance", "power", "shape", "face", "normal"):
        got, expected = getattr(one, field).numpy(), getattr(several, field).numpy()
        np.testing.assert_array_equal(got, expected, err_msg=f"seed {SEED}: {field}")


def test_a_beam_that_is_not_finite_has_returns_that_are_not_a_number() -> None:
    distance = np.array([[np.nan, np.inf], [1.0, np.inf]], np.float32)
    returns = choose(made(distance, np.ones_like(distance)), 2, GAP, 0.0, DUAL)
    np.testing.assert_array_equal(returns.distance.numpy(), [np.nan, np.nan, 1.0, np.inf])
    np.testing.assert_array_equal(returns.shape.numpy(), [-1, -1, 0, -1])
