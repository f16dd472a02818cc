"""Assertions on statistics of random samples.

A correct sample exceeds a bound with probability DOUBT. Seeds are fixed, so that a test that passes once always passes.
"""

from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

DOUBT = 1e-6
SIGMAS = -NormalDist().inv_cdf(DOUBT / 2)
"""4.89: the two-sided bound of a normal statistic, in standard deviations."""


def chi2_limit(freedom: int) -> float:
    """The value that chi squared exceeds with probability DOUBT, by the cube root of Wilson and Hilferty (1931).

    freedom: degrees of freedom.
    """
    spread = 2 / (9 * freedom)
    return float(freedom * (1 - spread - NormalDist().inv_cdf(DOUBT) * np.sqrt(spread)) ** 3)


def assert_mean(samples: ArrayLike, mean: float, std: float, what: str = "") -> None:
    """Assert that independent samples can be from a distribution of this mean and standard deviation, by their mean."""
    values = np.asarray(samples, np.float64)
    allowed = SIGMAS * std / np.sqrt(values.size)
    got = values.mean()
    assert abs(got - mean) <= allowed, (
        f"{what} mean: got {got}, expected {mean} +- {allowed:.3g} ({values.size} samples)"
    )


def assert_normal(samples: ArrayLike, mean: float, std: float, what: str = "") -> None:
    """Assert that samples can be normal: by mean, standard deviation and their counts in 64 equally probable bins."""
    values = np.asarray(samples, np.float64).reshape(-1)
    assert_mean(values, mean, std, what)
    # the variance of n normal samples has a standard deviation of std^2 sqrt(2 / n)
    allowed = SIGMAS * std * np.sqrt(0.5 / values.size)
    got = np.sqrt(np.mean((values - mean) ** 2))
    assert abs(got - std) <= allowed, f"{what} std: got {got}, expected {std} +- {allowed:.3g} ({values.size} samples)"
    edges = [NormalDist(mean, std).inv_cdf(k / 64) for k in range(1, 64)]
    assert_even(np.bincount(np.searchsorted(edges, values), minlength=64), what)


def assert_even(counts: ArrayLike, what: str = "") -> None:
    """Assert that these can be counts of equally probable events."""
    assert_counts(counts, np.full(np.size(counts), 1 / np.size(counts)), what)


def assert_counts(counts: ArrayLike, probability: ArrayLike, what: str = "") -> None:
    """Assert that these can be counts of events of these probabilities, by Pearson's chi squared."""
    got = np.asarray(counts, np.float64).reshape(-1)
    expected = got.sum() * np.asarray(probability, np.float64).reshape(-1)
    chi2, limit = float(((got - expected) ** 2 / expected).sum()), chi2_limit(got.size - 1)
    assert chi2 <= limit, f"{what} counts: chi squared {chi2:.1f} above {limit:.1f} ({got.size} bins)"


def assert_share(hits: NDArray[np.bool_], probability: float, what: str = "") -> None:
    """Assert that independent events of this probability can have happened where `hits` is True."""
    assert_mean(hits, probability, np.sqrt(probability * (1 - probability)), what)


def assert_uncorrelated(a: ArrayLike, b: ArrayLike, what: str = "") -> None:
    """Assert that two sets of n samples can be uncorrelated: r has then a standard deviation of 1 / sqrt(n)."""
    x, y = np.asarray(a, np.float64).reshape(-1), np.asarray(b, np.float64).reshape(-1)
    r, allowed = np.corrcoef(x, y)[0, 1], SIGMAS / np.sqrt(x.size)
    assert abs(r) <= allowed, f"{what} correlation: got {r}, expected 0 +- {allowed:.3g} ({x.size} samples)"
