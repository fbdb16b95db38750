"""Unknowns of a model: their estimate in a unit of its own, against chains written out in NumPy."""

from __future__ import annotations

import csv
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hgo_rs as hgo
from hgo_rs import reference
from hgo_rs.errors import HgoError

J = 0.02
UNITS = {"q": "rad", "w": "rad/s", "T_load": "N m", "i": "A"}
LOAD = {"T_load": "N m"}
LACK = {"model_error": 0.05}  # N m/sqrt(s)
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine", "zoh")
KINDS = ("standard", "low-power", "peaking-free", "filtered")


def drive(**changes: Any) -> hgo.Model:
    """J w' = kt i - b w - T_load."""
    given: dict[str, Any] = {
        "states": ["q", "w"],
        "inputs": ["i"],
        "parameters": {"J": J, "b": 0.01, "kt": 0.5},
        "phi": "(kt*i - b*w - T_load)/J",
        "unknown": "T_load",
        "units": UNITS,
    }
    return hgo.Model(**{**given, **changes})


def arm() -> hgo.Model:
    """An unknown that enters nonlinearly, with a slope that moves with the states."""
    return hgo.Model(
        states=["q", "w"],
        inputs=["u"],
        phi="u*cos(t) - sin(q) - 0.3*w - (2 + cos(q))*(d + d**3/10)",
        unknown="d",
    )


def one_state() -> hgo.Model:
    side = "u*cos(t) - sin(q) - d - d**3"
    return hgo.Model(states=["q"], inputs=["u"], phi=side, unknown="d")


def record(samples: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, samples))
    y, u = np.sin(3.0 * t) + 0.01 * rng.standard_normal(samples), np.cos(7.0 * t)
    y[100:120] = np.nan
    return t, y, u


def observer(kind: str, model: hgo.Model, **options: Any) -> hgo.HighGainObserver:
    more = {"saturation": [3.0, 1.5, 2.0][: model.n - 1]} if kind == "peaking-free" else {}
    return hgo.HighGainObserver(kind, model.n, 20.0, model=model, **more, **options)


# --- numbers ------------------------------------------------------------------------------------


def test_a_load_in_newton_metres_is_the_linear_eso_over_its_slope() -> None:
    """F18: LESO of bandwidth 20 rad/s, T = 1 ms, y = sin t, before sample 2000."""
    model = hgo.Model(states=["q", "w"], parameters={"J": J}, phi="-T_load/J", unknown="T_load")
    law = hgo.StandardObserver(
        3, 20.0, poles=[-1.0] * 3, model=model, method="euler", timing="predictor"
    )
    result = law.run(1e-3, np.sin(1e-3 * np.arange(2001)))
    leso = np.array([0.909262910231, -0.418792057642, -0.957444791873])
    assert np.allclose(result.x_hat[2000], leso * [1.0, 1.0, -J], rtol=2e-11, atol=0.0)
    assert result.of("T_load")[2000] == result.x_hat[2000, 2]


def test_an_extended_observer_in_the_loop_has_the_numbers_of_its_chain() -> None:
    """F4, sampled: a pendulum under feedback linearisation, the disturbance in units of 1/5."""
    model = hgo.Model(states=["x1", "x2"], inputs=["u"], phi="-8*sin(x1) + 10*u + 5*d", unknown="d")
    law = hgo.StandardObserver(
        3, epsilon=0.02, poles=[-1.0] * 3, model=model, method="euler", timing="predictor"
    )

    def pendulum(x: np.ndarray, u: float) -> np.ndarray:
        return np.array([x[1], -10.0 * math.sin(x[0]) - x[1] + 12.0 * u + 1.0])

    x, dt, u, seen = np.array([1.0, 0.0]), 1e-3, 0.0, {}
    for k in range(3001):
        x_hat = law.x_hat.copy()
        if k in (100, 3000):
            seen[k] = (x, x_hat, u)
        v = -x_hat[0] - 2.0 * x_hat[1]
        u = min(1.0, max(-1.0, (-5.0 * x_hat[2] + 8.0 * math.sin(x_hat[0]) + v) / 10.0))
        law.step(x[0], u, dt=dt)
        k1 = pendulum(x, u)
        k2 = pendulum(x + 0.5 * dt * k1, u)
        k3 = pendulum(x + 0.5 * dt * k2, u)
        x = x + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + pendulum(x + dt * k3, u))
    first = [0.924234214712, -3.912646300086, -124.388548929321]
    last = [0.240831152182, -0.175043249766, 0.920598709971]
    for k, expected in ((100, first), (3000, last)):
        assert np.allclose(seen[k][1] * [1.0, 1.0, 5.0], expected, rtol=1e-9, atol=1e-11)
    assert np.allclose(seen[100][0], (0.949288832190, -0.437117306682), rtol=1e-9)


def hand_rate(t: float, z: np.ndarray, y: float, u: float) -> np.ndarray:
    """The standard law for `arm`, k = (4.5, 6.5, 3), gain 20."""
    q, w, d = z
    e = 0.0 if math.isnan(y) else y - q
    slope = -(2.0 + math.cos(q)) * (1.0 + 0.3 * d * d)
    phi = u * math.cos(t) - math.sin(q) - 0.3 * w - (2.0 + math.cos(q)) * (d + d**3 / 10.0)
    return np.array([w + 90.0 * e, phi + 2600.0 * e, 24000.0 * e / slope])


@pytest.mark.parametrize("method", ["euler", "rk4"])
def test_the_law_is_the_chain_written_out(method: str) -> None:
    t, y, u = record()
    result = observer("standard", arm(), method=method, timing="predictor").run(t, y, u)
    z, rows = np.zeros(3), []
    for k, dt in enumerate([*np.diff(t), 0.0]):
        rows.append(z)
        at = (y[k], u[k])
        k1 = hand_rate(t[k], z, *at)
        if method == "euler":
            z = z + dt * k1
            continue
        k2 = hand_rate(t[k] + dt / 2, z + dt / 2 * k1, *at)
        k3 = hand_rate(t[k] + dt / 2, z + dt / 2 * k2, *at)
        z = z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + hand_rate(t[k] + dt, z + dt * k3, *at))
    assert np.allclose(result.x_hat, rows, rtol=1e-9, atol=1e-12)
    assert np.ptp(result.x_hat[:, 2]) > 1.0


def test_the_placed_law_corrects_by_the_gains_of_the_chain_over_the_slope() -> None:
    """zoh, current: the gains are those of the differentiator's first correction."""
    t, y, u = record()
    y = np.where(np.isnan(y), 0.0, y)
    free = hgo.StandardObserver(3, 20.0)
    free.reset([0.0, 0.0, 0.0])
    law = observer("standard", arm(), motion="held")
    result = law.run(t, y, u)
    z = result.x_hat[0]
    for k, dt in enumerate(np.diff(t)):
        phi = hand_rate(t[k], z, math.nan, u[k])[1]
        q, w, d = z
        before = np.array([q + dt * w + dt * dt / 2 * phi, w + dt * phi, d])
        gains = free.run([0.0, dt], [0.0, 1.0], memory0=[0.0, 0.0, 0.0, 0.0]).x_hat[1]
        slope = -(2.0 + math.cos(before[0])) * (1.0 + 0.3 * d * d)
        z = before + gains * (y[k + 1] - before[0]) / [1.0, 1.0, slope]
        assert np.allclose(result.x_hat[k + 1], z, rtol=1e-9, atol=1e-11)
        z = result.x_hat[k + 1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_error_goes_as_fast_as_the_gain(kind: str) -> None:
    """A constant unknown that enters nonlinearly is found, by the exact solution of its plant."""
    truth = 0.7
    side = "-sin(q) - 0.3*w - (2 + cos(q))*(d + d**3/10)"
    model = hgo.Model(states=["q", "w"], phi=side, unknown="d")

    def plant(_: float, x: np.ndarray) -> list[float]:
        q, w = x
        return [w, -math.sin(q) - 0.3 * w - (2 + math.cos(q)) * (truth + truth**3 / 10)]

    t = np.arange(0.0, 2.0, 1e-3)
    exact = solve_ivp(plant, (0.0, 2.0), [0.3, 0.0], t_eval=t, rtol=1e-11, atol=1e-12).y
    law = hgo.HighGainObserver(
        kind,
        3,
        30.0,
        model=model,
        method="rk4",
        **({"saturation": [20.0, 5.0]} if kind == "peaking-free" else {}),
    )
    result = law.run(t, exact[0])
    assert np.abs(result.x_hat[-1, :2] - exact[:, -1]).max() < 5e-3
    assert abs(result.of("d")[-1] - truth) < 5e-3
    assert np.abs(result.of("d")[:200] - truth).max() > 0.1


# --- engines ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_the_twin_has_the_same_numbers(kind: str, timing: str) -> None:
    t, y, u = record()
    models = [drive(), arm()]
    if kind in ("standard", "filtered"):
        f = ["0.1*u - q", "sin(w) - (2 + cos(q))*d"]
        models.append(hgo.Model(states=["q", "w"], inputs=["u"], f=f, unknown="d"))
    models.append(hgo.Model(states=["q"], inputs=["u"], phi="u - sin(q) - d - d**3", unknown="d"))
    count = 0
    for model, method in itertools.product(models, METHODS):
        if kind == "filtered" and method == "zoh":
            continue
        law = observer(kind, model, method=method, timing=timing)
        ours = law.run(t, y, u).memory
        theirs = reference.Observer(law.spec).run(t, y, u, law.initial_memory())["memory"]
        assert np.allclose(ours, theirs, rtol=1e-10, atol=1e-10), (model, method)
        count += 1
    assert count >= 15


@pytest.mark.parametrize("made", [hgo.RepelledCollection, hgo.ModifiedObserver])
def test_copies_that_repel_each_other_have_the_unknown_too(made: Any) -> None:
    t, y, u = record(300)
    model = hgo.Model(states=["q"], inputs=["u"], phi="u - q - (2 + cos(q))*d", unknown="d")
    gain = hgo.AdaptiveGain(10.0, 2.5e-3, 0.183)
    for timing in ("predictor", "current"):
        law = made(gain, k=[3.0, 2.0], k_bar=[0.4, 0.3], model=model, timing=timing)
        start = law.initial_memory() + 1e-2 * np.arange(len(law.memory))
        ours = law.run(t, y, u, memory0=start).memory
        theirs = reference.Observer(law.spec).run(t, y, u, start)["memory"]
        assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-9)
        assert np.ptp(ours[:, 1]) > 0.05


def joints() -> hgo.Model:
    """Two joints that are coupled; the torque on the first is unknown."""
    return hgo.Model(
        states=["q1", "w1", "q2", "w2"],
        inputs=["u"],
        orders=[2, 2],
        phi=["u - w2 - (3 + cos(q2))*T1", "-q2 - w2 + sin(q1)"],
        unknown=["T1", None],
        units={"T1": "N m"},
    )


@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_an_unknown_of_one_of_several_chains(timing: str) -> None:
    model = joints()
    assert model.states == ("q1", "w1", "T1", "q2", "w2")
    assert model.orders == (3, 2)
    options: dict[str, Any] = {"method": "rk4", "timing": timing}
    if timing == "current":
        options["method"] = "zoh"
    laws = [hgo.StandardObserver(3, 20.0, **options), hgo.LowPowerObserver(2, 25.0, **options)]
    law = hgo.MultiOutputObserver(laws, model=model)
    t, y, u = record()
    both = np.stack([y, np.cos(2.0 * t)], axis=1)
    result = law.run(t, both, u)
    theirs = reference.Observer(law.spec).run(t, both, u, law.initial_memory())["memory"]
    assert np.allclose(result.memory, theirs, rtol=1e-9, atol=1e-10)
    assert np.array_equal(result.of("T1"), result.x_hat[:, 2])
    assert list(result.columns())[1:6] == ["q1", "w1", "T1", "q2", "w2"]


def test_step_and_run_have_the_same_bits() -> None:
    t, y, u = record()
    side = "u - sin(q) - (2 + cos(q))*(d + d**3)"
    model = hgo.Model(states=["q", "w"], inputs=["u"], phi=side, unknown="d")
    law = observer("low-power", model)
    result = law.run(t, y, u)
    law.correct(y[0])
    rows = [law.x_hat.copy()]
    for k, dt in enumerate(np.diff(t)):
        law.predict(u[k], dt)
        law.correct(y[k + 1])
        rows.append(law.x_hat.copy())
    assert np.array_equal(result.x_hat, rows)


def test_a_study_and_a_single_run_have_the_same_bits() -> None:
    """The plant is the model itself, its load a state that stands still."""
    model = drive().with_inputs(i="0.2*sin(4*t)")
    law = observer("standard", model)
    given: dict[str, Any] = {
        "dt": 1e-3,
        "steps": 300,
        "rng": 3,
        "noise": hgo.NormalNoise(0.0, 1e-4),
    }
    x0 = [0.1, 0.0, 0.3]
    one = hgo.simulate(model.plant(), law, x0=x0, every=1, **given)
    many = hgo.simulate(model.plant(), law, x0=x0, every=1, runs=40, **given)
    assert np.array_equal(one.x_hat[0], many.x_hat[0])
    assert np.all(np.abs(many.x_hat[:, -1, 2] - 0.3) < 0.2)


def test_a_study_of_a_plant_without_that_state_names_the_estimate() -> None:
    plant = hgo.Plant(states=["q", "w"], drift=["w", "-w - (0.3 + 0.2*sin(t))/0.02"], output="q")
    model = hgo.Model(states=["q", "w"], phi="-w - T_load/0.02", unknown="T_load", units=LOAD)
    law = hgo.StandardObserver(3, 40.0, model=model)
    given: dict[str, Any] = {"dt": 1e-3, "steps": 2000, "every": 100, "metrics": ["peak", "rms"]}
    result = hgo.simulate(plant, law, x0=[0.0, 0.0], **given)
    found = result.of("T_load")
    assert np.array_equal(found["frames"], result.of("T_load_hat")["frames"])
    truth = 0.3 + 0.2 * np.sin(result.time)
    assert np.abs(found["frames"][0] - truth)[5:].max() < 0.02
    assert found["final"][0] == found["frames"][0, -1]
    assert result.plot().axes[2].get_title(loc="left") == "T_load (N m)"
    study = hgo.study(
        lambda gain: {
            "plant": plant,
            "observer": hgo.StandardObserver(3, gain, model=model),
            "x0": [0.0, 0.0],
            **given,
        },
        grid={"gain": [20.0, 40.0]},
    )
    assert study.table["peak_T_load_hat"][1] == result.peak[0, 2]


# --- names and units ----------------------------------------------------------------------------


def test_name_and_unit_in_results_frames_files_and_figures(tmp_path: Path) -> None:
    t, y, u = record()
    law = observer("standard", drive())
    result = law.run(t, y, u)
    assert np.array_equal(result.of("T_load"), result.x_hat[:, 2])
    assert np.array_equal(result.of("q"), result.x_hat[:, 0])
    with pytest.raises(HgoError, match=r"of = 'load': must be one of \['q', 'w'"):
        result.of("load")
    frame = result.to_dataframe()
    assert np.array_equal(frame["T_load"], result.x_hat[:, 2])
    assert frame.attrs["units"] == {"q": "rad", "w": "rad/s", "T_load": "N m"}
    assert result.to_xarray()["T_load"].attrs["units"] == "N m"
    titles = [ax.get_title(loc="left") for ax in result.plot().axes]
    assert titles[:3] == ["q (rad)", "w (rad/s)", "T_load (N m)"]
    for name in ("out.csv", "out.parquet"):
        hgo.logs.write_table(tmp_path / name, result.columns(units=True))
    with (tmp_path / "out.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][1:4] == ["q [rad]", "w [rad/s]", "T_load [N m]"]
    assert float(rows[-1][3]) == result.x_hat[-1, 2]


def test_a_file_and_the_command_line_carry_the_unknown(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from hgo_rs.cli.command import command

    t, y, u = record()
    law = observer(
        "standard", drive(phi="(kt*i - b*w - (2 + cos(q))*T_load)/J", box={"q": (-3, 3)})
    )
    law.save(tmp_path / "observer.toml", time="t", output="angle", input="current")
    again = hgo.load(tmp_path / "observer.toml").observer()
    assert again.model == law.model and again.spec == law.spec
    text = (tmp_path / "observer.toml").read_text()
    assert 'unknown = "T_load"' in text and 'T_load = "N m"' in text
    columns = {"t": t, "angle": y, "current": u}
    hgo.logs.write_table(tmp_path / "log.csv", columns)
    words = ["estimate", "log.csv", "--config", "observer.toml", "--out", "out.csv"]
    words = [str(tmp_path / w) if "." in w else w for w in words]
    told = CliRunner().invoke(command, words)
    assert told.exit_code == 0, told.output
    with (tmp_path / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert np.array_equal(
        [float(row["T_load [N m]"]) for row in rows],
        law.run(t, y, u, x_hat0=[y[0], 0.0, 0.0]).of("T_load"),
    )


def test_a_model_is_made_again_from_its_arguments() -> None:
    for model in (drive(), arm(), joints(), drive(box={"q": (-1.0, 1.0)})):
        again = hgo.Model(**model.as_arguments())
        assert again == model and again.states == model.states
    assert drive() != drive(box={"q": (-1.0, 1.0)})
    assert drive().with_inputs(i="sin(t)").inputs == ()


def test_exported_c_names_the_unknown_and_its_unit(tmp_path: Path) -> None:
    law = observer("standard", drive())
    hgo.export(law, to="c", out=tmp_path, name="drive")
    header = (tmp_path / "drive.h").read_text()
    assert "double T_load; /* estimate of T_load, N m */" in header
    assert "T_load: unknown, the last state of its chain" in header


# --- figures of a design ------------------------------------------------------------------------


def test_noise_gain_and_peaking_are_in_the_unit_of_the_unknown() -> None:
    """Against the spread of many runs on white noise."""
    law, free = observer("standard", drive()), hgo.StandardObserver(3, 20.0)
    assert np.allclose(law.noise_gain(1e-3), free.noise_gain(1e-3) * [1.0, 1.0, J * J])
    assert np.allclose(law.peaking(1e-3), free.peaking(1e-3) * [1.0, 1.0, J])
    plain = hgo.Model(states=["q", "w"], phi="-T/J", parameters={"J": J}, unknown="T")
    law = observer("standard", plain)
    noise = np.random.default_rng(1).standard_normal(200_000)
    load = law.run(1e-3, noise).of("T")[2000:]
    assert np.std(load) == pytest.approx(math.sqrt(law.noise_gain(1e-3)[2]), rel=0.05)


def test_a_gain_is_chosen_in_the_unit_of_the_unknown() -> None:
    """On paper that of the chain whose last state is the unknown times the slope."""
    tuned = hgo.tune(lambda ell: hgo.StandardObserver(3, ell, model=drive()), 1e-4, 1e-3, **LACK)
    lack = {"model_error": LACK["model_error"] / J}
    chain = hgo.tune(lambda ell: hgo.StandardObserver(3, ell), 1e-4, 1e-3, **lack)
    assert tuned.ell == pytest.approx(chain.ell, rel=1e-6)
    for name in ("noise", "model", "error", "peaking"):
        assert tuned.point[name] == pytest.approx(chain.point[name] * J, rel=1e-6)


def test_a_gain_is_chosen_on_a_record_of_an_unknown() -> None:
    """A load that wanders at 0.05 N m/sqrt(s), an encoder: as good as the best gain there is."""
    inertia, count, dt, samples = 2e-3, 2.0 * math.pi / 20_000, 1e-3, 3000
    t = dt * np.arange(samples)
    load = 0.05 * math.sqrt(dt) * np.cumsum(np.random.default_rng(1).standard_normal(samples))
    current = 0.8 * np.sin(4.4 * t) + 0.4 * np.sin(14.0 * t) + load / 0.12
    angle, q, w = np.zeros(samples), 0.0, 0.0
    for k in range(samples):
        angle[k] = count * round(q / count)
        for _ in range(10):
            w += dt / 10 * (0.12 * current[k] - 1e-3 * w - load[k]) / inertia
            q += dt / 10 * w
    model = drive(parameters={"J": inertia, "b": 1e-3, "kt": 0.12})

    def error(ell: float) -> float:
        law = hgo.StandardObserver(3, ell, model=model)
        return float(np.std((law.run(t, angle, current).of("T_load") - load)[300:]))

    tuned = hgo.tune(
        lambda ell: hgo.StandardObserver(3, ell, model=model), (t, angle, current), state=3
    )
    assert error(tuned.ell) < 1.05 * min(error(ell) for ell in np.geomspace(40.0, 600.0, 13))
    assert tuned.noise == pytest.approx(count / math.sqrt(12.0), rel=0.1)
    assert tuned.model_error == pytest.approx(0.05, rel=0.2)  # N m/sqrt(s)


def test_backwards_in_time_an_unknown_stays_what_it_is() -> None:
    """z = (q, -w, d) and tau = 1 - t: dz/dtau = (z2, phi, 0), of one state (z1, -phi, 0)."""
    from hgo_rs.expressions.numeric import evaluate
    from hgo_rs.tuning.reversal import reversed_model

    for model, flip in ((arm(), (1.0, -1.0, 1.0)), (one_state(), (1.0, 1.0))):
        back = reversed_model(model, model.n, 1.0)
        assert isinstance(back, hgo.Model) and back.unknown == ("d",)
        x = np.array([0.3, -0.4, 0.2])[-model.n :]
        z = x * flip
        known = {"t": 0.3, "u": 0.7}
        ahead = evaluate(list(model.drift), {**known, **dict(zip(model.states, x, strict=True))})
        known["t"] = 0.7
        turned = evaluate(list(back.drift), {**known, **dict(zip(model.states, z, strict=True))})
        assert np.allclose(turned, -np.array(flip) * np.array(ahead), rtol=1e-13)


# --- refusals -----------------------------------------------------------------------------------

REFUSED = {
    "a slope that vanishes": (
        {"phi": "w*T_load", "inputs": [], "parameters": None, "units": None},
        r"the slope of phi in T_load, w, lies in \[-inf, inf\] for all states: must not be 0.*box=",
    ),
    "a slope that vanishes on the box": (
        {"phi": "w*T_load + i", "parameters": None, "box": {"w": (-1.0, 2.0)}},
        r"lies in \[-1, 2\] on the box \{'w': \(-1\.0, 2\.0\)\}: must not be 0",
    ),
    "a slope of an input": (
        {"phi": "-i*T_load", "parameters": None},
        r"the slope of phi in T_load, -i, depends on i: must depend on states and parameters only",
    ),
    "a slope of time": (
        {"phi": "i + (2 + sin(t))*T_load", "parameters": None},
        r"depends on t: .*take the whole term with T_load as the unknown",
    ),
    "an unknown that does not enter": (
        {"phi": "kt*i - b*w - J"},
        r"unknown = 'T_load': must be a name in phi = ",
    ),
    "two unknowns of one output": (
        {"unknown": ["T_load", "b2"]},
        r"unknown = \['T_load', 'b2'\]: must be 1 name",
    ),
    "a name of a column": ({"unknown": "y"}, r"unknown = 'y': must be no column"),
    "a state's name": ({"unknown": "w"}, r"states = 'w': .*already among"),
    "a unit of nothing": ({"units": {"T_lod": "N m"}}, r"units: .*did you mean T_load"),
    "a unit that is no text": ({"units": {"q": 3}}, r"units\['q'\] = 3: must be a text"),
    "a unit that ends a comment": ({"units": {"q": "*/"}}, r"units\['q'\]"),
    "a box of nothing": ({"box": {"v": (0, 1)}}, r"box: 'v' is not known|box: .*v"),
    "a box without an unknown": (
        {"unknown": None, "phi": "kt*i - b*w/J", "units": None, "box": {"q": (0, 1)}},
        r"box = .*: must be left out without unknown=",
    ),
    "a callable that is not compiled": (
        {"phi": lambda t, x, u: float(x[0] > 0) - x[2]},
        r"Model is not compiled",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal_names_what_and_why(case: str) -> None:
    changes, message = REFUSED[case]
    with pytest.raises(HgoError, match=message):
        drive(**changes)


def test_remedies_work() -> None:
    assert drive(phi="w*T_load + i", parameters=None, box={"w": (0.5, 2.0)}).unknown == ("T_load",)
    low, high = arm().unknown_slope()["d"]
    assert low == -math.inf and -1.0 - 1e-9 < high <= -1.0 + 1e-9
    low, high = arm().unknown_slope({"q": (-1.0, 1.0), "d": (-1.0, 1.0)})["d"]
    assert low <= -3.9 <= high and high <= -(2.0 + math.cos(1.0)) + 1e-9
    with pytest.raises(HgoError, match=r"the slope of phi in T_load.*must not be 0"):
        drive(phi="c*T_load + i", parameters={"c": 1.0}).with_parameters(c=0.0)


def test_an_unknown_of_another_chain_or_form_is_refused() -> None:
    with pytest.raises(
        HgoError, match=r"phi\[1\] = .* depends on T1: the unknown of phi\[0\] must"
    ):
        hgo.Model(states=["a", "b"], orders=[1, 1], phi=["T1", "T1 + b"], unknown=["T1", None])
    with pytest.raises(HgoError, match=r"unknown = \['d'\].*left out in this form"):
        hgo.Model(states=["x", "z"], f1=["0"], g=[["1"]], f2=["d"], unknown="d")
    with pytest.raises(HgoError, match=r"f\[0\]: .*depends on d"):
        hgo.Model(states=["q", "w"], f=["d", "d"], unknown="d")


def test_outside_the_box_a_correction_takes_the_slope_of_its_edge() -> None:
    model = hgo.Model(states=["q", "w"], phi="w*d", unknown="d", box={"w": (0.5, 2.0)})
    law = hgo.StandardObserver(3, 5.0, model=model, method="euler", timing="predictor")
    k = np.array(law.spec["k"]) * 5.0 ** np.arange(1, 4)
    for w, slope in ((-3.0, 0.5), (1.0, 1.0), (9.0, 2.0)):
        moved = law.run(1e-3, [1.0, 1.0], x_hat0=[0.0, w, 0.3]).x_hat
        assert moved[1, 2] == pytest.approx(0.3 + 1e-3 * k[2] / slope, rel=1e-12)
        assert moved[1, 1] == pytest.approx(w + 1e-3 * (w * 0.3 + k[1]), rel=1e-12)
