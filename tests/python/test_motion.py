"""How the model moves between placed corrections: held, by RK4, implicitly."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hgo_rs as hgo
from hgo_rs import _core, reference
from hgo_rs.errors import HgoError
from hgo_rs.observers import MotionWarning, Observer

ELL = 12.0
U = 0.7
T0 = 0.3


def phi(t: float, x: Any, u: float) -> Any:
    """Of all states, the input and the time."""
    return u - 3.0 * np.sin(x[0]) - 0.8 * x[-1] + 0.5 * np.cos(3.0 * t) * x[1]


def phase(n: int) -> hgo.Model:
    names = [f"x{i}" for i in range(n)]
    text = f"u - 3*sin(x0) - 0.8*x{n - 1} + 0.5*cos(3*t)*x1"
    return hgo.Model(states=names, inputs=["u"], phi=text)


TRIANGULAR = hgo.Model(
    states=["a", "b"], inputs=["u"], f=["-0.4*a*cos(t)", "u - 2*sin(a) - 0.6*b*abs(b)"]
)
TWO = hgo.Model(
    states=["q1", "w1", "q2", "w2"],
    orders=[2, 2],
    inputs=["u"],
    phi=["u - 2*sin(q1) + 1.5*(q2 - q1) - 0.3*w1*w2", "1.5*(q1 - q2) - 0.4*w2*cos(2*t) + 0.5*w1"],
)


def chained(t: float, z: Any) -> list[float]:
    """x_hat of two chains of order 2."""
    q1, w1, q2, w2 = z
    first = U - 2 * np.sin(q1) + 1.5 * (q2 - q1) - 0.3 * w1 * w2
    return [w1, first, w2, 1.5 * (q1 - q2) - 0.4 * w2 * np.cos(2 * t) + 0.5 * w1]


LOADED = hgo.Model(
    states=["q", "v"],
    inputs=["u"],
    unknown="load",
    phi="u - 3*sin(q) - 0.8*v*cos(t) - (2 + cos(q))*load",
)


def loaded(t: float, z: Any, load: float) -> float:
    """The rate of v."""
    friction = 0.8 * z[1] * np.cos(t)
    return float(U - 3 * np.sin(z[0]) - friction - (2 + np.cos(z[0])) * load)


def several(make: Callable[..., Observer], **manner: Any) -> Observer:
    return hgo.MultiOutputObserver([make(2, ELL, **manner) for _ in range(2)], model=TWO)


Case = tuple[Callable[..., Observer], Callable[[float, Any], Any], list[float]]
"""An observer under a motion; the rate of its memory between samples; a memory."""

CASES: dict[str, Case] = {
    "standard, n = 2": (
        lambda **manner: hgo.StandardObserver(2, ELL, model=phase(2), **manner),
        lambda t, z: [z[1], phi(t, z, U)],
        [0.5, -1.2],
    ),
    "standard, n = 4": (
        lambda **manner: hgo.StandardObserver(4, ELL, model=phase(4), **manner),
        lambda t, z: [z[1], z[2], z[3], phi(t, z, U)],
        [0.5, -1.2, 0.8, 2.0],
    ),
    "triangular": (
        lambda **manner: hgo.StandardObserver(2, ELL, model=TRIANGULAR, **manner),
        lambda t, z: [
            z[1] - 0.4 * z[0] * np.cos(t),
            U - 2 * np.sin(z[0]) - 0.6 * z[1] * abs(z[1]),
        ],
        [0.5, -1.2],
    ),
    "low-power, n = 3": (
        lambda **manner: hgo.LowPowerObserver(3, ELL, model=phase(3), **manner),
        lambda t, z: [z[3], z[4], phi(t, z[:3], U), z[4], phi(t, z[:3], U)],
        [0.5, -1.2, 0.8, -1.1, 0.9],
    ),
    "an unknown": (
        lambda **manner: hgo.StandardObserver(3, ELL, model=LOADED, **manner),
        lambda t, z: [z[1], loaded(t, z, z[2]), 0.0],
        [0.5, -1.2, 0.3],
    ),
    "an unknown, low-power": (
        lambda **manner: hgo.LowPowerObserver(3, ELL, model=LOADED, **manner),
        lambda t, z: [z[3], loaded(t, z, z[4]), 0.0, loaded(t, z, z[4]), 0.0],
        [0.5, -1.2, 0.3, -1.1, 0.2],
    ),
    "two chains": (
        lambda **manner: several(hgo.StandardObserver, **manner),
        chained,
        [0.5, -1.2, 0.1, 0.8],
    ),
}


def after(observer: Observer, start: list[float], dt: float) -> Any:
    """The law's memory a time dt after T0, without a sample."""
    core = _core.Observer(observer.spec)
    memory = core.initial()
    memory[: len(start)] = start
    nothing = np.full(core.n_y, np.nan)
    return core.advance(memory, nothing, np.array([U]), T0, dt)[0][: len(start)]


def exact(rate: Callable[[float, Any], Any], start: list[float], dt: float) -> Any:
    solved = solve_ivp(rate, (T0, T0 + dt), start, method="DOP853", rtol=1e-13, atol=1e-14)
    return solved.y[:, -1]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("motion", "order"), [("held", 1), ("rk4", 4), ("implicit", 4)])
def test_the_order_of_a_motion(case: str, motion: str, order: int) -> None:
    """The error of one period falls as its length to the order + 1."""
    make, rate, start = CASES[case]
    observer = make(motion=motion, **({} if motion == "held" else {"substeps": 1}))
    errors = []
    for dt in (0.1, 0.05, 0.025):
        errors.append(np.abs(after(observer, start, dt) - exact(rate, start, dt)).max())
    found = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(found > order + 0.7), (errors, found)
    assert np.all(found < order + 1.6), (errors, found)


@pytest.mark.parametrize("motion", ["rk4", "implicit"])
def test_substeps_cut_a_period(motion: str) -> None:
    """m substeps of a period are m periods of one substep each."""
    for case, (make, _, start) in CASES.items():
        whole = after(make(motion=motion, substeps=3), start, 0.12)
        one, z, core = make(motion=motion, substeps=1), np.array(start), None
        core = _core.Observer(one.spec)
        memory = core.initial()
        memory[: len(start)] = z
        nothing = np.full(core.n_y, np.nan)
        for i in range(3):
            memory = core.advance(memory, nothing, np.array([U]), T0 + i * 0.04, 0.04)[0]
        assert np.allclose(whole, memory[: len(start)], rtol=1e-14, atol=1e-14), case


@pytest.mark.parametrize("motion", ["rk4", "implicit"])
@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_what_does_not_move_is_held(motion: str, n: int) -> None:
    """Terms of inputs alone, however high the order and the gain: the placed eigenvalues stay."""
    dt = 0.02
    t = np.arange(200) * dt
    y, u = np.sin(t) + 1e-3 * np.cos(90 * t), np.cos(3 * t)
    makers = [hgo.StandardObserver] + ([hgo.LowPowerObserver] if n > 1 else [])
    for make in makers:
        made = [
            make(n, 40.0, model=hgo.InputGain(0.7), motion=name, method="zoh").run(t, y, u).x_hat
            for name in ("held", motion)
        ]
        assert np.abs(made[0] - made[1]).max() <= 1e-12 * np.abs(made[0]).max()


def test_chains_move_together() -> None:
    """Held, a chain takes the others as they stood; moved, as they are: their error falls apart."""
    make, rate, start = CASES["two chains"]
    held, moved = make(motion="held"), make(motion="rk4")
    wanted = exact(rate, start, 0.05)
    errors = [np.abs(after(of, start, 0.05) - wanted).max() for of in (held, moved)]
    assert errors[1] < 1e-4 * errors[0]


def switching(model: hgo.Model, orders: list[int], **manner: Any) -> Observer:
    """Chains of gains that switch at samples, each by its own output."""
    gains = [hgo.SwitchedGain(20.0, 5.0, 0.05 * (i + 1), 0.043) for i in range(2)]
    parts = [hgo.StandardObserver(n, gains[n % 2], **manner) for n in orders]
    return hgo.MultiOutputObserver(parts, model=model)


def jumping(n_y: int) -> tuple[Any, Any]:
    """Uneven times; samples that jump, each at a time of its own, with gaps."""
    t = np.cumsum(np.where(np.arange(150) % 9 == 4, 0.03, 0.01))
    y = np.stack([np.sin(2.0 * t) + (t > 0.5 + 0.3 * i) for i in range(n_y)], axis=1)
    y[30:34] = y[60, -1] = y[90:93, 0] = np.nan
    return t, y


@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize("motion", ["held", "rk4"])
def test_chains_switch_as_each_alone_does(motion: str, timing: str) -> None:
    manner: dict[str, Any] = {"motion": motion, "timing": timing, "method": "zoh"}
    names = ["a", "b", "c", "d", "e"]
    model = hgo.Model(states=names, orders=[3, 2], phi=["-sin(a) - c", "-d*e"])
    both = switching(model, [3, 2], **manner)
    t, y = jumping(2)
    joint = both.run(t, y).memory
    rows = [[0, 1, 2, 5], [3, 4, 6 + (timing == "current")]]
    for i, (states, phi) in enumerate([(names[:3], "-sin(a) - c"), (names[3:], "-d*e")]):
        own = hgo.Model(states=states, phi=phi)
        gain = hgo.SwitchedGain(20.0, 5.0, 0.05 * (2 - i), 0.043)
        alone = hgo.StandardObserver(len(states), gain, model=own, **manner)
        memory = alone.run(t, y[:, i]).memory
        assert np.array_equal(joint[:, rows[i]], memory[:, : len(rows[i])])
        quiet = memory[:, len(states)]
        assert quiet.min() == 0.0 and quiet.max() > 0.1  # it has switched
    twin = reference.Observer(both.spec).run(t, y, None, both.initial_memory())["memory"]
    assert np.allclose(joint, twin, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_the_order_of_chains_does_not_matter(timing: str) -> None:
    """Also where a correction is in the unit of an unknown whose slope is of another chain."""
    manner: dict[str, Any] = {"motion": "rk4", "timing": timing, "method": "zoh"}
    first, second = ["a", "b"], ["c", "d"]
    side, other = "-sin(a) + c - (2 + cos(c))*p", "-c - 0.3*d*b + a"
    one = hgo.Model(states=first + second, orders=[2, 2], phi=[side, other], unknown=["p", None])
    two = hgo.Model(states=second + first, orders=[2, 2], phi=[other, side], unknown=[None, "p"])
    t, y = jumping(2)
    given = switching(one, [3, 2], **manner).run(t, y)
    turned = switching(two, [2, 3], **manner).run(t, y[:, ::-1])
    assert np.array_equal(given.x_hat, turned.x_hat[:, [2, 3, 4, 0, 1]])


# --- stiff terms --------------------------------------------------------------------------------

DT, FC = 1e-3, 20.0


def axis(term: str) -> hgo.Model:
    return hgo.Model(states=["q", "v"], inputs=["u"], parameters={"Fc": FC}, phi=f"u - Fc*{term}")


@pytest.mark.parametrize("motion", ["implicit", None])
@pytest.mark.parametrize("term", ["sign(v)", "tanh(v/1e-3)", "tanh(v/1e-5)", "tanh(v/2e-2)"])
@pytest.mark.parametrize("substeps", [1, 2])
def test_dry_friction_stands_still(term: str, motion: str | None, substeps: int) -> None:
    """Issue: an axis with Coulomb friction, at rest after 2 s; its estimate rests too."""
    t = np.arange(4000) * DT
    moving = t < 2
    q = np.where(moving, 0.025 * (1 - np.cos(np.pi * t)), 0.0)
    v = np.where(moving, 0.025 * np.pi * np.sin(np.pi * t), 0.0)
    a = np.where(moving, 0.025 * np.pi**2 * np.cos(np.pi * t), 0.0)
    u = a + FC * np.sign(np.where(np.abs(v) < 1e-12, 0.0, v))
    y = 1e-6 * np.round(q / 1e-6)
    observer = hgo.StandardObserver(
        2, 60.0, model=axis(term), method="zoh", timing="current", motion=motion, substeps=substeps
    )
    assert observer.spec["motion"] == "implicit"
    error = observer.run(DT, y, u).x_hat[:, 1] - v
    bound = FC * DT / substeps / 2**7  # of a search in one step
    assert np.abs(error[2600:]).max() < 2.0 * bound
    if term != "tanh(v/2e-2)":  # another law of friction than the axis has
        assert np.sqrt(np.mean(error[300:1900] ** 2)) < 2e-3


def test_steps_that_are_not_stiff_are_those_of_rk4() -> None:
    """A slope of 0.9/h is followed by RK4, of 1.2/h implicitly: x+ = x/(1 + 1.2)."""
    for slope, stiff in ((0.9, False), (1.2, True), (1e6, True)):
        model = hgo.Model(states=["x"], phi=f"-{slope / 0.1}*x")
        ends = {
            motion: after_alone(
                hgo.StandardObserver(1, 1.0, model=model, motion=motion, substeps=1)
            )
            for motion in ("rk4", "implicit")
        }
        if stiff:
            assert ends["implicit"] == pytest.approx(1.0 / (1.0 + slope), rel=1e-9)
        else:
            assert ends["implicit"] == ends["rk4"]


def after_alone(observer: Observer) -> float:
    core = _core.Observer(observer.spec)
    memory = core.initial()
    memory[0] = 1.0
    return float(core.advance(memory, np.array([np.nan]), np.empty(0), 0.0, 0.1)[0][0])


# --- left open ----------------------------------------------------------------------------------


def test_the_motion_that_is_left_open() -> None:
    """By what is known of the model."""

    def of(model: Any, gain: float = 60.0, **more: Any) -> tuple[Any, Any]:
        spec = hgo.StandardObserver(2, gain, model=model, method="zoh", **more).spec
        return spec["motion"], spec.get("substeps")

    def own(text: str, **parameters: float) -> hgo.Model:
        return hgo.Model(states=["q", "v"], inputs=["u"], parameters=parameters, phi=text)

    assert of(None) == of(hgo.InputGain(2.0)) == of(own("3*u + cos(u)")) == ("held", None)
    for smooth in ("u - 9.81*sin(q) - 0.2*v", "u + sin(3*t)", "-v*abs(v)", "-0.5*v**3", "-sign(q)"):
        assert of(own(smooth)) == ("rk4", 2)
    friction = own("u - Fc*tanh(v/v0)", Fc=20.0, v0=0.1)
    assert friction.own_slope == pytest.approx(200.0, rel=1e-6)
    assert of(friction) == ("implicit", 2)
    assert of(friction, gain=300.0) == ("rk4", 2)
    assert of(friction.with_parameters(v0=1.0)) == ("rk4", 2)
    assert of(own("u - sign(v)")) == of(own("u - atan2(v, q)")) == ("implicit", 2)
    with pytest.warns(
        MotionWarning, match="motion = 'rk4': an equation of the model may jump"
    ) as caught:
        assert of(own("u - sign(v)"), motion="rk4", substeps=5) == ("rk4", 5)
    assert all(one.filename == __file__ for one in caught)
    assert own("u - sign(v)").own_slope == np.inf
    assert own("-v*abs(v)").own_slope == pytest.approx(2.0, rel=1e-6)  # where |v| <= 1
    friction = hgo.Model(states=["q", "v"], unknown="d", phi="-20*tanh(v/0.1) - v - 3*d")
    assert friction.own_slope == pytest.approx(201.0, rel=1e-6)
    # a model of the papers moves as the same equations do
    states, crackle = ["x1", "x2", "x3", "x4", "x5"], "0.2*(x1*x1 - 1) - x2 - x3 - 4*x4 - x5"
    pairs: tuple[tuple[Any, dict[str, Any]], ...] = (
        (hgo.Lee(), {"phi": "-x1/(1 + x1*x1) - x2"}),
        (hgo.SanfelicePraly(-3.0), {"f": ["-3*x1", "0"]}),
        (hgo.VanDerPol(4.0), {"phi": "-x1 + 4*(1 - x1*x1)*x2"}),
        (hgo.Crackle(), {"phi": f"saturate({crackle}, -3, 3)"}),
    )
    for built_in, equations in pairs:
        order = built_in.order
        same = hgo.Model(states=states[:order], **equations)
        assert built_in.own_slope == pytest.approx(same.own_slope, rel=1e-6)
        for gain in (0.5, 2.0, 5.0):
            motions = {
                hgo.StandardObserver(order, gain, model=model, method="zoh").spec["motion"]
                for model in (built_in, same)
            }
            assert len(motions) == 1
    drive = hgo.Model(states=["q", "v"], inputs=["u"], unknown="d", phi="3*u - d")
    assert not drive.moves
    assert hgo.Ship().own_slope is None
    assert of(hgo.VanDerPol()) == ("rk4", 2)

    rates = hgo.StandardObserver(2, 60.0, model=own("-sin(q)"), method="rk4").spec
    assert "motion" not in rates


def test_a_motion_that_chatters_is_warned_of() -> None:
    """Asked for at friction that jumps, and by no default; its estimate at rest does chatter."""
    t = np.arange(2000) * DT
    y, u = np.full(2000, 0.01), np.full(2000, 0.5 * FC)  # held by friction

    def moving(term: str, motion: str | None) -> float:
        observer = hgo.StandardObserver(2, 60.0, model=axis(term), motion=motion)
        return float(np.ptp(observer.run(t, y, u).x_hat[1000:, 1]))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        still = moving("sign(v)", None)
        for term, motion in (("sign(v)", "implicit"), ("tanh(v/0.05)", "rk4"), ("sign(q)", "held")):
            moving(term, motion)
    for motion in ("held", "rk4"):
        with pytest.warns(MotionWarning, match=f"motion = '{motion}'.*implicit"):
            assert moving("sign(v)", motion) > 10.0 * still
    phi = ["-sign(b)", "-d"]
    pair = hgo.Model(states=["a", "b", "c", "d"], orders=[2, 2], phi=phi)
    parts = [hgo.StandardObserver(2, ELL, motion="held") for _ in phi]
    with pytest.warns(MotionWarning, match="motion = 'held'"):
        hgo.MultiOutputObserver(parts, model=pair)


def test_chains_have_one_motion() -> None:
    def of(**manner: Any) -> list[Any]:
        parts = [hgo.StandardObserver(2, ELL, **manner), hgo.LowPowerObserver(2, ELL)]
        spec = hgo.MultiOutputObserver(parts, model=TWO).spec
        return [(part.get("motion"), part.get("substeps")) for part in spec["observers"]]

    assert of() == [("rk4", 2)] * 2
    assert of(motion="held") == [("held", None)] * 2
    assert of(motion="implicit", substeps=4) == [("implicit", 4)] * 2
    parts = [hgo.StandardObserver(2, ELL, motion=motion) for motion in ("held", "rk4")]
    with pytest.raises(HgoError, match="the same motion and substeps"):
        hgo.MultiOutputObserver(parts, model=TWO)


@pytest.mark.parametrize(
    ("manner", "told"),
    [
        ({"motion": "rk5"}, "motion"),
        ({"motion": "rk4", "substeps": 0}, "substeps.*1"),
        ({"motion": "rk4", "substeps": 17}, "substeps.*16"),
        ({"motion": "held", "substeps": 2}, "substeps.*left out"),
        ({"motion": "rk4", "method": "euler"}, "motion.*left out"),
        ({"substeps": 3, "method": "rk4"}, "substeps.*left out"),
    ],
)
def test_refusals(manner: dict[str, Any], told: str) -> None:
    with pytest.raises(HgoError, match=told):
        hgo.StandardObserver(2, ELL, model=phase(2), **manner)


@pytest.mark.parametrize(
    ("manner", "told"),
    [
        ({"motion": "rk5"}, "motion"),
        ({"motion": "rk4", "substeps": 0}, "substeps.*1 to 16"),
        ({"motion": "rk4", "substeps": 300}, "substeps.*1 to 16"),
        ({"motion": "held", "substeps": 2}, "substeps.*leave it out"),
        ({"motion": "rk4", "method": "euler"}, "motion.*leave it out"),
        ({"substeps": 3, "method": "rk4"}, "substeps.*leave it out"),
    ],
)
def test_specs_are_refused_as_well(manner: dict[str, Any], told: str) -> None:
    spec = {**hgo.StandardObserver(2, ELL, model=phase(2)).spec, **manner}
    if manner.get("motion") is None or manner.get("method") == "rk4":
        spec.pop("motion")
    if "substeps" not in manner:
        spec.pop("substeps")
    for make in (_core.Observer, reference.Observer):
        with pytest.raises(ValueError, match=told if make is _core.Observer else "motion|substeps"):
            make(spec)


# --- one law, however it is run -----------------------------------------------------------------


AGREE = [
    *itertools.product(CASES, ["held", "rk4", "implicit"]),
    ("friction", "implicit"),  # explicit motions of it are chaotic
    ("friction, low-power chains", "implicit"),
]


@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize(("case", "motion"), AGREE)
def test_core_and_twin_agree(case: str, motion: str, timing: str) -> None:
    """Over an uneven record with missing samples, for every motion and timing."""
    manner: dict[str, Any] = {"motion": motion, "timing": timing, "method": "zoh"}
    if case in CASES:
        observer = CASES[case][0](**manner)
    elif case == "friction":
        observer = hgo.StandardObserver(2, 20.0, model=axis("tanh(v/1e-3)"), **manner)
    else:
        model = hgo.Model(
            states=["a", "v", "b", "w"],
            orders=[2, 2],
            inputs=["u"],
            phi=["u - 5*sign(v) + b - a", "a - b - 3*tanh(w/1e-2)"],
        )
        parts = [hgo.LowPowerObserver(2, 15.0, **manner) for _ in range(2)]
        observer = hgo.MultiOutputObserver(parts, model=model)
    rng = np.random.default_rng(3)
    t = np.cumsum(np.where(np.arange(200) % 9 == 4, 0.021, 0.01))
    y = 0.4 * np.sin(2.0 * t)[:, None] * np.linspace(1.0, 0.6, observer.n_y)
    y += rng.normal(0.0, 1e-3, y.shape)
    y[rng.random(y.shape) < 0.1] = np.nan
    u = np.cos(3.0 * t)
    ours = observer.run(t, y, u)
    start = observer.initial_memory()
    theirs = reference.Observer(observer.spec).run(t, y, u[:, None], start)["memory"]
    tolerance = 1e-9 if "friction" in case else 1e-11  # a search for a jump decides on last bits
    width = ours.memory.shape[1]
    assert np.allclose(ours.memory, theirs[:, :width], rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("motion", ["rk4", "implicit"])
@pytest.mark.parametrize("case", CASES)
def test_a_record_is_its_samples(case: str, motion: str) -> None:
    """run, step, and correct with predict have the same bits."""
    make = CASES[case][0]
    t = np.arange(60) * 0.01
    on_line, halves = make(motion=motion, timing="current"), make(motion=motion, timing="current")
    y = 0.4 * np.sin(2.0 * t)[:, None] * np.linspace(1.0, 0.6, on_line.n_y)
    y[17] = np.nan
    u = np.cos(3.0 * t)
    whole = make(motion=motion, timing="current").run(t, y, u).x_hat
    assert np.array_equal(whole, make(motion=motion, timing="current").run(t, y, u).x_hat)
    for k in range(60):
        shown = halves.correct(y[k])
        assert np.array_equal(shown, whole[k])
        if k + 1 < 60:
            halves.predict(np.array([u[k]]), dt=float(t[k + 1] - t[k]))


@pytest.mark.parametrize(
    ("law", "motion"),
    list(itertools.product(["standard", "low-power"], ["held", "rk4", "implicit"])),
)
def test_files_keep_a_motion(law: str, motion: str, tmp_path: Any) -> None:
    """And what a file leaves open is chosen by its model."""
    make = hgo.StandardObserver if law == "standard" else hgo.LowPowerObserver
    observer = make(2, 30.0, model=axis("tanh(v/1e-3)"), motion=motion)
    path = tmp_path / "observer.toml"
    observer.save(path)
    assert f'motion = "{motion}"' in path.read_text()
    again = hgo.config.load(path).observer()
    assert again.spec == observer.spec

    kept = [line for line in path.read_text().splitlines() if "motion" not in line]
    path.write_text("\n".join(line for line in kept if "substeps" not in line))
    assert hgo.config.load(path).observer().spec["motion"] == "implicit"


def test_a_change_of_method_drops_the_motion() -> None:
    """An option of the command line over a file that says a motion."""
    observer = hgo.StandardObserver(2, 30.0, model=phase(2), motion="rk4", substeps=3)
    config = hgo.config.Config.of(observer)
    assert "motion" not in config.replace(method="euler").observer().spec
    held = config.replace(motion="held").observer().spec
    assert (held["motion"], "substeps" in held) == ("held", False)


# --- the input over a period --------------------------------------------------------------------


def test_inputs_averaged_over_a_period() -> None:
    """As the means given by hand, to the bit; a sampled input that moves on is followed better."""
    dt = 0.02
    t = np.arange(500) * dt
    exact = solve_ivp(
        lambda t, x: [x[1], 5 * np.cos(4 * t) - 3 * np.sin(x[0]) - 0.8 * x[1]],
        (0.0, t[-1]),
        [0.4, 0.0],
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
        t_eval=t,
    ).y
    y, u = exact[0], 5 * np.cos(4 * t)
    model = hgo.Model(states=["q", "v"], inputs=["u"], phi="u - 3*sin(q) - 0.8*v")
    observer = hgo.StandardObserver(2, 4.0, model=model)
    held = observer.run(t, y, u, x_hat0=exact[:, 0])
    mean = observer.run(t, y, u, x_hat0=exact[:, 0], input_hold="mean", until=t[-1] + dt)
    by_hand = np.append(0.5 * (u[:-1] + u[1:]), u[-1])
    told = observer.run(t, y, by_hand, x_hat0=exact[:, 0], until=t[-1] + dt)
    assert np.array_equal(mean.memory, told.memory)
    assert np.array_equal(mean.next_memory, told.next_memory)
    errors = [np.std(run.x_hat[:, 1] - exact[1]) for run in (held, mean)]
    assert errors[1] < 0.05 * errors[0]

    predictor = observer.with_timing("predictor")
    with pytest.raises(HgoError, match="input_hold"):
        predictor.run(t, y, u, input_hold="mean")
    with pytest.raises(HgoError, match="input_hold"):
        observer.run(t, y, u, input_hold="next")
    u[7] = np.nan
    with pytest.raises(HgoError, match="u at sample 7"):
        observer.run(t, y, u, input_hold="mean")
