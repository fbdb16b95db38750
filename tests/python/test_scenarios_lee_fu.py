"""The scenarios of Lee, Choi, Khalil and of Fu, Kang, Li, on the compiled core."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hgo_rs import _core, reference
from hgo_rs.scenarios import Context, Outcome, fu, lee, load

IDS = [id for id, scenario in load().items() if scenario.paper in ("lee", "fu")]


@pytest.fixture(scope="module")
def outcomes(ctx: Context) -> dict[str, Outcome]:
    return {id: load()[id](ctx) for id in IDS}


def test_every_figure_is_a_scenario() -> None:
    lee_ids = [*(f"lee-fig{i}" for i in range(1, 7)), "lee-stability"]
    fu_ids = [*(f"fu-fig{i}" for i in range(1, 4)), "fu-consistency", "fu-limits"]
    assert lee_ids + fu_ids == IDS


@pytest.mark.parametrize("id", IDS)
def test_rows_are_within_tolerance(outcomes: dict[str, Outcome], id: str) -> None:
    missed = [
        f"{r.quantity}: {r.ours}, not {r.expected} ({r.tolerance})"
        for r in outcomes[id].rows
        if not r.ok
    ]
    assert outcomes[id].rows
    assert not missed, "\n".join(missed)
    quantities = [r.quantity for r in outcomes[id].rows]
    assert len(set(quantities)) == len(quantities)


@pytest.mark.parametrize("id", IDS)
def test_figures_draw_at_most_5000_points_a_line(outcomes: dict[str, Outcome], id: str) -> None:
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    from hgo_rs.plots import style

    figure = Figure()
    draw = outcomes[id].figure
    assert draw is not None
    with style():
        draw(figure)
    lines = [line for ax in figure.axes for line in ax.get_lines()]
    assert lines
    assert max(len(np.atleast_1d(line.get_xdata())) for line in lines) <= 5_000
    assert all(np.isfinite(np.asarray(line.get_ydata(), dtype=float)).all() for line in lines)
    # Time (or T, k, step) is named on the lowest axis of every column.
    assert figure.axes[-1].get_xlabel()


class Wrong:
    """The compiled core with every RMS 5 % too large."""

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx

    def simulate(self, spec: dict[str, Any]) -> dict[str, Any]:
        result = self.ctx.simulate(spec)
        return result | {"rms": 1.05 * result["rms"]}

    def mean_covariance(self, spec: dict[str, Any]) -> dict[str, Any]:
        result = self.ctx.mean_covariance(spec)
        return result | {"rms": 1.05 * result["rms"]}


@pytest.mark.parametrize("id", ["lee-fig2", "lee-fig4", "lee-fig6", "fu-fig1", "fu-fig2"])
def test_a_wrong_core_misses(ctx: Context, outcomes: dict[str, Outcome], id: str) -> None:
    rows = load()[id](Context("rust", ctx.seed, module=Wrong(ctx))).rows
    assert any(not r.ok for r in rows)


# --- the compiled core and the NumPy reference ------------------------------------------------


def difference(a: Any, b: Any) -> float:
    """Largest difference relative to the array's largest entry."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    assert a.shape == b.shape
    return float(np.max(np.abs(a - b)) / max(np.max(np.abs(b)), 1e-300))


LEE_SPECS = [
    lee.study(reading, 12_000, noise=lee.NOISE, runs=3, seed=7, every=50, windows=[(2_000, 12_000)])
    for reading in lee.READINGS
]
FU_SPECS = [
    fu.study(gain, dt, 9.0, runs=3, seed=7, every=1, windows=[(2, round(9.0 / dt))])
    for gain in fu.GAINS
    for dt in (0.03, 0.3)
]


@pytest.mark.parametrize("spec", LEE_SPECS + FU_SPECS)
def test_simulations_agree(spec: dict[str, Any]) -> None:
    rust, numpy = _core.simulate(spec), reference.simulate(spec)
    for key in ("t", "x", "memory", "y", "mean", "rms", "max", "peak", "final_x", "final_memory"):
        assert difference(rust[key], numpy[key]) < 1e-12, key
    assert np.array_equal(rust["diverged_at"], numpy["diverged_at"])


@pytest.mark.parametrize("reading", lee.READINGS)
def test_exact_errors_agree(reading: str) -> None:
    spec = lee.study(reading, 6_000, windows=[(0, 100), (1_000, 6_000)], variance=lee.VARIANCE)
    rust, numpy = _core.mean_covariance(spec), reference.mean_covariance(spec)
    for key in ("rms", "final_covariance"):
        assert difference(rust[key], numpy[key]) < 1e-12, key


@pytest.mark.parametrize("name", fu.STRONG_ORDERS)
def test_coupled_paths_agree(name: str) -> None:
    plant, method, _ = fu.STRONG_ORDERS[name]
    spec = {"plant": plant, "x0": fu.X0, "t_end": 1.0, "coarse": 32, "fine": 4, "method": method}
    rust, numpy = (f.coupled_paths(spec | {"runs": 4, "seed": 7}) for f in (_core, reference))
    for key in ("coarse", "fine"):
        assert difference(rust[key], numpy[key]) < 1e-12, key


# --- the exponents ----------------------------------------------------------------------------


def test_exponents_of_a_constant_matrix(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    # mu = 0 leaves I + T A with the eigenvalues 1 - 2T and 1 - 3T, whatever the path.
    monkeypatch.setattr(fu, "EPSILON", 0.0)
    monkeypatch.setattr(fu, "CLONES", 50)
    rho = np.maximum(np.abs(1.0 - 2.0 * fu.EXPONENT_T), np.abs(1.0 - 3.0 * fu.EXPONENT_T))
    expected = np.log(rho) / fu.EXPONENT_T
    found = fu.almost_sure_exponents(ctx, "derived")
    assert found[:6] == pytest.approx(expected[:6], rel=0.02)
    at = 0.1
    assert fu.mean_square_exponent(ctx, "derived", at) == pytest.approx(
        2.0 * np.log(1.0 - 2.0 * at) / at, rel=0.02
    )


def test_first_zero() -> None:
    dt = np.arange(0.1, 0.71, 0.1)
    assert fu.first_zero(dt, (dt - 0.43) * (2.0 + dt)) == pytest.approx(0.43, abs=1e-9)
    assert np.isnan(fu.first_zero(dt, dt))
