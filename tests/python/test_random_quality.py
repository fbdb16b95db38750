"""The core's uniform and normal variates as random numbers: full double precision, full tails.

Every test has a fixed seed, so that it always gives the same, and asks no more of a statistic than
that its probability is above `RARE`: sound variates fail one in ten thousand of such questions.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.special import ndtr

from hgo_rs import _core

Array = NDArray[np.float64]

N = 10_000_000
SEED = 20_240_229
RARE = 1e-4
FAR = stats.norm.isf(RARE / 2)
"""What a standard normal statistic exceeds, in magnitude, with probability `RARE`."""
MOMENTS = {
    "uniform": lambda p: 0.0 if p % 2 else 3.0 ** (p / 2) / (p + 1),
    "normal": lambda p: stats.norm.moment(p),
}
"""E x^p, standardised to mean 0 and variance 1."""


def standardised(kind: str, seed: int = SEED, run: int = 0, channel: int = 0) -> Array:
    """`N` values of a stream, brought to mean 0 and variance 1."""
    values = _core.random(kind, N, seed, run, channel)
    return values if kind == "normal" else (values - 0.5) * np.sqrt(12.0)


@pytest.fixture(scope="module", params=["uniform", "normal"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def draws(kind: str) -> Array:
    """The stream that most tests look at."""
    return standardised(kind)


def test_moments(kind: str, draws: Array) -> None:
    power = np.ones(N)
    for p, name in enumerate(["mean", "variance", "skewness", "kurtosis"], 1):
        power *= draws
        exact, spread = MOMENTS[kind](p), MOMENTS[kind](2 * p)
        error = np.sqrt((spread - exact**2) / N)
        assert abs(power.mean() - exact) < FAR * error, f"{name}: {power.mean()}, error {error}"


def test_kolmogorov_smirnov(kind: str, draws: Array) -> None:
    law = ndtr if kind == "normal" else lambda x: x / np.sqrt(12.0) + 0.5
    assert stats.kstest(draws, law, method="asymp").pvalue > RARE


def test_tails_of_the_normal() -> None:
    """Counts beyond so many sigma are binomial. (tests/properties/streams.rs goes beyond 6.)"""
    values = _core.random("normal", N, SEED)
    for sigmas in (1.0, 2.0, 3.0, 4.0, 5.0):
        for beyond in (values > sigmas, values < -sigmas):
            count = int(np.count_nonzero(beyond))
            p_value = stats.binomtest(count, N, stats.norm.sf(sigmas)).pvalue
            assert p_value > RARE, f"{count} beyond {sigmas} sigma"


def test_a_uniform_has_53_fair_bits() -> None:
    scaled = _core.random("uniform", N, SEED) * 2.0**53
    assert np.array_equal(scaled, np.floor(scaled))  # no bit below the 53rd,
    whole, counts = scaled.astype(np.uint64), np.zeros(53)
    for some in np.split(whole, 1000):
        counts += [np.count_nonzero(some & np.uint64(1 << bit)) for bit in range(53)]
    deviations = (counts - N / 2) / np.sqrt(N / 4)
    assert np.abs(deviations).max() < FAR, deviations  # and each is set half of the time,
    lowest = (whole & np.uint64(15)).astype(np.int64)
    pairs = np.bincount(16 * lowest[0::2] + lowest[1::2], minlength=256)
    assert stats.chisquare(pairs).pvalue > RARE  # the lowest four whatever they were before


def square(first: Array, second: Array, side: int = 100) -> float:
    """p-value of pairs of uniforms on side x side cells, by chi-square."""
    place = (side * first).astype(np.int64) * side + (side * second).astype(np.int64)
    return float(stats.chisquare(np.bincount(place, minlength=side * side)).pvalue)


def test_successive_values_fill_the_square(kind: str, draws: Array) -> None:
    uniform = ndtr(draws) if kind == "normal" else draws / np.sqrt(12.0) + 0.5
    assert square(uniform[0::2], uniform[1::2]) > RARE


NEIGHBOURS = {
    "next run": (SEED, 1, 0),
    "next seed": (SEED + 1, 0, 0),
    "other channel": (SEED, 0, 1),
    "run and seed exchanged": (0, SEED, 0),
}


LAGS = (0, 1, 2, 7, 1000)


@pytest.mark.parametrize("neighbour", ["itself", *NEIGHBOURS])
def test_no_correlation_at_any_lag(kind: str, draws: Array, neighbour: str) -> None:
    """Of the values and of their squares, with itself and with neighbours: N(0, 1/N) each."""
    alone = neighbour == "itself"
    other = draws if alone else standardised(kind, *NEIGHBOURS[neighbour])
    spread = np.sqrt(MOMENTS[kind](4) - 1.0)
    for what, a, b in (
        ("values", draws, other),
        ("squares", (draws * draws - 1.0) / spread, (other * other - 1.0) / spread),
    ):
        for lag in LAGS[alone:]:
            correlation = a[: N - lag] @ b[lag:] / N
            assert abs(correlation) < FAR / np.sqrt(N), f"{what}, lag {lag}"


@pytest.mark.parametrize("neighbour", NEIGHBOURS)
def test_neighbouring_streams_fill_the_square(neighbour: str) -> None:
    other = _core.random("uniform", N, *NEIGHBOURS[neighbour])
    assert square(_core.random("uniform", N, SEED), other) > RARE


@pytest.mark.parametrize("moved", ["run", "seed"])
def test_the_first_values_of_many_streams_are_uniform_and_independent(moved: str) -> None:
    """A study of short runs takes the beginnings of many streams."""
    count = 1_000_000
    begin = {"run": lambda i: (SEED, i), "seed": lambda i: (i, 0)}[moved]
    first = np.array([_core.random("uniform", 1, *begin(i))[0] for i in range(count)])
    assert stats.kstest(first, stats.uniform.cdf, method="asymp").pvalue > RARE
    assert square(first[0::2], first[1::2], side=50) > RARE
    assert abs(12.0 * (first[:-1] - 0.5) @ (first[1:] - 0.5)) < FAR * np.sqrt(count)


def test_a_normal_has_full_precision() -> None:
    """Beside sqrt(-2 ln u1) cos(2 pi u2), u1 in (0, 1] and u2 in [0, 1), to 40 digits.

    To five units in the last place, near 0 too.
    """
    count = 5_000
    given = _core.random("normal", count, SEED, 2)
    bits = (int(word) >> 11 for word in _core.random("bits", 2 * count, SEED, 2))
    with mpmath.workdps(40):
        unit, two_pi = mpmath.mpf(2) ** -53, 2 * mpmath.pi
        for value, (first, second) in zip(given, zip(bits, bits, strict=True), strict=True):
            radius = mpmath.sqrt(-2 * mpmath.log((first + 1) * unit))
            off = abs(float(value) - radius * mpmath.cos(two_pi * second * unit))
            assert off <= 5.0 * np.spacing(abs(value))
