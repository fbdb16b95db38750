"""What a scenario is: rows beside the paper's, a figure, and the backend that computes them.

A scenario is a function `(ctx: Context) -> Outcome`, registered by `@scenario(...)` in its paper's
file. It asks the context for runs (plain-dict specs, the same for the compiled core and for the
NumPy reference) and states each result as a `row(...)` with the criterion that it must meet.
"""

from __future__ import annotations

import builtins
import hashlib
import importlib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hgo_rs.models import System
    from hgo_rs.observers import Observer
    from hgo_rs.simulation import SimulationResult

__all__ = ["PAPERS", "Context", "Outcome", "Paper", "Row", "Scenario", "row", "scenario"]

Value = float | str


@dataclass(frozen=True)
class Paper:
    """A paper whose results the scenarios reproduce."""

    id: str
    authors: str
    title: str
    where: str = ""


PAPERS: dict[str, Paper] = {
    paper.id: paper
    for paper in (
        Paper(
            "lee",
            "Joonho Lee, Jongeun Choi, Hassan K. Khalil",
            "New implementation of high-gain observers in the presence of measurement noise "
            "using stochastic approximation",
        ),
        Paper(
            "sanfelice-praly",
            "Ricardo G. Sanfelice, Laurent Praly",
            "On the performance of high-gain observers with gain adaptation under measurement "
            "noise",
            "Automatica 47 (2011) 2165-2176",
        ),
        Paper(
            "fu",
            "Xinxin Fu, Yu Kang, Pengfei Li",
            "Sampled-data observer design for a class of stochastic nonlinear systems based on "
            "the approximate discrete-time models",
        ),
        Paper(
            "katayama",
            "Hitoshi Katayama",
            "Design of high-gain reduced-order observers for nonlinear sampled-data "
            "strict-feedback systems with model uncertainty",
        ),
        Paper(
            "astolfi",
            "Daniele Astolfi, Lorenzo Marconi, Laurent Praly, Andrew Teel",
            "Low-power peaking-free high-gain observers",
        ),
        Paper(
            "khalil",
            "Hassan K. Khalil",
            "High-gain observers in nonlinear feedback control",
            "SIAM, 2017; with A. N. Atassi, IEEE Trans. Automatic Control 44 (1999) 1672; "
            "with L. B. Freidovich, the same 53 (2008) 2324",
        ),
        Paper(
            "families",
            "various",
            "Families of high-gain observers",
            "each row names its own source",
        ),
    )
}
"""The papers by id, in the order in which the scenarios run."""


@dataclass(frozen=True)
class Row:
    """One result: the paper's value, ours, and whether ours meets what is expected.

    `paper` is what the paper prints (None: nothing to compare with), `expected` what a correct
    implementation gives (None where the criterion is a bound), `tolerance` the criterion in words.
    """

    quantity: str
    paper: Value | None
    ours: Value
    expected: Value | None
    tolerance: str
    ok: bool
    note: str = ""


def row(
    quantity: str,
    ours: Any,
    *,
    expected: Any = None,
    rel: float | None = None,
    abs: float | None = None,
    at_most: float | None = None,
    at_least: float | None = None,
    paper: Any = None,
    note: str = "",
) -> Row:
    """State a result and judge it.

    Exactly one criterion is given: `expected` (a float with `rel` and/or `abs`, met when
    |ours - expected| <= max(rel |expected|, abs); a string, bool or integer without them, met when
    equal), `at_most` or `at_least`. Not-a-number never meets one.

    Raises
    ------
    ValueError
        No criterion, more than one, or a float `expected` without a tolerance.
    """
    given = [
        name
        for name, value in (("expected", expected), ("at_most", at_most), ("at_least", at_least))
        if value is not None
    ]
    if len(given) != 1:
        raise ValueError(
            f"row {quantity!r}: give exactly one of expected, at_most, at_least; "
            f"got {', '.join(given) or 'none'}"
        )
    for name, value in (("rel", rel), ("abs", abs)):
        if value is not None and expected is None:
            raise ValueError(f"row {quantity!r}: {name} = {value!r} needs expected")
        if value is not None and not (value >= 0.0 and math.isfinite(value)):
            raise ValueError(f"row {quantity!r}: {name} = {value!r} must be finite and >= 0")

    ours, expected, paper = _plain(ours), _plain(expected), _plain(paper)
    if ours is None:
        raise ValueError(f"row {quantity!r}: ours is None")
    if expected is not None and rel is None and abs is None:
        if isinstance(expected, float):
            raise ValueError(f"row {quantity!r}: expected = {expected!r} needs rel or abs")
        ok, tolerance = ours == expected, "exact"
    elif isinstance(ours, str) or isinstance(expected, str):
        raise ValueError(f"row {quantity!r}: a tolerance needs numbers, got {ours!r}, {expected!r}")
    elif expected is not None:
        allowed = max((rel or 0.0) * builtins.abs(expected), abs or 0.0)
        ok = builtins.abs(ours - expected) <= allowed
        tolerance = " or ".join(
            f"{name} {format_number(value)}"
            for name, value in (("rel", rel), ("abs", abs))
            if value is not None
        )
    elif at_most is not None:
        ok, tolerance = ours <= at_most, f"≤ {format_number(at_most)}"
    else:
        assert at_least is not None
        ok, tolerance = ours >= at_least, f"≥ {format_number(at_least)}"
    return Row(quantity, paper, ours, expected, tolerance, bool(ok), note)


def format_number(value: float) -> str:
    """Six significant digits, the exponent as one writes it: 1e-6, 6.698e6."""
    return re.sub(r"e([+-])0*(?=\d)", lambda m: "e" + m[1].strip("+"), f"{value:.6g}")


def _plain(value: Any) -> Any:
    """A Python float, int or str (yes/no for a truth value) from a NumPy or Python scalar."""
    if isinstance(value, np.ndarray):
        if value.size != 1:
            raise ValueError(f"a row holds one number, got an array of shape {value.shape}")
        value = value.reshape(())[()]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or isinstance(value, (str, int, float)):
        return value
    raise TypeError(f"a row holds a number or a string, got {value!r}")


@dataclass
class Outcome:
    """What a scenario yields: its rows and, if it has one, a function that draws its figure.

    The function draws with the object interface (`fig.subplots()`, ...) on the empty Figure that
    it is given, so that no scenario imports matplotlib.
    """

    rows: list[Row]
    figure: Callable[[Figure], None] | None = None

    @property
    def ok(self) -> bool:
        """Every row meets its criterion (and there is one)."""
        return bool(self.rows) and all(r.ok for r in self.rows)


@dataclass(frozen=True)
class Scenario:
    """A registered scenario. Call it with a `Context`."""

    id: str
    title: str
    paper: str
    function: Callable[[Context], Outcome]

    def __call__(self, ctx: Context) -> Outcome:
        return self.function(ctx)


REGISTRY: dict[str, Scenario] = {}

_F = TypeVar("_F", bound=Callable[["Context"], Outcome])


def scenario(id: str, *, title: str, paper: str) -> Callable[[_F], _F]:
    """Register a scenario; the order of definition is kept. The function comes back unchanged."""
    if paper not in PAPERS:
        raise ValueError(f"scenario {id!r}: paper {paper!r} is not one of {', '.join(PAPERS)}")

    def register(function: _F) -> _F:
        known = REGISTRY.get(id)
        if known is not None and known.function.__module__ != function.__module__:
            raise ValueError(f"scenario {id!r} is defined twice")
        REGISTRY[id] = Scenario(id, title, paper, function)
        return function

    return register


class Context:
    """What a scenario may ask for: runs on the chosen backend, and the seed.

    Equal specs are computed once: a table and its figure, or two scenarios of a paper, share a
    run. What comes back is shared too, so its arrays are read-only.

    Parameters
    ----------
    backend
        "rust" (the compiled core) or "numpy" (`hgo_rs.reference`).
    seed
        Seed of every random stream that the scenario draws.
    module
        Another object with `simulate`, `coupled_paths` and `mean_covariance`, in place of the
        backend's module.

    Attributes
    ----------
    computed_steps : int
        Observer or path steps computed so far (runs x steps; shared results count once).
    """

    def __init__(self, backend: str = "rust", seed: int = 1, *, module: Any = None) -> None:
        if backend not in BACKENDS:
            raise ValueError(f"backend {backend!r} is not one of {', '.join(BACKENDS)}")
        self.backend = backend
        self.seed = seed
        self.computed_steps = 0
        self._module = module
        self._memo: dict[bytes, dict[str, Any]] = {}

    def simulate(self, spec: Mapping[str, Any]) -> dict[str, Any]:
        """Plant, noise and observer over many runs; see `hgo_rs.reference.simulate`."""
        return self._call("simulate", spec)

    def run(self, plant: System, observer: Observer, **arguments: Any) -> SimulationResult:
        """The same from the arguments of `hgo_rs.simulate`, its result by names."""
        from hgo_rs.simulation.experiment import planned, result_of

        experiment = planned(plant=plant, observer=observer, **arguments)
        return result_of(self.simulate(experiment.spec), experiment)

    def coupled_paths(self, spec: Mapping[str, Any]) -> dict[str, Any]:
        """Two discretisations of a stochastic plant on the same Brownian paths."""
        return self._call("coupled_paths", spec)

    def mean_covariance(self, spec: Mapping[str, Any]) -> dict[str, Any]:
        """Exact mean and covariance of a linear error recursion."""
        return self._call("mean_covariance", spec)

    def _call(self, name: str, spec: Mapping[str, Any]) -> dict[str, Any]:
        key = spec_key(name, spec)
        if key not in self._memo:
            if self._module is None and (self.backend, name) == ("rust", "simulate"):
                from hgo_rs.simulation.experiment import execute

                result = dict(execute(dict(spec), "rust"))  # by the engine that suits it
            else:
                module = self._module or importlib.import_module(BACKENDS[self.backend])
                result = dict(getattr(module, name)(dict(spec)))
            _freeze(result)
            self._memo[key] = result
            self.computed_steps += _steps_of(spec)
        return dict(self._memo[key])


BACKENDS = {"rust": "hgo_rs._core", "numpy": "hgo_rs.reference"}


def spec_key(name: str, spec: Mapping[str, Any]) -> bytes:
    """A hash of a call: equal for equal specs, whatever the key order or the kind of sequence."""
    digest = hashlib.sha256(name.encode())
    _feed(digest.update, spec)
    return digest.digest()


def _feed(update: Callable[[bytes], None], value: Any) -> None:
    if isinstance(value, Mapping):
        update(b"{")
        for key in sorted(value):
            update(repr(key).encode())
            _feed(update, value[key])
        update(b"}")
    elif value is None or isinstance(value, (bool, np.bool_, str)):
        update(repr(value if isinstance(value, str) or value is None else bool(value)).encode())
    elif (array := _as_numbers(value)) is not None:
        update(repr(array.shape).encode())
        update(array.tobytes())
    elif isinstance(value, (list, tuple, np.ndarray)):
        update(b"[%d" % len(value))
        for item in value:
            _feed(update, item)
        update(b"]")
    elif isinstance(value, int):  # beyond 64 bits
        update(repr(value).encode())
    else:
        raise TypeError(f"a spec holds numbers, strings, arrays and dicts, got {value!r}")


def _as_numbers(value: Any) -> np.ndarray | None:
    """Numbers of any shape as float64 (integers that it cannot hold stay integers), else None."""
    try:
        array = np.asarray(value)
    except ValueError:  # ragged
        return None
    if array.dtype.kind not in "iuf":
        return None
    as_float = np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)
    if array.dtype.kind in "iu" and array.size and np.abs(as_float).max() >= 2.0**53:
        return array
    return as_float


def _freeze(value: Any) -> None:
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, dict):
        for item in value.values():
            _freeze(item)
    elif isinstance(value, (list, tuple)):
        for item in value:
            _freeze(item)


def _steps_of(spec: Mapping[str, Any]) -> int:
    """runs x steps, as far as the spec states them."""
    if "coarse" in spec:
        return int(spec.get("runs", 1)) * int(spec["coarse"]) * int(spec.get("fine", 1))
    return int(spec.get("runs", 1)) * int(spec.get("steps", 0))
