"""The scenarios of Khalil's textbook, on the compiled core."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hgo_rs import _core, reference
from hgo_rs.scenarios import Context, Outcome, khalil, load

IDS = [id for id, scenario in load().items() if scenario.paper == "khalil"]


@pytest.fixture(scope="module")
def outcomes(ctx: Context) -> dict[str, Outcome]:
    return {id: load()[id](ctx) for id in IDS}


def test_every_result_is_a_scenario() -> None:
    assert [f"khalil-{name}" for name in ("recovery", "peaking", "region", "extended")] == IDS


@pytest.mark.parametrize("id", IDS)
def test_rows_are_within_tolerance(outcomes: dict[str, Outcome], id: str) -> None:
    rows = outcomes[id].rows
    missed = [(r.quantity, r.ours, r.expected, r.tolerance) for r in rows if not r.ok]
    assert rows
    assert not missed
    quantities = [r.quantity for r in rows]
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
    for ax in figure.axes:
        lines = ax.get_lines()
        assert lines
        assert ax.get_title("left")
        assert ax.get_xlabel()
        assert max(len(np.atleast_1d(line.get_xdata())) for line in lines) <= 5_000
        assert all(np.isfinite(np.asarray(line.get_ydata(), dtype=float)).all() for line in lines)


class Wrong:
    """The compiled core with an observer whose last coefficient is 5 % too large."""

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx

    def simulate(self, spec: dict[str, Any]) -> dict[str, Any]:
        k = np.array(spec["observer"]["k"])
        k[-1] *= 1.05
        return self.ctx.simulate(spec | {"observer": spec["observer"] | {"k": k}})


@pytest.mark.parametrize("id", IDS)
def test_a_wrong_core_misses(ctx: Context, outcomes: dict[str, Outcome], id: str) -> None:
    rows = load()[id](Context("rust", ctx.seed, module=Wrong(ctx))).rows
    assert any(not r.ok for r in rows)


# --- the expected numbers, by routes of their own -----------------------------------------------


@pytest.mark.parametrize("kind", ["E", "H"])
def test_suprema_of_a_solver_of_high_order(kind: str) -> None:
    epsilon = 0.02

    def loop(t: float, s: list[float]) -> list[float]:
        x1, x2, z1, z2, sigma = s
        e = x1 - z1
        v = -z1 - 2 * z2
        if kind == "E":
            u = np.clip((-sigma + 8 * np.sin(z1) + v) / 10, -1, 1)
            gains, known, w = (3, 3, 1), -8 * np.sin(z1) + 10 * u + sigma, 1
        else:
            u = np.clip((10 * np.sin(z1) + z2 + v) / 12, -1, 1)
            gains, known, w = (2, 1, 0), -10 * np.sin(z1) - z2 + 12 * u, 0
        k1, k2, k3 = (k / epsilon**i for i, k in enumerate(gains, start=1))
        x2_dot = -10 * np.sin(x1) - x2 + 12 * u + w
        return [x2, x2_dot, z2 + k1 * e, known + k2 * e, k3 * e]

    t = np.arange(4001) * 2e-3
    options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "t_eval": t}
    x1, x2, *_ = solve_ivp(loop, (0, 8), [1, 0, 0, 0, 0], **options).y
    s1, s2 = khalil.target(t)
    found = np.abs(x1 - s1).max(), np.abs(x2 - s2).max()
    np.testing.assert_allclose(khalil.SUPREMA[kind][epsilon], found, atol=1e-6)


def test_peaks_are_those_of_the_fast_system() -> None:
    rho = khalil.A / khalil.A_HAT
    # (x1, eps x2, x1_hat, eps x2_hat, eps^2 sigma_hat) over t/eps; a bounded input moves nothing
    gains = np.array([3.0, 3.0, 1.0])
    bounded, free = np.zeros((5, 5)), np.zeros((5, 5))
    for matrix in (bounded, free):
        matrix[2:, 0], matrix[2:, 2] = gains, -gains
        matrix[2, 3] = 1.0
    bounded[3, 4] = 1.0
    free[0, 1], free[1, 4] = 1.0, -rho  # a_hat u takes sigma_hat away

    def path(matrix: np.ndarray) -> np.ndarray:
        step, states = expm(0.01 * matrix), [np.array([1.0, 0, 0, 0, 0])]
        for _ in range(4000):
            states.append(step @ states[-1])
        return np.abs(np.array(states) - [1.0, 0, 0, 0, 0]).max(axis=0)

    held, loose = path(bounded), path(free)
    np.testing.assert_allclose(held[3:], list(khalil.PEAKS.values()), rtol=1e-4)
    expected = [khalil.UNBOUNDED[name] for name in ("gap1", "x2", "u")]
    np.testing.assert_allclose([loose[0], loose[1], loose[4] / 10], expected, rtol=1e-4)


def cube(t: float, s: list[float], epsilon: float, bound: float) -> list[float]:
    """The cubic plant in the loop."""
    x1, x2, z1, z2 = s
    u = min(bound, max(-bound, -(z2**3) - z1 - z2))
    e = x1 - z1
    return [x2, x2**3 + u, z2 + 2 / epsilon * e, e / epsilon**2]


def lost(t: float, s: list[float], *_: float) -> float:
    """Zero where |x2| = 1.5: no input within its bound brings x2 back from there."""
    return 1.5 - abs(s[1])


lost.terminal = True  # type: ignore[attr-defined]


@pytest.mark.parametrize("epsilon", khalil.ESCAPES)
@pytest.mark.filterwarnings("ignore")
def test_escape_is_where_a_stiff_solver_stops(epsilon: float) -> None:
    start = [0.1, 0, 0, 0]
    end = solve_ivp(cube, (0, 1), start, method="Radau", rtol=1e-10, args=(epsilon, np.inf))
    assert end.status == -1
    assert end.t[-1] == pytest.approx(khalil.ESCAPES[epsilon], abs=1e-6)


def test_starts_by_another_solver(ctx: Context) -> None:
    epsilon = 0.1
    found = khalil.region(ctx, epsilon)
    rng = np.random.default_rng(1)
    # half of the starts are beside the edge
    edge = np.argwhere(found[1:, :] != found[:-1, :])
    places = [*rng.integers(0, khalil.SIDE, (10, 2)), *edge[rng.choice(len(edge), 10)]]
    for i, j in places:
        start: list[float] = [*khalil.STARTS[i, j], 0.0, 0.0]
        options: dict[str, Any] = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "events": lost}
        end = solve_ivp(cube, (0, khalil.REGION_T_END), start, args=(epsilon, 1.0), **options)
        assert found[i, j] == (np.hypot(*end.y[:2, -1]) <= khalil.REGION_BOUND), start


def test_state_feedback_holds_what_the_limit_cycle_encloses(ctx: Context) -> None:
    turn = khalil.limit_cycle(ctx)
    starts = khalil.STARTS.reshape(-1, 2)
    (x, y), (x_next, y_next) = turn.T, np.roll(turn, -1, axis=0).T
    inside = np.zeros(len(starts), dtype=bool)
    # rays to the right: an odd number of crossings
    for x1, y1, x2, y2 in zip(x, y, x_next, y_next, strict=True):
        cut = (y1 > starts[:, 1]) != (y2 > starts[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = x1 + (starts[:, 1] - y1) * (x2 - x1) / (y2 - y1)
        inside ^= cut & (starts[:, 0] < at)
    assert inside.sum() == khalil.CONVERGE_STATE


def test_stability_limits() -> None:
    # Routh: s^3 + 3 s^2 + 3 s + r has a pair on the axis at r = 9, +- i sqrt(3)
    np.testing.assert_allclose(np.roots([1, 3, 3, 9]).real.max(), 0.0, atol=1e-12)
    epsilon = 1e-5
    assert khalil.stability_limit(epsilon, 5.0, 9.5) == pytest.approx(khalil.UPPER, rel=1e-3)
    lowest = khalil.stability_limit(epsilon, 0.5 * epsilon, 6.0 * epsilon)
    assert lowest / epsilon == pytest.approx(khalil.LOWER, rel=1e-3)
    x, y = np.arange(5.0), np.array([-2.0, -1.0, 1.0, 2.0, 3.0])
    assert khalil.zero(x, y) == 1.5
    assert np.isnan(khalil.zero(x, np.abs(y)))


# --- the compiled core and the NumPy reference ------------------------------------------------


class Both:
    """Runs the first steps of every spec on both backends; the largest difference is kept."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.difference = 0.0

    def simulate(self, spec: dict[str, Any]) -> dict[str, Any]:
        steps = min(self.steps, spec["steps"])
        windows = [[0, steps] for _ in spec["windows"]]
        spec = spec | {"steps": steps, "every": 1, "windows": windows}
        rust, numpy = _core.simulate(spec), reference.simulate(spec)
        for key in ("x", "memory", "y"):
            good = np.isfinite(numpy[key])
            assert np.array_equal(good, np.isfinite(rust[key]))
            apart = np.abs(rust[key] - numpy[key])[good] / (1.0 + np.abs(numpy[key][good]))
            self.difference = max(self.difference, float(apart.max()))
        return rust


def test_backends_agree() -> None:
    both = Both(60)
    ctx = Context(module=both)
    for kind in ("E", "H"):
        for clip in (True, False):
            khalil.swing(ctx, kind, 0.05, 0.5, clip=clip)
    khalil.cubic(ctx, 0.02, clip=True)
    khalil.region(ctx, 0.2)
    khalil.fast_growth(ctx, 0.01)
    khalil.slow_growth(ctx, 0.01)
    assert both.difference < 1e-11
