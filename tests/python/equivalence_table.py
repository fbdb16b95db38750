"""How closely the compiled core and the NumPy reference agree, law by law.

`CASES` is what test_equivalence.py checks; run this file for the table of largest differences.
A difference is relative: the largest |core - reference| of a signal over its root mean square.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import hgo_rs
from hgo_rs import _core, reference
from hgo_rs.reference.noise import Streams
from hgo_rs.simulation import ColouredNoise

STEPS = 10_000
"""Of the first study and the first record of each law; the others take `SHORT`."""
SHORT = 1_000
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")
PLACED = ("zoh", "bilinear", "implicit-map")
JOINT = ("euler", "rk4", "bogacki-shampine")
TOLERANCE = 1e-12

Array = npt.NDArray[np.float64]
Spec = dict[str, Any]
Tree = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One comparison: `law` is its row of the table, `kind` a function of `COMPARE`."""

    law: str
    name: str
    kind: str
    spec: Spec

    def __str__(self) -> str:
        return f"{self.law}: {self.name}"


# --- the laws ---------------------------------------------------------------------------------

CONSTANT = {"law": "constant", "ell": 3.0}
ADAPTIVE = {"law": "adaptive", "p1": 10.0, "p2": 0.0025, "b": 0.183}
HOMOGENEOUS = {"law": "homogeneous", "rho": 3.0, "degree": -0.6}
DEAD_ZONE = {"law": "dead-zone", "p1": 0.2, "p2": 0.05, "b": 0.183}
GAINS = {"constant": CONSTANT, "adaptive": ADAPTIVE, "dead-zone": DEAD_ZONE}

NONE = {"kind": "none"}
LEE = {"kind": "lee"}
CRACKLE = {"kind": "crackle", "phi_max": 3.0}
VAN_DER_POL = {"kind": "van-der-pol", "epsilon": 0.8, "sigma": 0.5, "multiplicative": False}
SHIP = {"kind": "ship", "delta": 0.5, "w": [0.01, -0.02, 0.005]}


def still(nu1: float = 1.9, nu2: float = 0.1) -> Spec:
    return {"kind": "sanfelice-praly", "nu1": nu1, "nu2": nu2}


def standard(n: int, gain: Spec, method: str = "euler", model: Spec = NONE) -> Spec:
    k = hgo_rs.StandardObserver(n, 1.0).spec["k"]
    return {"kind": "standard", "n": n, "k": k, "gain": gain, "model": model, "method": method}


def low_power(n: int, gain: Spec, method: str = "euler", model: Spec = NONE) -> Spec:
    spec = hgo_rs.LowPowerObserver(n, 1.0, method="euler").spec
    more = {"gain": gain, "model": model, "method": method, "timing": "predictor"}
    return {**spec, **more}


def peaking_free(
    n: int, gain: Spec, method: str = "euler", model: Spec = NONE, clip: str = "hard"
) -> Spec:
    """Saturation levels low enough that every eta meets them."""
    levels = [0.4 / (i + 1) for i in range(n - 1)]
    own = {"kind": "peaking-free", "saturation": levels, "clip": clip}
    return {**low_power(n, gain, method, model), **own}


def filtered(n: int, gain: Spec, model: Spec = NONE) -> Spec:
    spec = hgo_rs.HighGainObserver("filtered", n, 1.0, filters=2).spec
    return {**spec, "gain": gain, "model": model}


def copies(kind: str, method: str, count: int = 3) -> Spec:
    return {
        **standard(2, ADAPTIVE, method, still()),
        "kind": kind,
        "k": [2.0, 2.0],
        "k_bar": [0.0558, 0.0317],
        "copies": count,
    }


def spread(kind: str, count: int = 3) -> list[float]:
    """Starts of the copies, apart, near their limit cycle; a start of the main observer before."""
    starts = [[-0.0526 + 0.03 * np.cos(2.1 * i), 0.05 * np.sin(2.1 * i), 1.1] for i in range(count)]
    main = [[-0.0526, 0.02, 1.2]] if kind == "modified" else []
    return [float(v) for row in main + starts for v in row]


WINDOW = {
    "kind": "window",
    "n": 2,
    "window": 3,
    "W": [0.9, 0.2, -0.1, 40.0, 5.0, -20.0],
    "dt": 0.01,
    "model": {"kind": "none"},
}
SAMPLED_DATA = {"kind": "sampled-data", "model": VAN_DER_POL}
REDUCED_ORDER = {
    "kind": "reduced-order",
    "model": {"kind": "ship"},
    "h_bar": [0.1, 0.2, 0.2],
    "epsilon": 0.1,
}


def initial(observer: Spec) -> list[float]:
    return [float(v) for v in _core.Observer(observer).initial()]


# --- the cases --------------------------------------------------------------------------------


def study(plant: Spec, observer: Spec, x0: list[float], dt: float, **more: Any) -> Spec:
    spec: Spec = {
        "plant": plant,
        "observer": observer,
        "steps": STEPS,
        "schedule": {"kind": "fixed", "dt": dt},
        "x0": x0,
        "memory0": initial(observer),
        "noise": {"kind": "uniform", "low": -0.05, "high": 0.05},
        "seed": 7,
        "windows": [[0, 500], [STEPS // 2, STEPS + 1]],
        "settle": 0.2,
        "every": 1,
    }
    return spec | more


def modes(observer: Spec) -> Iterator[str]:
    yield "sampled"
    if observer.get("method") in JOINT:
        yield "joint"


def continuous_laws() -> Iterator[tuple[str, str, Spec]]:
    """(law, parameters, observer) for every continuous law of one output, under every method.

    Order 2 meets every gain under every method; the others meet the constant gain under every
    method, and share the methods out between the two gains that move.
    """
    for i, method in enumerate(METHODS):
        shared = ("constant", "dead-zone" if i % 2 else "adaptive")
        for n in (1, 2, 3, 5, 12):
            for name in GAINS if n == 2 else shared:
                law = standard(n, GAINS[name], method)
                yield f"standard, {name} gain", f"n={n} {method}", law
        yield "low-power", f"n=12 {method}", low_power(12, CONSTANT, method)
        yield "low-power", f"n=5 {method}", low_power(5, CONSTANT, method)
        for clip in ("hard", "smooth"):
            law = peaking_free(5, CONSTANT, method, clip=clip)
            yield f"peaking-free, {clip} clip", f"n=5 {method}", law
    for name, method in (("adaptive", "staggered-euler"), ("dead-zone", "rk4")):
        named = f"n=3 {name} {method}"
        yield "low-power", named, low_power(3, GAINS[name], method)
        for clip in ("hard", "smooth"):
            law = peaking_free(3, GAINS[name], method, clip=clip)
            yield f"peaking-free, {clip} clip", named, law


def simulated(observer: Spec) -> bool:
    """Whether a plant has the law's order; adaptive gains are simulated at order 2 only."""
    return observer["n"] == 2 or (observer["n"] == 5 and observer["gain"] is CONSTANT)


def with_plants() -> Iterator[Case]:
    """Laws of order 2 on Lee's plant and of order 5 on crackle, sampled and joint."""
    for law, name, observer in continuous_laws():
        if not simulated(observer):
            continue
        small = observer["n"] == 2
        model, x0 = (LEE, [1.0, 0.0]) if small else (CRACKLE, [-0.8, 0.0, 0.0, 0.0, 0.0])
        known = {**observer, "model": model}
        for mode in modes(observer):
            # crackle is chaotic: over 10 s
            spec = study(model, known, x0, 0.004 if small else 0.001, mode=mode)
            yield Case(law, f"{name} {mode}", "simulate", spec)


def records() -> Iterator[Case]:
    """Laws of the other orders over an uneven record with gaps."""
    for law, name, observer in continuous_laws():
        if not simulated(observer):
            yield Case(law, f"{name} record", "record", {"observer": observer})
    for method in METHODS:
        known = standard(3, CONSTANT, method, {"kind": "input", "b0": 0.7})
        yield Case("standard, constant gain", f"n=3 input {method}", "record", {"observer": known})
    for method in ("euler", "bogacki-shampine"):
        known = low_power(2, CONSTANT, method, {"kind": "input", "b0": 0.7})
        yield Case("low-power", f"n=2 input {method}", "record", {"observer": known})
    for kind in ("collection", "modified"):
        spec = {"observer": copies(kind, "bogacki-shampine"), "memory0": spread(kind)}
        yield Case(kind, "record", "record", spec)
    for gain in ("derived", "printed"):
        spec = {"observer": {**SAMPLED_DATA, "gain": gain}}
        yield Case(f"sampled-data, {gain}", "record", "record", spec)
    yield Case("reduced-order", "record", "record", {"observer": REDUCED_ORDER})
    yield Case("window", "record", "record", {"observer": WINDOW})


def timed() -> Iterator[Case]:
    """Current timing, and the methods that place eigenvalues under both timings."""
    small, large = (LEE, [1.0, 0.0], 0.004), (CRACKLE, [-0.8, 0.0, 0.0, 0.0, 0.0], 0.001)
    laws = [
        ("standard", standard(2, CONSTANT, "euler", LEE), small),
        ("standard", standard(2, CONSTANT, "rk4-innovation-held", LEE), small),
        ("standard", standard(2, CONSTANT, "zoh", LEE), small),
        ("standard", standard(2, CONSTANT, "bilinear", LEE), small),
        ("standard", standard(2, CONSTANT, "implicit-map", LEE), small),
        ("standard, adaptive gain", standard(2, ADAPTIVE, "zoh", LEE), small),
        ("low-power", low_power(5, CONSTANT, "zoh", CRACKLE), large),
        ("peaking-free", peaking_free(5, CONSTANT, "zoh", CRACKLE), large),
        ("low-power", low_power(2, CONSTANT, "staggered-euler", LEE), small),
    ]
    for law, observer, (plant, x0, dt) in laws:
        for timing in ("predictor", "current"):
            method = observer["method"]
            if timing == "predictor" and method in METHODS:
                continue  # stands above
            spec = study(plant, {**observer, "timing": timing}, x0, dt)
            yield Case(law, f"{method} {timing}", "simulate", spec)
    for method in ("bogacki-shampine", "zoh"):
        observer = {**standard(3, CONSTANT, method), "timing": "current"}
        yield Case("standard", f"n=3 {method} current record", "record", {"observer": observer})


def repelled() -> Iterator[Case]:
    for kind, method in itertools.product(("collection", "modified"), METHODS):
        observer = copies(kind, method)
        for mode in modes(observer):
            if kind == "modified" and mode == "joint" and method != "rk4":
                continue  # slow, and the collection's schemes are these
            spec = study(still(), observer, [-0.1 / 1.9, 0.0], 0.002, mode=mode)
            spec |= {"memory0": spread(kind), "plant_method": "held"}
            spec["noise"] = {"kind": "normal", "mean": -0.02, "std": 0.015, "hold": 5}
            yield Case(kind, f"{method} {mode}", "simulate", spec)
    spec = study(still(), copies("collection", "euler", 5), [-0.1 / 1.9, 0.0], 0.002)
    spec |= {"memory0": spread("collection", 5), "plant_method": "held"}
    yield Case("collection", "5 copies", "simulate", spec)


def recursions() -> Iterator[Case]:
    for gain, multiplicative in itertools.product(("derived", "printed"), (False, True)):
        plant = {**VAN_DER_POL, "multiplicative": multiplicative}
        observer = {**SAMPLED_DATA, "model": plant, "gain": gain}
        for method in ("milstein",) if multiplicative else ("taylor-1.5", "euler-maruyama"):
            spec = study(plant, observer, [1.0, -1.0], 0.01, plant_method=method, substeps=3)
            spec |= {"runs": 3, "first_run": 5, "histogram": [1000, 9000], "every": 4}
            yield Case(f"sampled-data, {gain}", f"{method}", "simulate", spec)
    for method, substeps in (("euler", 2), ("rk4", 1)):
        spec = study(SHIP, REDUCED_ORDER, [0.0, 6.0, 0.0, 0.5, 0.0, 0.0], 0.01)
        spec |= {"plant_method": method, "substeps": substeps}
        spec["noise"] = {"kind": "normal", "mean": 0.0, "std": 1e-3}
        yield Case("reduced-order", method, "simulate", spec)
    gaps = np.random.default_rng(3).normal(scale=1e-3, size=STEPS + 1)
    gaps[700:712] = gaps[4000] = gaps[9000:9300] = np.nan
    spec = study(SHIP, REDUCED_ORDER, [0.0, 6.0, 0.0, 0.5, 0.0, 0.0], 0.01)
    spec |= {"plant_method": "bogacki-shampine", "noise": {"kind": "samples", "values": gaps}}
    yield Case("reduced-order", "bogacki-shampine, missing samples", "simulate", spec)


def plants_and_noise() -> Iterator[Case]:
    """Every plant under every scheme, with every kind of noise in turn."""
    sequence = np.random.default_rng(5).normal(size=STEPS + 1)
    sequence[[50, 51, 52, 6000]] = np.nan
    sines = [[0.1, 40.0, 0.3], [0.02, 300.0, -1.0]]
    kinds = itertools.cycle(
        [
            {"kind": "uniform", "low": -0.2, "high": 0.3, "hold": 7},
            {"kind": "normal", "mean": 0.1, "std": 0.05},
            {"kind": "samples", "values": sequence},
            {"kind": "none", "sines": sines},
            {"kind": "normal", "mean": 0.0, "std": 0.1, "hold": 4, "sines": sines},
            {"kind": "none"},
            {"kind": "student-t", "mean": 0.1, "scale": 0.02, "nu": 2.5},
            {"kind": "laplace", "mean": 0.0, "scale": 0.05, "hold": 3},
            {"kind": "impulsive", "mean": 0.0, "scale": 0.02, "probability": 0.1, "ratio": 9.0},
            ColouredNoise([1.4, -0.5], 0.05).draw(),
            {"kind": "uniform", "low": -0.1, "high": 0.1, "sines": sines},
        ]
    )
    deterministic = ("euler", "rk4", "bogacki-shampine", "held")
    plants = [
        (LEE, [1.0, -0.5], deterministic),
        (still(-0.7, 0.3), [1.0, 0.2], deterministic),
        ({**VAN_DER_POL, "sigma": 0.0}, [1.0, 0.0], deterministic),
        (VAN_DER_POL, [1.0, 0.0], ("euler-maruyama", "milstein", "taylor-1.5")),
        (
            {**VAN_DER_POL, "multiplicative": True, "sigma": 0.3},
            [1.0, 0.0],
            ("euler-maruyama", "milstein"),
        ),
        (CRACKLE, [-0.8, 0.0, 0.0, 0.0, 0.0], deterministic),
    ]
    for plant, x0, methods in plants:
        for method, substeps in zip(methods, itertools.cycle((1, 3)), strict=False):
            noise = next(kinds)
            observer = standard(len(x0), CONSTANT, "euler", plant)
            # 0.01 s steps: a hundred seconds; crackle over its ten
            spec = study(plant, observer, x0, 0.001 if plant is CRACKLE else 0.01)
            spec |= {"plant_method": method, "substeps": substeps, "noise": noise}
            spec |= {"runs": 2, "first_run": 3, "histogram": [10, 9000]}
            more = "+".join(sorted(noise.keys() - {"kind"}))
            named = f"{method} x{substeps}, noise {noise['kind']} {more}"
            yield Case(f"plant {plant['kind']}", named, "simulate", spec)
    joint = study(LEE, standard(2, CONSTANT, "rk4", LEE), [1.0, -0.5], 0.01, mode="joint")
    for noise in (
        {"kind": "none", "sines": sines},
        {"kind": "samples", "values": sequence, "hold": 3},
        {"kind": "normal", "mean": 0.0, "std": 0.1, "hold": 4, "sines": sines},
    ):
        named = f"joint, noise {noise['kind']}"
        yield Case("plant lee", named, "simulate", {**joint, "noise": noise})
    held = {**joint, "plant_method": "held"}
    yield Case("plant lee", "joint, held", "simulate", held)


def schedules() -> Iterator[Case]:
    for p in (1.0, 0.75):
        steps = {"kind": "stochastic-approximation", "alpha": 1.0, "epsilon": 0.01, "k0": 2000.0}
        observer = standard(2, {"law": "constant", "ell": 30.0})
        spec = study(LEE, observer, [1.0, 1.0], 0.01, schedule={**steps, "p": p})
        yield Case("stochastic approximation", f"p={p}", "simulate", spec)
        fixed = {"kind": "fixed", "dt": 0.002}
        apart = {**spec, "plant_schedule": fixed}
        yield Case("stochastic approximation", f"p={p}, plant at T", "simulate", apart)
    quiet = {key: spec[key] for key in spec.keys() - {"noise", "settle", "every", "seed"}}
    quiet["variance"] = 1.0 / 12.0
    yield Case("mean and covariance", "decreasing steps", "mean_covariance", quiet)
    fixed = {**quiet, "schedule": {"kind": "fixed", "dt": 0.01}}
    yield Case("mean and covariance", "fixed steps", "mean_covariance", fixed)


def paths() -> Iterator[Case]:
    for multiplicative, methods in (
        (False, ("euler-maruyama", "milstein", "taylor-1.5")),
        (True, ("euler-maruyama", "milstein")),
    ):
        for method in methods:
            plant = {**VAN_DER_POL, "multiplicative": multiplicative}
            spec = {
                "plant": plant,
                "x0": [1.0, -1.0],
                "t_end": 2.0,
                "coarse": 100,
                "fine": 100,
                "method": method,
                "runs": 4,
                "seed": 11,
                "first_run": 2,
            }
            named = f"{method}{' multiplicative' if multiplicative else ''}"
            yield Case("coupled paths", named, "coupled_paths", spec)


def streams() -> Iterator[Case]:
    for seed, run, channel in ((0, 0, 0), (1, 0, 1), (2**64 - 1, 123_456_789, 0), (42, 2**63, 1)):
        spec = {"seed": seed, "run": run, "channel": channel}
        yield Case("random streams", f"seed={seed} run={run} channel={channel}", "random", spec)


def own_models() -> dict[str, hgo_rs.Model]:
    """One of each form: t, x and u in every function that may have them, h not x_1."""
    joint = {"states": ["q", "w"], "inputs": ["u"]}
    return {
        "phase": hgo_rs.Model(phi="u*cos(t) - 0.5*w - 4*sin(q) + 0.3*sin(3*t)", **joint),
        "triangular": hgo_rs.Model(
            states=["a", "b", "c"],
            inputs=["u", "v"],
            f=["0.2*sin(a)*cos(2*t) + 0.1*u", "0.1*a*b*v + sin(t)", "-c - b + u*v + 0.2*cos(5*t)"],
        ),
        "nonlinear chain": hgo_rs.Model(
            states=["a", "b", "c"],
            inputs=["u"],
            f=["0.3*b**3 + 0.1*sin(2*t)", "0.4*c*cos(a) - 0.1*a*b*u", "-a - c + u*cos(t)"],
        ),
        "chains": hgo_rs.Model(
            states=["q", "w", "p", "v", "a"],
            inputs=["u"],
            orders=[2, 3],
            phi=["u - 0.5*w - 4*sin(q) + 0.2*sin(3*t)*p", "-2*a - v + 0.3*w + u*cos(t)"],
        ),
        "sampled": hgo_rs.Model(
            f=["w + 0.1*u*cos(t)", "2*sin(5*t) - q + u"],
            K_T=["T*(8 + 0.2*u)*(y - 2*q - 0.1*w)", "T*(9 + sin(3*t))*(y - 2*q - 0.1*w)"],
            h="2*q + 0.1*w",
            **joint,
        ),
        "strict-feedback": hgo_rs.Model(
            states=["p", "th", "v", "om"],
            inputs=["F", "M"],
            f1=["0.1*sin(p)", "0.2*sin(th)*p"],
            g=[["cos(th)", "0.1"], ["0", "1 + 0.1*p*p"]],
            f2=["F*cos(t) - 0.4*v - 0.1*om*p", "M - om + 0.3*sin(3*t)*v"],
        ),
    }


OWN = own_models()


def on_chains(method: str, timing: str) -> Spec:
    """An observer for each of two outputs."""
    manner: Spec = {"method": method, "timing": timing}
    laws = [hgo_rs.StandardObserver(2, 6.0, **manner), hgo_rs.LowPowerObserver(3, 3.0, **manner)]
    return dict(hgo_rs.MultiOutputObserver(laws, model=OWN["chains"]).spec)


def own_records() -> Iterator[Case]:
    """Own models of every form under every method and timing: core, twin, and their loops."""
    for method, timing in itertools.product((*METHODS, *PLACED), ("predictor", "current")):
        for law, observer in {
            "phase": standard(2, CONSTANT, method, OWN["phase"].spec),
            "phase, adaptive": standard(2, ADAPTIVE, method, OWN["phase"].spec),
            "triangular": standard(3, CONSTANT, method, OWN["triangular"].spec),
            "nonlinear chain": standard(3, CONSTANT, method, OWN["nonlinear chain"].spec),
            "low-power, phase": low_power(2, CONSTANT, method, OWN["phase"].spec),
            "peaking-free, phase": peaking_free(2, CONSTANT, method, OWN["phase"].spec),
            "chains": on_chains(method, timing),
        }.items():
            if "adaptive" in law and method in PLACED:
                continue
            given = observer if law == "chains" else {**observer, "timing": timing}
            yield Case(f"own {law}", f"{method} {timing}", "loop", {"observer": given})
    for (law, observer), (method, timing) in itertools.product(
        {
            "phase": standard(2, CONSTANT, "euler", OWN["phase"].spec),
            "phase, adaptive": standard(2, ADAPTIVE, "euler", OWN["phase"].spec),
            "triangular": standard(3, CONSTANT, "euler", OWN["triangular"].spec),
            "homogeneous": standard(3, HOMOGENEOUS, "euler"),
            "low-power, phase": low_power(2, CONSTANT, "euler", OWN["phase"].spec),
            "peaking-free, phase": peaking_free(2, CONSTANT, "euler", OWN["phase"].spec),
            "filtered, phase": filtered(2, CONSTANT, OWN["phase"].spec),
            "filtered, adaptive": filtered(2, ADAPTIVE, OWN["phase"].spec),
            "filtered, homogeneous": filtered(3, {**HOMOGENEOUS, "degree": -0.2}),
        }.items(),
        (
            ("proper", "predictor"),
            ("proper", "current"),
            ("implicit", "current"),
            ("inter-sample", "predictor"),
        ),
    ):
        if method != "proper" and observer["kind"] != "standard":
            continue
        if method == "implicit" and law == "homogeneous":  # x_hat_n has roundings over dt^(n-1)
            observer = standard(2, {**HOMOGENEOUS, "degree": -1.0})
        given = {**observer, "method": method, "timing": timing}
        if method != "implicit" and "phase" in law and "low" not in law:
            given["motion"] = "rk4"
        yield Case(f"own {law}", f"{method} {timing}", "loop", {"observer": given})
    model = OWN["sampled"]
    sampled = dict(hgo_rs.SampledDataObserver(model).spec)
    yield Case("own sampled-data", "record", "loop", {"observer": sampled})
    reduced = hgo_rs.ReducedOrderObserver(0.2, model=OWN["strict-feedback"])
    yield Case("own reduced-order", "record", "loop", {"observer": dict(reduced.spec)})


def own_beside_built_in() -> Iterator[Case]:
    """The equations of built-in models, written as one's own: the core's bits."""
    joint = {"states": ["a", "b"]}
    pairs = {
        "lee": (LEE, hgo_rs.Model(phi="-a/(1 + a*a) - b", **joint)),
        "input": ({"kind": "input", "b0": 0.7}, hgo_rs.Model(phi="0.7*u", inputs=["u"], **joint)),
    }
    for (name, (built_in, own)), method, timing in itertools.product(
        pairs.items(), (*METHODS, *PLACED), ("predictor", "current")
    ):
        for law, of in {"standard": standard, "low-power": low_power}.items():
            observer = {**of(2, CONSTANT, method, own.spec), "timing": timing}
            spec = {"observer": observer, "built_in": built_in}
            yield Case(f"own beside built-in, {law}", f"{name} {method} {timing}", "loop", spec)


def own_studies() -> Iterator[Case]:
    """Plants whose output and diffusion have t, under lost samples and steps that shrink."""
    gaps = np.random.default_rng(4).normal(scale=0.01, size=STEPS + 1)
    gaps[700:712] = gaps[4000] = gaps[9000:9300] = np.nan
    equations = {"states": ["q", "w"], "drift": ["w", "2*sin(5*t) - q - 0.5*w"]}
    still = hgo_rs.Plant(output="q + 0.2*sin(3*t)", **equations)
    noisy = hgo_rs.Plant(
        output="2*q + 0.1*w", diffusion=["0.02*cos(t)", "0.1*sin(2*t)"], **equations
    )
    known = hgo_rs.Model(states=["q", "w"], phi="2*sin(5*t) - q - 0.5*w").spec
    fu = hgo_rs.Model(
        states=["q", "w"],
        f=["w", "2*sin(5*t) - q - 0.5*w"],
        K_T=["T*(8 + sin(t))*(y - 2*q - 0.1*w)", "9*T*(y - 2*q - 0.1*w)"],
        h="2*q + 0.1*w",
    )
    steps = {"kind": "stochastic-approximation", "alpha": 1.0, "epsilon": 0.01, "k0": 9e3, "p": 1.0}
    for method, timing in (
        ("euler", "predictor"),
        ("rk4", "current"),
        ("zoh", "current"),
        ("zoh", "predictor"),
        ("bilinear", "current"),
    ):
        observer = {**standard(2, CONSTANT, method, known), "timing": timing}
        spec = study(still.spec, observer, [0.5, 0.0], 0.005, plant_method="rk4")
        spec["noise"] = {"kind": "samples", "values": gaps}
        yield Case("own plant and model", f"{method} {timing}", "simulate", spec)
    slower = study(still.spec, observer, [0.5, 0.0], 0.005, plant_method="rk4", schedule=steps)
    yield Case("own plant and model", "steps that shrink", "simulate", slower)
    observer = dict(hgo_rs.SampledDataObserver(fu).spec)
    spec = study(noisy.spec, observer, [0.5, 0.0], 0.005, plant_method="euler-maruyama", runs=2)
    yield Case("own plant and model", "sampled-data, h and diffusion", "simulate", spec)


def shortened(cases: Iterator[Case]) -> Iterator[Case]:
    """The first case of each law and kind as it is, as are those that place something in time; the
    others over `SHORT` steps."""
    seen = set()
    for case in cases:
        spec = case.spec
        whole = (case.law, case.kind) not in seen or (
            case.kind == "simulate" and ("histogram" in spec or spec["noise"]["kind"] == "samples")
        )
        seen.add((case.law, case.kind))
        if whole or case.kind not in ("simulate", "record"):
            yield case
            continue
        short = {**spec, "steps": SHORT}
        if case.kind == "simulate":
            short["windows"] = [[0, 500], [SHORT // 2, SHORT + 1]]
        yield Case(case.law, case.name, case.kind, short)


LISTED = itertools.chain(
    with_plants(),
    records(),
    timed(),
    own_records(),
    own_beside_built_in(),
    own_studies(),
    repelled(),
    recursions(),
    plants_and_noise(),
    schedules(),
    paths(),
    streams(),
)
CASES = list(shortened(LISTED))


# --- the comparison ---------------------------------------------------------------------------


def relative(core: Any, twin: Any, axis: int | None = None) -> float:
    """Largest |core - twin| over the root mean square of the twin along `axis`."""
    core, twin = np.asarray(core, dtype=float), np.asarray(twin, dtype=float)
    if core.shape != twin.shape or not np.array_equal(np.isnan(core), np.isnan(twin)):
        return np.inf
    with np.errstate(invalid="ignore"):
        scale = np.sqrt(np.nanmean(np.square(twin), axis=axis, keepdims=True))
        gap = np.nan_to_num(np.abs(core - twin))
        return float(np.max(np.where(gap == 0.0, 0.0, gap / scale), initial=0.0))


def same(core: Any, twin: Any) -> float:
    return 0.0 if np.array_equal(core, twin) else np.inf


def compare_simulate(spec: Spec) -> float:
    core, twin = _core.simulate(spec), reference.simulate(spec)
    assert core.keys() - {"shared"} == twin.keys()
    out = [relative(core[key], twin[key], axis=1) for key in ("x", "memory", "y")]
    ends = [relative(core[key][:, None], twin[key][:, None]) for key in ("final_x", "final_memory")]
    # an error x_hat - x is measured by the size of x_hat
    signals = twin["memory"][..., : twin["max"].shape[-1]]
    size = np.sqrt(np.mean(np.square(signals), axis=1))[:, np.newaxis]
    for key in ("mean", "rms", "max"):
        out.append(float(np.max(np.abs(core[key] - twin[key]) / size)))
    out += [relative(core["t"], twin["t"]), relative(core["peak"], twin["peak"], axis=0)]
    out += [relative(core["settling_time"], twin["settling_time"])]
    out += [same(core[key], twin[key]) for key in ("diverged_at", "undefined_at")]
    if "histogram" in twin:
        edges = relative(core["histogram"]["edges"], twin["histogram"]["edges"])
        out += [edges, same(core["histogram"]["counts"], twin["histogram"]["counts"])]
    assert (core["diverged_at"] == -1).all(), "the case should not diverge"
    return max(*out, *ends)


def record() -> Tree:
    """An uneven record of one output with gaps, and of the ship's three."""
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.002, 0.006, STEPS))
    y = np.sin(t) + 0.3 * np.cos(2.3 * t) + 0.02 * rng.normal(size=STEPS)
    y[[0, 9, 10, STEPS - 1]] = np.nan
    y[600:640] = np.nan
    position = np.stack([0.5 * t, 0.3 * np.sin(0.2 * t), 0.06 * np.cos(0.2 * t)], axis=1)
    position += 1e-4 * rng.normal(size=position.shape)
    position[5:8, 1] = np.nan
    position[700:750] = np.nan
    force = np.stack([0.3 + 0.1 * np.sin(t), 0.1 * np.cos(t)], axis=1)
    return {"t": t, "y": y[:, None], "position": position, "u": force}


RECORD = record()


def compare_record(spec: Spec) -> float:
    core, twin = _core.Observer(spec["observer"]), reference.Observer(spec["observer"])
    sizes = [(o.n, o.n_y, o.n_u, o.memory_len, o.is_current) for o in (core, twin)]
    start = spec.get("memory0", initial(spec["observer"]))
    steps = spec.get("steps", STEPS)
    y = RECORD["position" if twin.n_y == 3 else "y"][:steps]
    t, u = RECORD["t"][:steps], RECORD["u"][:steps, : twin.n_u]
    tracks = core.run(t, y, u, start), twin.run(t, y, u, start)
    return max(
        same(*sizes),
        same(core.initial(), twin.initial()),
        relative(tracks[0]["memory"], tracks[1]["memory"], axis=0),
        # what is left of y: measured by the size of y
        relative(y - tracks[0]["innovation"], y - tracks[1]["innovation"], axis=0),
        same(tracks[0]["status"], tracks[1]["status"]),
    )


ROWS = 150


def uneven(observer: Any) -> tuple[Array, Array, Array]:
    """Uneven rows, inputs, samples with gaps: of all outputs, and of each at its own rate."""
    rng = np.random.default_rng(6)
    t = 0.3 + np.cumsum(rng.uniform(0.004, 0.02, ROWS))
    waves = [np.sin(t), 0.6 * np.cos(1.3 * t), np.sin(0.7 * t)]
    y = np.stack(waves[: observer.n_y], axis=1) + 0.01 * rng.normal(size=(ROWS, observer.n_y))
    for channel in range(1, observer.n_y):
        y[np.arange(ROWS) % (channel + 2) != 1, channel] = np.nan
    y[[0, 9, 10, ROWS - 1]] = np.nan
    y[80:100] = np.nan
    return t, y, np.sin(np.outer(t, np.arange(2.0, 2.0 + observer.n_u)))


def looped(observer: Any, t: Array, y: Array, u: Array) -> tuple[Array, Array]:
    """The memory of each row by the loop that a control task runs, and what became of it."""
    predict = getattr(observer, "predict", None)  # the twin's
    memory, rows, states = observer.initial(), [], []
    for k in range(len(t)):
        dt = float(t[k + 1] - t[k]) if k + 1 < len(t) else None
        if observer.is_current:
            memory, status = observer.correct(memory, y[k], t[k])
            rows.append(memory)
            states.append(status)
            if dt is not None:
                moved = memory, u[k], t[k], dt
                memory, _ = (
                    predict(*moved) if predict else observer.advance(memory, y[k], u[k], t[k], dt)
                )
        else:
            rows.append(memory)
            if dt is not None:
                memory, status = observer.step(memory, y[k], u[k], t[k], dt)
                states.append(status)
    return np.array(rows), np.array(states)


def compare_loop(spec: Spec) -> float:
    """Core and twin over a record; each beside its own loop; the built-in model beside its own."""
    core, twin = _core.Observer(spec["observer"]), reference.Observer(spec["observer"])
    t, y, u = uneven(core)
    sizes = [(o.n, o.n_y, o.n_u, o.memory_len, o.is_current) for o in (core, twin)]
    tracks = [o.run(t, y, u, o.initial()) for o in (core, twin)]
    gaps = [same(*sizes), same(core.initial(), twin.initial())]
    for observer, track in zip((core, twin), tracks, strict=True):
        rows, states = looped(observer, t, y, u)
        gaps.append(same(rows, track["memory"]))
        gaps.append(same(states, np.asarray(track["status"])[: len(states)]))
    assert np.isfinite(tracks[1]["memory"]).all() and 2 not in tracks[1]["status"]
    gaps.append(relative(tracks[0]["memory"], tracks[1]["memory"], axis=0))
    left = [y - track["innovation"] for track in tracks]
    gaps += [relative(*left, axis=0), same(tracks[0]["status"], tracks[1]["status"])]
    if "built_in" in spec:
        other = _core.Observer({**spec["observer"], "model": spec["built_in"]})
        gaps.append(same(other.run(t, y, u, other.initial())["memory"], tracks[0]["memory"]))
    return max(gaps)


def compare_paths(spec: Spec) -> float:
    core, twin = _core.coupled_paths(spec), reference.coupled_paths(spec)
    assert core.keys() - {"shared"} == twin.keys()
    return max(relative(core[key], twin[key]) for key in twin)


def compare_covariance(spec: Spec) -> float:
    core, twin = _core.mean_covariance(spec), reference.mean_covariance(spec)
    assert core.keys() - {"shared"} == twin.keys()
    entries = [np.abs(core[key] - twin[key]) / np.abs(twin[key]) for key in twin]
    return float(max(entry.max() for entry in entries))


def compare_random(spec: Spec) -> float:
    where = (spec["seed"], spec["run"], spec["channel"])

    def stream() -> Streams:
        return Streams(spec["seed"], 1, spec["channel"], spec["run"])

    return max(
        same(_core.random("bits", STEPS, *where), stream().words(STEPS)[:, 0]),
        same(_core.random("uniform", STEPS, *where), stream().uniform(STEPS)[:, 0]),
        relative(_core.random("normal", STEPS, *where), stream().normal_pairs(STEPS)[0][:, 0]),
    )


COMPARE = {
    "simulate": compare_simulate,
    "record": compare_record,
    "loop": compare_loop,
    "coupled_paths": compare_paths,
    "mean_covariance": compare_covariance,
    "random": compare_random,
}


def difference(case: Case) -> float:
    """The largest relative difference of a case."""
    return COMPARE[case.kind](case.spec)


def main() -> None:
    """Print the table: law, cases, largest relative difference."""
    worst: dict[str, list[float]] = {}
    for case in CASES:
        begin = time.perf_counter()
        worst.setdefault(case.law, []).append(difference(case))
        if "-v" in sys.argv:
            seconds = time.perf_counter() - begin
            print(f"  {worst[case.law][-1]:8.1e} {seconds:6.2f} s  {case}")
    for law, values in worst.items():
        print(f"| {law} | {len(values)} | {max(values):.1e} |")


if __name__ == "__main__":
    main()
