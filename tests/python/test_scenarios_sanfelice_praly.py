"""The scenarios of Sanfelice and Praly's paper, and the two backends on their specs."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

from hgo_rs import _core, reference
from hgo_rs.errors import MissingExtraError
from hgo_rs.scenarios import load
from hgo_rs.scenarios import sanfelice_praly as sp
from hgo_rs.scenarios.base import Context

IDS = [
    *(f"sanfelice-praly-table{i}" for i in range(1, 5)),
    *(f"sanfelice-praly-fig{i}" for i in range(1, 7)),
    "sanfelice-praly-design",
]
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")
STEPS = 12_000


def test_all_scenarios_are_registered_in_the_papers_order() -> None:
    assert [id for id in load() if id.startswith("sanfelice-praly")] == IDS


@pytest.mark.parametrize("id", IDS)
def test_every_row_meets_its_criterion(ctx: Context, id: str) -> None:
    if id.endswith("design"):
        pytest.importorskip("cvxpy")
    outcome = load()[id](ctx)
    assert [r.quantity for r in outcome.rows if not r.ok] == []
    assert len({r.quantity for r in outcome.rows}) == len(outcome.rows) >= 3


@pytest.mark.parametrize("id", [id for id in IDS if not id.endswith(("table3", "design"))])
def test_figures_are_drawn(ctx: Context, id: str) -> None:
    pytest.importorskip("matplotlib")
    from hgo_rs.plots import render

    figure = load()[id](ctx).figure
    assert figure is not None
    images = render(figure)
    assert images["png"].startswith(b"\x89PNG")
    assert len(images["svg"]) < 400_000  # light enough for the report


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_noise_statistics_hold_for_other_seeds(seed: int) -> None:
    rows = load()["sanfelice-praly-fig1"](Context("rust", seed=seed)).rows
    assert [r.quantity for r in rows if not r.ok] == []


def test_design_names_the_missing_extra(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(MissingExtraError, match=r'pip install "hgo_rs\[design\]"'):
        load()["sanfelice-praly-design"](ctx)


def test_the_noise_of_the_dead_zone_rows_inverts() -> None:
    std = sp.white_noise_std(4.06, 1.9, 2e-6)
    r, intensity = sp.gain_and_intensity(*std, 1.9)
    assert r == pytest.approx(4.06, rel=1e-12)
    assert intensity == pytest.approx(2e-6, rel=1e-12)


def test_linear_theory_is_the_lyapunov_equation() -> None:
    linalg = pytest.importorskip("scipy.linalg")
    r, nu1, intensity = 3.7, 2.22, 1.5e-6
    a = np.array([[nu1 - sp.K1 * r, 1.0], [-sp.K2 * r**2, 0.0]])
    k = np.array([[sp.K1 * r], [sp.K2 * r**2]])
    covariance = linalg.solve_continuous_lyapunov(a, -intensity * k @ k.T)
    assert sp.white_noise_std(r, nu1, intensity) == pytest.approx(
        np.sqrt(np.diag(covariance)), rel=1e-10
    )


def test_cycle_averages_are_those_of_an_adaptive_integrator(ctx: Context) -> None:
    """An integrator of order eight from a point of the cycle returns to it after one period."""
    integrate = pytest.importorskip("scipy.integrate")
    cycle = sp.limit_cycle(ctx, sp.P1)

    def rate(_: float, s: np.ndarray) -> list[float]:
        e1, e2, r = s
        growth = (e1**2 - sp.P2) * r ** (1.0 - 2.0 * sp.B) + sp.P2 / r**4
        return [
            e2 + sp.NU1 * e1 - sp.K1 * r * e1 - sp.NU2,
            -sp.K2 * r**2 * e1,
            sp.P1 * growth,
        ]

    start = [*cycle.e[0], cycle.r[0]]
    grid = np.linspace(0.0, cycle.period, 401)
    path = integrate.solve_ivp(
        rate, (0.0, cycle.period), start, method="DOP853", rtol=1e-12, atol=1e-14, t_eval=grid
    ).y
    assert path[:, -1] == pytest.approx(np.array(start), abs=1e-7)
    assert path[:2, :-1].std(axis=1) == pytest.approx(cycle.std[:2], rel=1e-6)
    assert path[2, :-1].mean() == pytest.approx(cycle.mean[2], rel=1e-9)


def shortened(kind: str, law: str, method: str) -> dict[str, Any]:
    """A noisy spec on which rounding does not grow: nu1 well below k1."""
    nu1 = 1.5
    spec = sp.study(
        sp.observer(nu1, law=law, method=method, kind=kind),
        [0.2, 0.0, 1.0],
        5e-3,
        STEPS * 5e-3,
        noise=sp.noise(sp.NOISE_MEAN, 2),
        runs=3,
        seed=7,
        every=1,
        windows=[[STEPS // 2, STEPS]],
    )
    if kind != "standard":
        copies = [v for x in (0.2, 0.1, -0.1) for v in (x, 0.0, 1.0)]
        spec["memory0"] = copies if kind == "collection" else [*spec["memory0"], *copies]
    return spec


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("kind", "law"),
    [
        ("standard", "adaptive"),
        ("standard", "dead-zone"),
        ("collection", "adaptive"),
        ("modified", "adaptive"),
    ],
)
def test_backends_agree(kind: str, law: str, method: str) -> None:
    spec = shortened(kind, law, method)
    ours, twin = _core.simulate(spec), reference.simulate(spec)
    assert ours["memory"].shape[1] == STEPS + 1
    assert np.all(ours["diverged_at"] == -1)
    for name in ("t", "y", "memory", "final_memory", "mean", "rms", "max", "peak"):
        scale = np.abs(twin[name]).max(axis=tuple(range(twin[name].ndim - 1)))
        difference = np.abs(ours[name] - twin[name]).max(axis=tuple(range(twin[name].ndim - 1)))
        assert np.all(difference <= 1e-12 * scale), (name, difference / scale)
