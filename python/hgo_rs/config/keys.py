"""What may stand in an `observer.toml`: keys, their types, and the classes that they name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hgo_rs.errors import HgoError
from hgo_rs.laws import LAWS

FORMAT = 1
"""The format of `observer.toml` that this version reads and writes."""

_CLASSES = {
    "standard": "StandardObserver",
    "low-power": "LowPowerObserver",
    "peaking-free": "PeakingFreeObserver",
    "high-gain-ekf": "HighGainEKF",
    "collection": "RepelledCollection",
    "modified": "ModifiedObserver",
    "sampled-data": "SampledDataObserver",
    "reduced-order": "ReducedOrderObserver",
    "window": "WindowObserver",
}
OBSERVERS = {
    **{kind: _CLASSES.get(kind, "HighGainObserver") for kind in LAWS},
    "chains": "MultiOutputObserver",
}
"""The structures, and the class of hgo_rs behind each name."""


class ConfigError(HgoError):
    """A configuration that is refused: names the file, the line and the remedy."""


Kind = tuple[Callable[[Any], bool], str]


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _all(value: Any, holds: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(map(holds, value))


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_pole(value: Any) -> bool:
    return is_number(value) or (_all(value, is_number) and len(value) == 2)


NUMBER: Kind = (is_number, "a number")
INTEGER: Kind = (lambda v: isinstance(v, int) and not isinstance(v, bool), "an integer")
FLAG: Kind = (lambda v: isinstance(v, bool), "true or false")
TEXT: Kind = (_is_text, 'text in quotes, such as "a"')
NUMBERS: Kind = (lambda v: _all(v, is_number), "numbers in brackets, such as [1.0, 2.0]")
COEFFICIENTS: Kind = (lambda v: v == [] or NUMBERS[0](v), NUMBERS[1])
"""Of a law, which says how many: none of the filters of a cascade of order 2."""
TEXTS: Kind = (lambda v: _all(v, _is_text), 'texts in brackets, such as ["a", "b"]')
ROWS: Kind = (
    lambda v: _all(v, lambda row: _is_text(row) or _all(row, _is_text)),
    'texts, or rows of them, in brackets, such as [["a", "b"], ["c", "d"]]',
)
TABLE: Kind = (lambda v: isinstance(v, dict), "a table")
TABLES: Kind = (lambda v: _all(v, lambda t: isinstance(t, dict)), "tables, one [[...]] for each")
INTEGERS: Kind = (lambda v: _all(v, INTEGER[0]), "integers in brackets, such as [2, 1]")
POLES: Kind = (
    lambda v: _all(v, _is_pole),
    "numbers, or pairs [real, imaginary], in brackets, such as [-1.0, [-2.0, 1.0], [-2.0, -1.0]]",
)
NUMBER_OR_NUMBERS: Kind = (lambda v: NUMBER[0](v) or NUMBERS[0](v), "a number or numbers")
TEXT_OR_TEXTS: Kind = (lambda v: TEXT[0](v) or TEXTS[0](v), 'text, or texts such as ["a", "b"]')
NAMED_NUMBERS: Kind = (
    lambda v: isinstance(v, dict) and all(map(is_number, v.values())),
    "named numbers, such as { M = 2.0 }",
)
NAMED_TEXTS: Kind = (
    lambda v: isinstance(v, dict) and all(isinstance(text, str) for text in v.values()),
    'named texts, such as { q = "rad" }',
)
RANGES: Kind = (
    lambda v: isinstance(v, dict) and all(NUMBERS[0](ends) for ends in v.values()),
    "named ranges, such as { q = [-1.0, 1.0] }",
)
GAIN: Kind = (
    lambda v: is_number(v) or isinstance(v, (str, dict)),
    'a number [1/s], or a law such as { law = "adaptive", p1 = 1.0, p2 = 1.0, b = 0.1 }',
)

LISTS = [name for law in LAWS.values() if law.continuous for name, _ in law.coefficients]
"""Lists of coefficients, of all laws."""

TOP: dict[str, Kind] = {
    "format": INTEGER,
    "observer": TEXT,
    "order": INTEGER,
    "gain": GAIN,
    "epsilon": NUMBER,
    "theta": NUMBER,
    "shape": TABLE,
    "poles": POLES,
    **{law.size[0]: INTEGER for law in LAWS.values() if law.size},
    **dict.fromkeys(LISTS, COEFFICIENTS),
    **dict.fromkeys(("Q", "R", "P0"), NUMBER_OR_NUMBERS),
    "h_bar": NUMBERS,
    "window": INTEGER,
    "W": NUMBERS,
    "dt": NUMBER,
    "saturation": NUMBER_OR_NUMBERS,
    "clip": TEXT,
    "method": TEXT,
    "motion": TEXT,
    "substeps": INTEGER,
    "timing": TEXT,
    "wrap": NUMBER_OR_NUMBERS,
    "allow_unstable": FLAG,
    "observers": TABLES,
    "model": TABLE,
    "start": TABLE,
    "log": TABLE,
}
"""The keys at the head of the file. From `order` to `allow_unstable` they are the arguments of the
observer's class; `order` is its n. `observers` are those of a model of several chains, each with
keys as at the head. What a file leaves open is as in the class."""

GAINS: dict[str, tuple[str, dict[str, Kind]]] = {
    "constant": ("ConstantGain", {"ell": NUMBER}),
    "adaptive": ("AdaptiveGain", {"p1": NUMBER, "p2": NUMBER, "b": NUMBER}),
    "dead-zone": ("DeadZoneGain", {"p1": NUMBER, "p2": NUMBER, "b": NUMBER}),
    "homogeneous": ("HomogeneousGain", {"rho": NUMBER, "degree": NUMBER, "mu": NUMBER}),
    "switched": (
        "SwitchedGain",
        {"fast": NUMBER, "slow": NUMBER, "zone": NUMBER, "delay": NUMBER},
    ),
    "prescribed-time": (
        "PrescribedTimeGain",
        {"mu0": NUMBER, "deadline": NUMBER, "r_max": NUMBER},
    ),
    "innovation": (
        "InnovationGain",
        {
            **dict.fromkeys(("most", "rise", "fall", "threshold", "slope"), NUMBER),
            "samples": INTEGER,
        },
    ),
}
"""`gain = { law = ... }`: the class behind each law, and its keys."""

_THRESHOLD = {"decay": NUMBER, "growth": NUMBER, "sigma0": NUMBER}
SHAPES: dict[str, tuple[str, dict[str, Kind]]] = {
    "stubborn": ("Stubborn", _THRESHOLD),
    "dead-zone": ("DeadZone", _THRESHOLD),
    "piecewise-linear": ("PiecewiseLinear", {"ratio": NUMBER, "zone": NUMBER}),
    "fal": ("Fal", {"alpha": NUMBERS, "delta": NUMBER}),
    "bi-homogeneous": (
        "BiHomogeneous",
        {"near": NUMBER, "far": NUMBER, "kappa": NUMBERS, "theta": NUMBERS},
    ),
}
"""`shape = { law = ... }`, the same."""

OPTIONAL = ("sigma0", "mu", "delay")
"""Keys of a law that may be left out."""

MODELS: dict[str, tuple[str, dict[str, Kind]]] = {
    "unknown": ("Unknown", {}),
    "input": ("InputGain", {"b0": NUMBER}),
    "lee": ("Lee", {}),
    "sanfelice-praly": ("SanfelicePraly", {"nu1": NUMBER, "nu2": NUMBER}),
    "van-der-pol": ("VanDerPol", {"epsilon": NUMBER, "sigma": NUMBER, "multiplicative": FLAG}),
    "crackle": ("Crackle", {"phi_max": NUMBER}),
    "ship": ("Ship", {"delta": NUMBER, "w": NUMBERS}),
    "own": (
        "Model",
        {
            "states": TEXTS,
            "inputs": TEXTS,
            "parameters": NAMED_NUMBERS,
            "orders": INTEGERS,
            "unknown": TEXT_OR_TEXTS,
            "box": RANGES,
            "units": NAMED_TEXTS,
            "phi": TEXT_OR_TEXTS,
            "f": TEXTS,
            "f1": TEXTS,
            "g": ROWS,
            "f2": TEXTS,
            "h": TEXT,
            "K_T": TEXTS,
        },
    ),
}
"""`[model]`: the class behind each `kind`, and its keys. A table without `kind` is an own model."""

START: dict[str, Kind] = {
    "x_hat": NUMBERS,
    "r": NUMBER,
    "memory": NUMBERS,
    "t": NUMBER,
    "from": TEXT,
}
"""`[start]`: estimate and gain to start from, or the whole memory; of one in use, its time; or,
`from` = "first-sample" or "zero", where a run over a log begins.
"""

LOG: dict[str, Kind] = {
    "time": TEXT_OR_TEXTS,
    "output": TEXT_OR_TEXTS,
    "input": TEXT_OR_TEXTS,
    "dt": NUMBER,
    "unit": TEXT_OR_TEXTS,
    "resets": TEXT,
    "unwrap": NAMED_NUMBERS,
    "scale": NAMED_NUMBERS,
    "offset": NAMED_NUMBERS,
    "schedule": TABLE,
}
"""`[log]`: the arguments of `hgo_rs.logs.read_log`, and a schedule in place of times."""

SCHEDULE: dict[str, Kind] = {"alpha": NUMBER, "epsilon": NUMBER, "k0": NUMBER, "p": NUMBER}
"""`schedule = { ... }`: decreasing steps a(k) of `hgo_rs.StochasticApproximation`."""
