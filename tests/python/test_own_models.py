"""Models and plants of the user's own: specs, the papers' systems again, what follows, errors."""

import json
import math
import pickle

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import HgoError, Model, Plant, System
from hgo_rs.expressions import ExpressionError
from hgo_rs.reference import observers as twin
from hgo_rs.reference.simulate import simulate as twin_simulate

LEE = "-x1/(1 + x1*x1) - x2"
EMPS = {"M": 95.1, "gtau": 35.15, "Fv": 203.5, "Fc": 20.39, "offset": -3.16}


def lee(**more):
    return Model(states=["x1", "x2"], phi=LEE, **more)


def emps(**more):
    phi = "(gtau*u - Fv*v - Fc*tanh(v/0.001) - offset)/M"
    return Model(states=["q", "v"], inputs=["u"], phi=phi, parameters=EMPS, **more)


def ship():
    """Katayama's kinematics with a simpler f2."""
    return Model(
        states=["x", "y", "psi", "u", "v", "r"],
        inputs=["thrust", "rudder"],
        parameters={"m": 2.0},
        f1=[0, 0, 0],
        g=[["cos(psi)", "-sin(psi)", 0], ["sin(psi)", "cos(psi)", 0], [0, 0, 1]],
        f2=["thrust/m - u + v*r", "-v - u*r", "rudder - r"],
    )


def arm():
    """Two chains that act on each other."""
    return Model(
        states=["q1", "w1", "q2", "w2", "a2"],
        inputs=["u1", "u2"],
        phi=["u1 - sin(q1 + q2) - w1*w2", "u2 - sin(q2) + q1*a2"],
        orders=[2, 3],
    )


VDP = {
    "states": ["x1", "x2"],
    "parameters": {"eps": 0.8, "sigma": 0.5},
    "f": ["x2", "-x1 + eps*(1 - x1*x1)*x2"],
    "g": [0, "sigma"],
    "K_T": [
        "(5 + eps*(1 - y*y))*T*(y - x1)",
        "(5 - eps*(x1 + y)*x2 + (5 + eps*(1 - y*y))*(eps*(1 - y*y)))*T*(y - x1)",
    ],
}


# --- the spec -------------------------------------------------------------------------------------


def test_a_system_in_a_few_lines():
    model = hgo.Model(
        states=["q", "v"],
        inputs=["u"],
        phi="(gtau*u - Fv*v - Fc*sign(v) - offset)/M",
        parameters=EMPS,
    )
    assert model.spec == {
        "kind": "own",
        "form": "phase",
        "n": 2,
        "n_u": 1,
        "table": {
            "inputs": ["t", "x[0]", "x[1]", "u[0]", "M", "gtau", "Fv", "Fc", "offset"],
            "constants": [],
            "ops": [
                ["mul", 5, 3],
                ["mul", 6, 2],
                ["sub", 9, 10],
                ["sign", 2],
                ["mul", 7, 12],
                ["sub", 11, 13],
                ["sub", 14, 8],
                ["div", 15, 4],
            ],
            "outputs": [16],
            "output_names": ["phi"],
        },
        "parameters": list(EMPS.values()),
        "names": {"states": ["q", "v"], "inputs": ["u"], "parameters": list(EMPS)},
    }
    assert isinstance(model, System)
    assert (model.order, model.n_u, model.compiled, model.callables) == (2, 1, True, {})
    assert (model.states, model.inputs, model.parameters) == (("q", "v"), ("u",), EMPS)


@pytest.mark.parametrize(
    ("system", "inputs", "outputs"),
    [
        (lee(), "t x[0] x[1]", "phi"),
        (arm(), "t x[0] x[1] x[2] x[3] x[4] u[0] u[1]", "phi[0] phi[1]"),
        (
            Model(states=["a", "b"], inputs=["u"], f=["sin(a)", "a*b + u"]),
            "t x[0] x[1] u[0]",
            "f[0] f[1]",
        ),
        (
            Model(**VDP, inputs=["w"]),
            "t x[0] x[1] u[0] y T eps sigma",
            "f[0] f[1] K_T[0] K_T[1] h",
        ),
        (
            ship(),
            "t x[0] x[1] x[2] z[0] z[1] z[2] u[0] u[1] m",
            "f1[0] f1[1] f1[2] g[0] g[1] g[2] g[3] g[4] g[5] g[6] g[7] g[8] f2[0] f2[1] f2[2]",
        ),
        (Plant(states=["a"], drift=["-a"]), "t x[0]", "drift[0] output"),
        (
            Plant(states=["a", "b"], drift=["b", "-a"], diffusion=[0, 1], output="a + b"),
            "t x[0] x[1]",
            "drift[0] drift[1] diffusion[0] diffusion[1] output",
        ),
    ],
)
def test_specs_are_plain_data_in_the_agreed_order(system, inputs, outputs):
    spec = system.spec
    assert json.loads(json.dumps(spec)) == spec
    assert " ".join(spec["table"]["inputs"]) == inputs
    assert " ".join(spec["table"]["output_names"]) == outputs
    assert len(spec["table"]["outputs"]) == len(outputs.split())
    assert spec["n"] == {"strict-feedback": 3}.get(spec.get("form"), len(system.states))
    again = pickle.loads(pickle.dumps(system))
    assert again == system
    assert hash(again) == hash(system)
    plain = system.as_arguments()
    assert type(system)(**json.loads(json.dumps(plain))) == system


def test_parameters_change_without_a_new_table():
    model = emps()
    other = model.with_parameters(M=90.0, Fv=0)
    assert other.spec["table"] is model.spec["table"]
    assert other.spec["parameters"] == [90.0, 35.15, 0.0, 20.39, -3.16]
    assert model.parameters == EMPS
    assert other != model
    assert other.with_parameters(EMPS) == model
    assert isinstance(other, Model)
    with pytest.raises(HgoError, match=r"unknown parameter m.*did you mean M\?"):
        model.with_parameters(m=1.0)
    with pytest.raises(HgoError, match=r"parameters\['M'\] = nan: must be a?.*finite"):
        model.with_parameters(M=math.nan)


def test_strings_callables_and_sympy_give_one_table():
    def phi(t, x):
        return -x[0] / (1 + x[0] * x[0]) - x[1]

    by_call = lee()
    assert Model(states=["x1", "x2"], phi=lambda t, x, u: phi(t, x)) == by_call
    assert Model(states=["x1", "x2"], phi=by_call.equations["phi"][0]) == by_call

    def with_parameters(t, x, u, p):
        return (p["gtau"] * u[0] - p.Fv * x[1] - p.Fc * np.tanh(x[1] / 0.001) - p.offset) / p.M

    called = Model(states=["q", "v"], inputs=["u"], phi=with_parameters, parameters=EMPS)
    assert called == emps()
    whole = Model(states=["a", "b"], f=lambda t, x, u: [np.sin(x[0]), x[0] * x[1]])
    assert whole == Model(states=["a", "b"], f=["sin(a)", "a*b"])
    sympy = pytest.importorskip("sympy")
    a, b = sympy.symbols("a b")
    matrix = sympy.Matrix([sympy.sin(a), a * b])
    assert Model(states=["a", "b"], f=matrix) == whole
    assert Model(states=["a", "b"], f=[sympy.sin(a), "a*b"]) == whole


# --- the twin: the same numbers as the papers' systems --------------------------------------------


def observer(model, kind="standard", n=2, **more):
    if kind == "sampled-data":
        return twin.Observer({"kind": kind, "model": model, **more})
    k = [float(np.poly(-np.linspace(1, 2, n))[i + 1]) for i in range(n)]
    gain = {"law": "constant", "ell": 8.0}
    return twin.Observer({"kind": kind, "n": n, "k": k, "gain": gain, "model": model, **more})


def record(steps=200):
    rng = np.random.default_rng(5)
    y = np.sin(0.02 * np.arange(steps)) + 0.01 * rng.standard_normal(steps)
    y[17] = np.nan
    return 0.01 * np.arange(steps), y


CRACKLE = "saturate(0.2*(a*a - 1) - b - c - 4*d - e2, -3, 3)"
SAME = {
    "lee": (hgo.Lee(), lee(), "standard", {}),
    "lee by rk4": (hgo.Lee(), lee(), "standard", {"method": "rk4"}),
    "crackle": (
        hgo.Crackle(),
        Model(states=["a", "b", "c", "d", "e2"], phi=CRACKLE),
        "standard",
        {"n": 5},
    ),
    "sanfelice-praly": (
        hgo.SanfelicePraly(nu1=-0.4),
        Model(states=["x1", "x2"], f=["nu1*x1", 0], parameters={"nu1": -0.4}),
        "standard",
        {},
    ),
    "van-der-pol": (hgo.VanDerPol(), Model(**VDP), "sampled-data", {}),
}


@pytest.mark.parametrize("name", SAME)
def test_an_own_model_gives_the_bits_of_the_built_in_one(name):
    built_in, own, kind, more = SAME[name]
    t, y = record()
    runs = []
    for model in (built_in, own):
        law = observer(model.spec, kind, **more)
        runs.append(law.run(t, y, None, law.initial()))
    for key in ("memory", "innovation", "status"):
        # the built-in sampled-data law multiplies in another order
        close = 1e-12 if kind == "sampled-data" else 0.0
        np.testing.assert_allclose(runs[1][key], runs[0][key], rtol=close, atol=close)


def study(plant, law, **more):
    spec = {
        "plant": plant,
        "observer": law,
        "steps": 100,
        "schedule": {"kind": "fixed", "dt": 0.01},
        "x0": [1.0, 0.0],
        "memory0": [0.0, 0.0],
        "noise": {"kind": "uniform", "low": -0.01, "high": 0.01},
        "runs": 3,
        "windows": [[50, 100]],
    }
    return twin_simulate({**spec, **more})


@pytest.mark.parametrize("mode", ["sampled", "joint"])
def test_an_own_plant_moves_as_the_built_in_one(mode):
    plant = Plant(states=["x1", "x2"], drift=["x2", LEE])
    assert lee().plant() == plant
    want = study(hgo.Lee().spec, observer(hgo.Lee().spec).spec, mode=mode)
    have = study(plant.spec, observer(lee().spec).spec, mode=mode)
    for key in ("rms", "max", "final_x", "final_memory"):
        np.testing.assert_array_equal(have[key], want[key])


def test_an_own_plant_with_process_noise():
    own = Model(**VDP)
    plant = own.plant()
    assert plant.noisy
    assert plant.spec["noisy"] is True
    law = observer(hgo.VanDerPol().spec, "sampled-data").spec
    more = {"plant_method": "euler-maruyama", "substeps": 2}
    want = study(hgo.VanDerPol().spec, law, **more)
    have = study(plant.spec, law, **more)
    np.testing.assert_array_equal(have["final_x"], want["final_x"])
    with pytest.raises(ValueError, match="'euler-maruyama' for a plant of your own"):
        study(plant.spec, law, plant_method="milstein")
    with pytest.raises(ValueError, match="a stochastic scheme"):
        study(plant.spec, law, plant_method="rk4")


def test_time_reaches_models_and_plants():
    """x' = v, v' = cos(t): known exactly, so that an observer that starts right stays right."""
    model = Model(states=["x", "v"], phi="cos(t)")
    plant = model.plant()
    law = observer(model.spec, method="rk4").spec
    for mode in ("sampled", "joint"):
        more = {"x0": [-1.0, 0.0], "memory0": [-1.0, 0.0], "noise": None, "plant_method": "rk4"}
        found = study(plant.spec, law, mode=mode, **more)
        np.testing.assert_allclose(found["final_x"][0], [-np.cos(1.0), np.sin(1.0)], atol=1e-9)
        assert np.max(found["max"]) < (1e-9 if mode == "joint" else 1e-2)


def test_inputs_reach_the_model():
    own = Model(states=["x", "v"], inputs=["u"], phi="b0*u", parameters={"b0": 2.0})
    built_in = hgo.InputGain(2.0)
    t, y = record()
    u = np.cos(t)[:, None]
    runs = []
    for model in (built_in, own):
        law = observer(model.spec)
        assert law.n_u == 1
        runs.append(law.run(t, y, u, law.initial())["memory"])
    np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"table": None}, "Python callable"),
        ({"form": "wave"}, "form"),
        ({"n": 3}, "table inputs and outputs"),
        ({"parameters": [math.nan]}, "parameters"),
        ({"extra": 1}, "key"),
        ({"table": {"inputs": [], "constants": [], "ops": [["evil", 0]], "outputs": []}}, "evil"),
        ({"table": {"inputs": [], "constants": [], "ops": [["neg", 0]], "outputs": []}}, "below 0"),
        ({"table": {"inputs": [], "constants": [], "ops": [], "outputs": [3]}}, "below 0"),
    ],
)
def test_the_twin_refuses_a_table_that_is_wrong(change, says):
    with pytest.raises(ValueError, match=says):
        observer({**lee().spec, **change})
    with pytest.raises(ValueError, match="phase-variable or triangular"):
        observer(Model(**VDP).spec)


def test_chains_of_several_outputs():
    model = arm()
    assert model.spec["orders"] == [2, 3]
    assert (model.form, model.order) == ("chains", 5)
    assert [str(node) for node in model.outputs] == ["q1", "q2"]
    assert [str(node) for node in model.drift] == [
        "w1",
        "u1 - sin(q1 + q2) - w1*w2",
        "w2",
        "a2",
        "u2 - sin(q2) + q1*a2",
    ]
    assert model.relative_degree("u1") == 2
    assert model.relative_degree("u2") == 3
    assert "    y[1] = q2" in str(model)
    assert model.with_inputs(u1="t", u2=0).orders == (2, 3)
    for changes, says in (
        ({"orders": [2, 2]}, "add up to 5"),
        ({"orders": [2, 0]}, r"orders\[1\] = 0"),
        ({"orders": 5}, "a list of integers"),
        ({"orders": [5]}, "phi has 2 expressions: must have 1"),
        ({"phi": None, "f": [0] * 5}, "a model of f, orders: must be one of the forms"),
    ):
        with pytest.raises(HgoError, match=says):
            Model(**{**model.as_arguments(), **changes})


# --- other systems made of it ---------------------------------------------------------------------


def test_inputs_become_functions_of_time():
    model = emps().with_inputs(u="0.5*sin(2*t)*gtau")
    assert model.inputs == ()
    assert model.plant().drift == model.drift
    point = {"q": 0.1, "v": 0.2, "t": 0.3, **EMPS}
    want = hgo.expressions.evaluate(
        emps().equations["phi"], {**point, "u": 0.5 * math.sin(0.6) * EMPS["gtau"]}
    )
    np.testing.assert_array_equal(
        hgo.expressions.evaluate(model.equations["phi"], point)[0], want[0]
    )
    with pytest.raises(HgoError, match="unknown input w"):
        model.with_inputs(w=0)
    with pytest.raises(ExpressionError, match="unknown name q"):
        emps().with_inputs(u="q")
    assert emps().plant().inputs == ("u",)
    with pytest.raises(HgoError, match="outputs"):
        ship().with_inputs(thrust=0, rudder=1).plant()


# --- what follows from the equations --------------------------------------------------------------


def test_jacobians():
    jacobian = emps().jacobian()
    assert [[str(entry) for entry in row] for row in jacobian.rows] == [
        ["0", "(-Fv - Fc*(1000*(1 - tanh(v/0.001)**2)))/M"]
    ]
    value = jacobian(q=0.0, v=[0.0, 1.0])
    assert value.shape == (2, 1, 2)
    np.testing.assert_allclose(value[:, 0, 1], [-(203.5 + 20390) / 95.1, -203.5 / 95.1])
    assert jacobian.needs == ("v",)
    f = Model(states=["a", "b"], f=["sin(a)", "a*b**2"])
    np.testing.assert_allclose(f.jacobian()(a=0.3, b=2.0), [[math.cos(0.3), 0], [4.0, 1.2]])
    assert len(ship().jacobian().rows) == 3
    assert len(Plant(states=["a", "b"], drift=["b", "-a"]).jacobian().rows) == 2


BOUNDS = {
    "lee": (lee(), {"x1": (-9, 9), "x2": (-9, 9)}, math.sqrt(2.0)),
    "linear": (Model(states=["a", "b"], phi="3*a - 4*b"), {"a": (0, 1), "b": (0, 1)}, 5.0),
    "sine": (
        Model(states=["a", "b"], phi="k*sin(w*a)", parameters={"k": 2, "w": 3}),
        {"a": (0.4, 0.6), "b": (0, 1)},
        6.0 * math.cos(1.2),
    ),
    "kinks": (
        Model(states=["a", "b"], phi="abs(a) + saturate(2*b, -1, 1)"),
        {"a": (-1, 1), "b": (-1, 1)},
        math.sqrt(5.0),
    ),
    "continuous pieces": (
        Model(states=["a"], phi="piecewise(-1, a < -1, 1, a > 1, (3*a - a**3)/2)"),
        {"a": (-2, 2)},
        1.5,
    ),
    "inputs": (
        Model(states=["a"], inputs=["u"], phi="u*a + t"),
        {"a": (0, 1), "u": (-3, 2)},
        3.0,
    ),
    "constant": (Model(states=["a"], phi="1"), {"a": (0, 1)}, 0.0),
    "matrix": (
        Model(states=["a", "b"], f=["a", "a + b"]),
        {"a": (0, 1), "b": (0, 1)},
        np.linalg.norm([[1, 0], [1, 1]], 2),
    ),
    "van-der-pol": (
        Model(**VDP),
        {"x1": (-2, 2), "x2": (-3, 3)},
        np.linalg.norm([[0, 1], [-1 - 0.8 * 2 * 2 * 3, 0.8 * (1 - 4)]], 2),
    ),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_lipschitz_bounds_are_safe_and_tight(name):
    model, box, want = BOUNDS[name]
    bound = model.lipschitz(box)
    assert want <= bound * (1 + 1e-15)
    assert bound <= want * 1.0101 + 1e-300
    assert model.lipschitz(box, rtol=1e-3) <= want * 1.00101 + 1e-300


@pytest.mark.parametrize(
    ("phi", "box", "says"),
    [
        ("sign(a)", {"a": (-1, 1)}, "sign\\(a\\) may jump.*tanh"),
        ("piecewise(0, a < 0, 1)", {"a": (-1, 1)}, "may jump"),
        ("sqrt(a)", {"a": (0, 1)}, "has no bound"),
        ("1/a", {"a": (-1, 1)}, "has no bound"),
        ("u*a", {"a": (-1, 1)}, "bounds of u"),
        ("a*a", {}, "bounds of a"),
        ("a", {"a": (1, 0)}, "box\\['a'\\]\\[1\\] = 0"),
        ("a", {"a": 1}, "low, high"),
        ("a", {"a": (0, math.inf)}, "finite"),
        ("a", {"a": (0, 1), "k": (0, 1)}, "unknown name k"),
        ("atan2(u, a)", {"a": (-1, 1), "u": (-1, 1)}, "may jump"),
    ],
)
def test_where_no_lipschitz_bound_exists(phi, box, says):
    model = Model(states=["a"], inputs=["u"], parameters={"k": 1}, phi=phi)
    with pytest.raises(HgoError, match=says):
        model.lipschitz(box)


def test_a_jump_outside_the_box_or_of_the_input_alone_does_no_harm():
    model = Model(states=["a"], inputs=["u"], phi="a*sign(a) + 2*piecewise(a, u < t, -a)*sign(u)")
    assert model.lipschitz({"a": (0.1, 1), "u": (-1, 1), "t": (0, 1)}) == pytest.approx(3.0)


def test_relative_degrees():
    assert emps().relative_degree("u") == 2
    assert emps().relative_degree() == 2
    assert lee().relative_degree() is None
    model = Model(states=["a", "b", "c"], inputs=["u", "w"], f=[0, "w", "u*a"])
    assert [model.relative_degree(name) for name in ("u", "w")] == [3, 2]
    assert model.relative_degree() == 2
    assert ship().relative_degree("thrust") == 2
    deep = [f"x{i}" for i in range(12)]
    f = [f"cos({'*'.join(deep[: i + 1])})/(1 + {deep[i]}**2)" for i in range(11)]
    assert Model(states=deep, inputs=["u"], f=[*f, "u"]).relative_degree("u") == 12
    # two ways to the output that cancel
    sides = {"f": ["b + c", "u", "b - u"], "K_T": [0, 0, 0]}
    assert Model(states=["a", "b", "c"], inputs=["u"], **sides).relative_degree("u") == 3
    hidden = Model(states=["a", "b"], inputs=["u"], phi="u - u + a")
    assert hidden.relative_degree("u") is None
    with pytest.raises(HgoError, match="unknown input x"):
        emps().relative_degree("x")


def test_print_shows_it_all():
    shown = str(emps())
    for line in (
        "Model in phase-variable form, 2 states",
        "  states      q, v",
        "  inputs      u",
        "  parameters  M = 95.1, gtau = 35.15, Fv = 203.5, Fc = 20.39, offset = -3.16",
        "    q' = v",
        "    v' = (gtau*u - Fv*v - Fc*tanh(v/0.001) - offset)/M",
        "    y = q",
        "    d(phi)/d(v) = (-Fv - Fc*(1000*(1 - tanh(v/0.001)**2)))/M",
        "  relative degree of u: 2",
    ):
        assert line in shown.split("\n"), line
    assert "jumps: sign(a)" in str(Model(states=["a"], phi="sign(a)"))
    assert "    y[2] = psi" in str(ship())
    assert "    K_T[1] = " in str(Model(**VDP))
    assert "    diffusion[1] = sigma" in str(Model(**VDP).plant())
    assert repr(emps()) == "<Model in phase-variable form, 2 states: q, v>"
    assert r"\dot{q} &= v" in emps().latex()
    assert emps()._repr_latex_().startswith(r"$\begin{aligned}")


# --- callables that stay Python -------------------------------------------------------------------


def branchy(t, x, u, p):
    """A branch on a value."""
    return p.k * x[0] if x[0] > 0 else u[0]


def test_a_callable_with_a_branch_stays_a_callable():
    model = Model(states=["a", "b"], inputs=["u"], parameters={"k": 3.0}, phi=branchy)
    assert not model.compiled
    assert model.spec["table"] is None
    assert "value of an expression is needed" in model.why_not_compiled
    assert "runs as Python, slowly" in str(model)
    call = model.callables["phi"]
    assert call(0.0, np.array([2.0, 0.0]), np.array([5.0])) == [6.0]
    assert model.with_parameters(k=4).callables["phi"](0.0, [2.0, 0.0], [5.0]) == [8.0]
    assert call(0.0, np.array([-2.0, 0.0]), np.array([5.0])) == [5.0]
    assert pickle.loads(pickle.dumps(model)) == model
    for use in (model.jacobian, model.relative_degree, lambda: model.equations, model.plant):
        with pytest.raises(HgoError, match=r"is not compiled|inputs"):
            use()


def sine(t, x, u):
    return math.sin(x[1])


def test_one_callable_beside_expressions():
    model = Model(states=["a", "b"], f=["2*k*a", sine], parameters={"k": 1.0})
    assert not model.compiled
    assert pickle.loads(pickle.dumps(model)) == model
    np.testing.assert_allclose(model.callables["f"](0.0, [1.0, 0.5], []), [2.0, math.sin(0.5)])
    sampled = Model(**{**VDP, "f": lambda t, x, u: [x[1], math.sin(x[0])]})
    values = sampled.callables
    assert set(values) == {"f", "K_T", "h"}
    np.testing.assert_allclose(values["h"](0.0, [0.3, 0.0], []), [0.3])
    assert values["K_T"](0.0, [0.3, 0.0], [], 0.5, 0.01).shape == (2,)


def test_a_trace_that_tells_other_numbers_is_not_used():
    def looks_at_types(t, x, u):
        return x[0] if isinstance(x[0], float) else 2 * x[0]

    model = Model(states=["a"], phi=looks_at_types)
    assert not model.compiled
    assert "other numbers" in model.why_not_compiled


# --- errors ---------------------------------------------------------------------------------------


def make(**changes):
    given = {"states": ["q", "v"], "inputs": ["u"], "parameters": {"M": 1.0}, "phi": "u/M"}
    return Model(**{**given, **changes})


WRONG = {
    "unknown parameter": ({"phi": "u/m"}, "phi: unknown name m.*did you mean M"),
    "missing parameter": ({"phi": "Fv*v"}, "phi: unknown name Fv.*declare it as a state"),
    "caret": ({"phi": "u/M +* v"}, "\n    u/M \\+\\* v\n         \\^$"),
    "nan": ({"parameters": {"M": math.nan}}, r"parameters\['M'\] = nan: must be"),
    "inf": ({"parameters": {"M": math.inf}}, r"parameters\['M'\] = inf: must be"),
    "text": ({"parameters": {"M": "1"}}, r"parameters\['M'\] = '1': must be a number"),
    "no dict": ({"parameters": [1.0]}, "must be a dict"),
    "doubled": ({"states": ["q", "q"]}, "q is already among the states"),
    "state and input": ({"inputs": ["q"]}, "inputs = 'q'.*already among the states"),
    "input and parameter": ({"parameters": {"u": 1}}, "parameters = 'u'.*already among the inputs"),
    "time": ({"states": ["t", "v"]}, "t is reserved"),
    "function": ({"states": ["sin", "v"]}, "sin is reserved"),
    "constant": ({"parameters": {"pi": 3}}, "pi is reserved"),
    "word": ({"inputs": ["and"]}, "and is reserved"),
    "dunder": ({"states": ["__class__", "v"]}, "must be a letter, then"),
    "unicode": ({"states": ["θ", "v"]}, "must be a letter, then"),
    "long": ({"states": ["q" * 65, "v"]}, "at most 64"),
    "a space": ({"states": ["q v"]}, "must be a letter, then"),
    "newline": ({"states": ["q\n", "v"]}, "must be a letter, then"),
    "no name": ({"states": [1]}, "must be a letter, then"),
    "one string": ({"states": "qv"}, "must be a list of names"),
    "no states": ({"states": []}, "at least one name"),
    "nothing": ({"phi": None}, "a model of nothing: must be one of the forms"),
    "too much": ({"f": ["q", "v"]}, "a model of f, phi: must be one of the forms"),
    "a list for phi": ({"phi": ["u", "v"]}, "phi"),
    "condition": ({"phi": "q < v"}, "phi: a condition stands where a number is needed"),
    "none": ({"phi": object()}, "phi: object is no number"),
    "infinite": ({"phi": math.inf}, "phi: the number inf is not finite"),
    "triangular": (
        {"phi": None, "f": ["v", "q"]},
        r"f\[0\]: v contains v with the slope 1, which the chain .* has already",
    ),
    "length": ({"phi": None, "f": ["q"]}, "f has 1 expressions: must have 2"),
    "no list": ({"phi": None, "f": "q"}, "must be 2 expressions; give a list"),
    "callable of two": ({"phi": lambda t, x: x[0]}, r"must take \(t, x, u\), or \(t, x, u, p\)"),
    "callable with a limit": ({"phi": lambda t, x, u: x[0] ** 99}, "phi: the exponent 99"),
    "callable that divides by 0": ({"phi": lambda t, x, u: x[0] / 0.0}, "phi: division by zero"),
    "callable that fails": ({"phi": lambda t, x, u: x[7]}, "phi failed with IndexError"),
    "callable of too many": (
        {"phi": lambda t, x, u: [1.0, 2.0]},
        "phi gives 2 values: must give 1",
    ),
    "callable of a name": ({"phi": lambda t, x, u: None}, "phi: NoneType is no number"),
}


@pytest.mark.parametrize("name", WRONG)
def test_errors_name_what_is_wrong(name):
    changes, says = WRONG[name]
    with pytest.raises(HgoError, match=says):
        make(**changes)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"parameters": {"T": 1.0}}, "T is reserved"),
        ({"states": ["y", "x2"]}, "y is reserved"),
        ({"h": "1"}, "depends on no state"),
        ({"h": "x1 + t"}, "h: x1 \\+ t depends on t"),
        ({"K_T": ["y"]}, "K_T has 1 expressions: must have 2"),
        ({"f": ["y", "x1"]}, "unknown name y"),
    ],
)
def test_errors_of_the_sampled_form(changes, says):
    with pytest.raises(HgoError, match=says):
        Model(
            **{
                **VDP,
                "parameters": {**VDP["parameters"], **changes.pop("parameters", {})},
                **changes,
            }
        )


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"f1": ["z"]}, r"f1\[0\]: z depends on z.*Katayama"),
        ({"g": [["u"]]}, r"g\[0\]: u depends on u"),
        ({"g": [[0]]}, "g has rank 0.*relative degree 1"),
        ({"g": [[1, 2]]}, "g has 2 expressions: must have 1 by 1"),
        ({"f1": [0, 0]}, "f1 has 2 expressions: must have 1 to 1"),
        ({"f1": "0"}, "give f1 as a list"),
        ({"f2": None}, "a model of f1, g: must be"),
    ],
)
def test_errors_of_the_strict_feedback_form(changes, says):
    given = {"states": ["x", "z"], "inputs": ["u"], "f1": [0], "g": [["1 + x**2"]], "f2": ["u - z"]}
    assert Model(**given).order == 1
    with pytest.raises(HgoError, match=says):
        Model(**{**given, **changes})


def test_errors_of_a_plant():
    with pytest.raises(HgoError, match=r"drift\[1\]: unknown name u"):
        Plant(states=["a", "b"], drift=["b", "u"])
    with pytest.raises(HgoError, match="diffusion has 1 expressions: must have 2"):
        Plant(states=["a", "b"], drift=["b", "a"], diffusion=["1"])
    with pytest.raises(HgoError, match="output: unknown name c"):
        Plant(states=["a", "b"], drift=["b", "a"], output="c")


@pytest.mark.parametrize("written", ["sign(-0.5*a)", "-0.5*a", "min(sign(-0.5*a), 1)"])
def test_a_zero_keeps_its_sign_in_the_twin_too(written):
    """The angle of a point on the negative axis is -pi below it, pi above it."""
    model = Model(states=["a", "b"], phi=f"atan2({written}, -2.4)")
    observer = hgo.StandardObserver(2, 3.0, model=model, method="euler", timing="predictor")
    core = observer.run(0.1, np.zeros(2)).x_hat
    law = twin.Observer(observer.spec)
    found = law.run(np.array([0.0, 0.1]), np.zeros((2, 1)), None, np.zeros(2))["memory"]
    assert core[1] == pytest.approx([0.0, -0.1 * np.pi], rel=1e-15)
    assert np.array_equal(core, found)
