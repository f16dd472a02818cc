"""Rain and fog: extinction by an integral over drops, the strongest drop by brute force, fog by quadrature."""

# mypy: disallow-untyped-decorators=False, disable-error-code="valid-type"

import math

import numpy as np
import pytest
import warp as wp
from confidence import assert_counts, assert_share
from numpy.typing import NDArray

from rigcast.kernels.effects.lidars import weather
from rigcast.kernels.effects.lidars.echoes import new_echoes
from rigcast.kernels.effects.random import random_source

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SEED = 11
COUNT = 100_000


@wp.kernel
def _roots(x: wp.array[float], out: wp.array[float]) -> None:
    i = wp.tid()
    out[i] = weather.cube_root(x[i])


def test_cube_roots_are_within_two_ulps() -> None:
    x = np.geomspace(1e-30, 1e30, 1_000_003).astype(np.float32)
    got = wp.empty(len(x), dtype=float, device="cpu")
    wp.launch(_roots, len(x), inputs=[wp.array(x, dtype=float, device="cpu")], outputs=[got], device="cpu")
    np.testing.assert_allclose(got.numpy(), np.cbrt(x.astype(np.float64)), rtol=2 * 2.0**-23)


def scattered(
    targets: NDArray[np.float32], rain: weather.Rain, fog: weather.FogResponse | None = None, extinction: float = 0.0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Ranges and powers (beams, 2) of the echoes of rain and fog in front of targets (beams,)."""
    beams = len(targets)
    echoes = new_echoes(3, beams, "cpu")
    echoes.distance.assign(np.concatenate([targets, np.zeros(2 * beams)]).astype(np.float32))
    source = random_source(SEED, "top", frame=0)
    weather.prepare_weather(rain, weather.fog_of(fog, "cpu"), source, extinction, echoes, beams, 1)()
    return tuple(array.numpy().reshape(3, beams)[1:].T for array in (echoes.distance, echoes.power))


@pytest.mark.parametrize("rate", [0.5, 10, 50])
def test_extinction_is_twice_the_cross_section_of_all_drops(rate: float) -> None:
    diameter = np.linspace(0, 30, 300_001)
    drops = 8000 * np.exp(-4.1 * rate**-0.21 * diameter)
    each = 2 * np.pi / 4 * (1e-3 * diameter) ** 2 * drops
    exact = np.sum(0.5 * (each[1:] + each[:-1]) * np.diff(diameter))
    assert weather.rain_extinction(rate) == pytest.approx(exact, rel=1e-6)


def test_extinction_of_rain_is_that_of_measurements() -> None:
    """1.076 R^0.67 dB/km (Carbonneau and Wisely 1998), fitted to links in the near infrared, within a factor of 2."""
    for rate in (1.0, 10.0, 50.0):
        decibel_per_km = 10 * math.log10(math.e) * 1000 * weather.rain_extinction(rate)
        assert 0.5 < decibel_per_km / (1.076 * rate**0.67) < 2


def test_extinction_of_fog_leaves_a_twentieth_at_the_visibility() -> None:
    assert math.exp(-weather.fog_extinction(50.0) * 50.0) == pytest.approx(0.05)
    assert weather.fog_extinction(math.inf) == weather.rain_extinction(0.0) == 0.0


def brute_force(
    rate: float, divergence: float, target: float, extinction: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range, +inf for none, and power (COUNT,) of the strongest of all drops in each beam, as in LISA."""
    rng = np.random.default_rng(SEED)
    slope = 4.1 * rate**-0.21
    density = 8000 / slope * np.exp(-slope * 0.05)
    volume = np.pi / 12 * divergence**2 * (target**3 - 1.5**3)
    distance, power = np.full(COUNT, np.inf), np.zeros(COUNT)
    for some in np.split(np.arange(COUNT), 20):
        drops = rng.poisson(density * volume, len(some))
        r = np.cbrt(1.5**3 + rng.random(drops.sum()) * (target**3 - 1.5**3))
        d = 1e-3 * (0.05 + rng.exponential(1 / slope, len(r)))
        p = (0.328 / 2.328) ** 2 * np.exp(-2 * extinction * r) / r**2 * np.minimum((d / (divergence * r)) ** 2, 1)
        order = np.lexsort((p, np.repeat(some, drops)))
        last = np.cumsum(drops)[drops > 0] - 1
        distance[some[drops > 0]], power[some[drops > 0]] = r[order[last]], p[order[last]]
    return distance, power


@pytest.mark.parametrize(("rate", "divergence", "target"), [(10, 0.003, 15), (50, 0.003, 20), (25, 0.001, 30)])
def test_the_strongest_drop_is_that_of_all_drops(rate: float, divergence: float, target: float) -> None:
    """Probability of a drop, and its power and range in 20 bins each: 10^5 beams against 10^5 by brute force."""
    extinction = weather.rain_extinction(rate)
    r, p = scattered(np.full(COUNT, target), weather.rain_of(rate, divergence), extinction=extinction)
    want_r, want_p = brute_force(rate, divergence, target, extinction)
    drops = np.isfinite(want_r)
    density = weather.rain_of(rate, divergence).density
    chance = 1 - math.exp(-density * np.pi / 12 * divergence**2 * (target**3 - 1.5**3))
    assert_share(np.isfinite(r[:, 0]), chance, "drop")
    for what, got, want in (("power", p, want_p), ("range", r, want_r)):
        edges = np.quantile(want[drops], np.linspace(0, 1, 21)[1:-1])
        counts = [
            np.bincount(np.searchsorted(edges, a), minlength=20) for a in (got[np.isfinite(r[:, 0]), 0], want[drops])
        ]
        both = (counts[0] + counts[1]) / np.sum(counts)
        # two samples of one distribution: chi squared of both against their mean has as many degrees of freedom
        assert_counts(np.concatenate(counts), np.concatenate([both, both]) / 2, f"{what}, {rate} mm/h")


def test_no_drop_is_nearer_than_lisas_first_or_behind_the_target() -> None:
    r, _ = scattered(np.linspace(0, 40, COUNT).astype(np.float32), weather.rain_of(100, 0.01))
    seen = np.isfinite(r[:, 0])
    assert seen.mean() > 0.5
    assert (r[seen, 0] >= 1.5).all()
    assert (r[seen, 0] < np.linspace(0, 40, COUNT)[seen] + 1e-6).all()


@pytest.mark.parametrize("visibility", [10.0, 50.0, 200.0])
@pytest.mark.parametrize("target", [0.5, 1.5, 5.0, 100.0])
def test_the_echo_of_fog_is_the_largest_of_the_integral(visibility: float, target: float) -> None:
    """Quadrature over the pulse in steps of 1 mm; the table is computed in steps of 1 cm for targets every 10 cm."""
    extinction = weather.fog_extinction(visibility)
    half_pulse, c = 20e-9, 299_792_458.0
    lag = np.arange(0.0, c * half_pulse, 1e-3)

    def power(at: float) -> float:
        r = at - lag
        near = np.maximum(r, 1e-3)
        overlap = np.clip((near - 0.9) / 0.1, 0, 1) * (r <= target)
        integrand = np.sin(np.pi * lag / (c * half_pulse)) ** 2 * overlap * np.exp(-2 * extinction * near) / near**2
        return float(0.046 / visibility / (1e-6 / np.pi) * integrand.sum() * 1e-3 * 2 / c)

    places = np.arange(0.5, 15, 0.02)
    powers = np.array([power(at) for at in places])
    none = weather.rain_of(0.0, 0.003)
    r, p = scattered(np.array([target], np.float32), none, weather.fog_response(visibility, extinction), extinction)
    assert p[0, 1] == pytest.approx(powers.max(), rel=0.02)
    if powers.max() > 0:
        assert r[0, 1] == pytest.approx(places[powers.argmax()] - c * half_pulse / 2, abs=0.05)
    else:
        assert r[0, 1] == np.inf


def test_nothing_is_scattered_in_front_of_a_beam_that_is_not_finite() -> None:
    fog = weather.fog_response(20.0, 0.1)
    r, p = scattered(np.full(10, np.nan, np.float32), weather.rain_of(100, 0.01), fog)
    assert (r == np.inf).all()
    assert (p == 0).all()
