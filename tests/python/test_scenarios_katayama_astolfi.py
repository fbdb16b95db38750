"""The scenarios of Katayama and of Astolfi et al., and the laws they use on both backends."""

import numpy as np
import pytest

from hgo_rs import _core as core
from hgo_rs import reference
from hgo_rs.scenarios import astolfi, base, katayama

IDS = [
    id for id, known in base.REGISTRY.items() if known.paper in ("katayama", "astolfi")
]  # the two imports above registered them


@pytest.fixture(scope="module")
def outcomes(ctx):
    """Scenarios by id on the compiled core, each run once."""
    done = {}

    def get(id):
        if id not in done:
            done[id] = base.REGISTRY[id](ctx)
        return done[id]

    return get


def test_every_id_is_there():
    wanted = [f"katayama-fig{i}" for i in range(1, 5)] + ["katayama-limits"]
    wanted += [f"astolfi-table{i}" for i in range(1, 5)]
    wanted += ["astolfi-fig3", "astolfi-design", "astolfi-limits"]
    assert sorted(wanted) == sorted(IDS)


@pytest.mark.parametrize("id", IDS)
def test_rows_within_tolerance(outcomes, id):
    outcome = outcomes(id)
    missed = [(r.quantity, r.ours, r.expected, r.tolerance) for r in outcome.rows if not r.ok]
    assert outcome.rows
    assert not missed


@pytest.mark.parametrize("id", IDS)
def test_figure_draws_named_axes(outcomes, id):
    figure_module = pytest.importorskip("matplotlib.figure")
    figure = figure_module.Figure()
    outcomes(id).figure(figure)
    axes = figure.get_axes()
    assert axes
    for ax in axes:
        assert ax.has_data()
        assert ax.get_ylabel() or ax.get_shared_y_axes().joined(ax, axes[0])
    bars = "table3" in id or "table4" in id or id == "astolfi-limits"
    assert axes[-1].get_xlabel() or bars


@pytest.mark.parametrize("id", ["astolfi-table1", "astolfi-table4", "katayama-fig3"])
def test_every_tabled_figure_is_a_row(outcomes, id):
    expected = [r.expected for r in outcomes(id).rows]
    if id == "katayama-fig3":
        wanted = [v for (T, _), pair in katayama.RMS.items() if T == 0.01 for p in pair for v in p]
    elif id == "astolfi-table1":
        wanted = [float(v) for _, ours in astolfi.TABLE_1.values() for v in ours]
    else:
        wanted = [float(v) for _, ours, _ in astolfi.TABLE_4.values() for v in ours]
    assert set(wanted) <= set(expected)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
@pytest.mark.parametrize("id", ["astolfi-table3", "astolfi-table4"])
def test_noise_tables_hold_for_other_seeds(id, seed):
    assert base.REGISTRY[id](base.Context("rust", seed=seed)).ok


# --- the two backends -----------------------------------------------------------------------------


def assert_alike(spec, relative=1e-12):
    """Both backends agree to ``relative`` of each signal's largest magnitude."""
    ours, twin = core.simulate(spec), reference.simulate(spec)
    np.testing.assert_array_equal(ours["diverged_at"], twin["diverged_at"])
    assert np.all(ours["diverged_at"] < 0)
    for key in ("x", "memory", "y"):
        a, b = ours[key], twin[key]
        assert a.shape == b.shape
        scale = np.nanmax(np.abs(b), axis=(0, 1))
        far = np.abs(a - b) > relative * scale
        assert not np.any(far), (key, np.nanmax(np.abs(a - b) / np.where(scale > 0, scale, 1.0)))
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
    for key in ("peak", "rms", "max"):
        np.testing.assert_allclose(ours[key], twin[key], rtol=1e-11, atol=1e-12)


STEPS = 10_000  # the crackle system's 10 s at 1 ms
LAWS = {
    "standard": astolfi.observer("standard", 4.17),
    "low-power": astolfi.observer("low-power", 7.0),
    "peaking-free, hard": astolfi.observer("peaking-free", 7.0),
    "peaking-free, smooth": astolfi.observer("peaking-free", 7.0, clip="smooth"),
}
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")


def crackle_spec(law, method, **more):
    memory_len = astolfi.memory_len(LAWS[law]["kind"])
    start = np.zeros((2, memory_len))
    start[:, :5] = [[1.0] * 5, [3.0, -3.0, 3.0, -3.0, 3.0]]
    return {
        "plant": {"kind": "crackle"},
        "observer": LAWS[law] | {"method": method},
        "steps": STEPS,
        "schedule": {"kind": "fixed", "dt": 1e-3},
        "x0": list(astolfi.X0),
        "memory0": start,
        "runs": 2,
        "seed": 3,
        "noise": {"kind": "normal", "mean": 0.0, "std": 1e-3},
        "windows": [[0, STEPS + 1], [STEPS // 2, STEPS]],
        "every": 50,
        **more,
    }


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", LAWS)
def test_backends_agree_on_samples(law, method):
    assert_alike(crackle_spec(law, method, plant_method="rk4"))


@pytest.mark.parametrize("law", LAWS)
def test_backends_agree_on_the_joint_ode(law):
    sines = [[0.298, 100.0, 0.0]]
    noise = {"kind": "uniform", "low": -1e-3, "high": 1e-3, "hold": 10, "sines": sines}
    assert_alike(crackle_spec(law, "bogacki-shampine", mode="joint", noise=noise))


def missing_samples():
    """Small errors of the position, with gaps of one to five samples."""
    values = 1e-4 * np.sin(np.arange(STEPS + 1))
    for gap in (700, 2500, 4100, 9000):
        values[gap : gap + 1 + gap % 5] = np.nan
    return values


@pytest.mark.parametrize("gaps", [False, True], ids=["all samples", "missing samples"])
@pytest.mark.parametrize("delta", [0.0, 0.5])
def test_backends_agree_on_the_reduced_order_law(delta, gaps):
    spec = katayama.spec(0.01, 0.1, delta, katayama.W, t_end=100.0, every=50, windows=((0, 100),))
    if gaps:
        spec["noise"] = {"kind": "samples", "values": missing_samples()}
    assert spec["steps"] == STEPS
    assert_alike(spec)


@pytest.mark.parametrize("column", ["a", "c"])
def test_backends_draw_the_same_coloured_noise(column):
    ours, twin = (
        astolfi.coloured(base.Context(backend, seed=5), column, 2) for backend in base.BACKENDS
    )
    assert ours.shape == (2, 100_001)
    np.testing.assert_allclose(ours, twin, rtol=0.0, atol=1e-12)
    late = slice(round(astolfi.T_LATE["peaking-free"] / astolfi.NOISE_STEP), None)
    np.testing.assert_allclose(np.abs(ours[:, late]).max(axis=1), astolfi.SUP[column])


def test_backends_agree_on_the_tables_scheme():
    """Table 1's scheme, both to 1e-6 as two programs of the same scheme must."""
    spec = astolfi.joint(LAWS["peaking-free, hard"], astolfi.vertices(9)[::16], 1e-3, 6.0)
    spec["settle"] = 0.01
    ours, twin = core.simulate(spec), reference.simulate(spec)
    np.testing.assert_allclose(ours["peak"], twin["peak"], rtol=1e-6)
    np.testing.assert_array_equal(ours["settling_time"], twin["settling_time"])
