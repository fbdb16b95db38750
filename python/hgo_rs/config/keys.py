"""What may stand in an `observer.toml`: keys, their types, and the classes that they name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from hgo_rs.design.discrete import METHODS, MOTIONS, TIMINGS
from hgo_rs.errors import HgoError
from hgo_rs.laws import LAWS, Law
from hgo_rs.observers.listed import CLIPS
from hgo_rs.observers.records import STARTS
from hgo_rs.observers.sampled_data import GAINS as OWN_GAINS
from hgo_rs.times import RESETS, UNITS

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


class Kind(NamedTuple):
    """A type of value: whether one is of it, how it is written, and its JSON Schema."""

    holds: Callable[[Any], bool]
    wanted: str
    schema: Mapping[str, Any]


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _list(of: Kind, told: str, *, least: int = 1) -> Kind:
    """A list of values of a type."""
    return Kind(
        lambda v: isinstance(v, list) and len(v) >= least and all(map(of.holds, v)),
        told,
        {"type": "array", "items": of.schema, "minItems": least},
    )


def _names(of: Kind, told: str) -> Kind:
    """A table of values of a type, by names."""
    schema = {"type": "object", "additionalProperties": of.schema}
    return Kind(lambda v: isinstance(v, dict) and all(map(of.holds, v.values())), told, schema)


def _either(told: str, *kinds: Kind) -> Kind:
    """A value of one of several types."""
    schemas = [kind.schema for kind in kinds]
    return Kind(lambda v: any(kind.holds(v) for kind in kinds), told, {"anyOf": schemas})


def choice(known: Iterable[str]) -> Kind:
    """One of some texts; which of them, the class says that takes it."""
    return Kind(TEXT.holds, TEXT.wanted, {"enum": list(known)})


NUMBER = Kind(is_number, "a number", {"type": "number"})
INTEGER = Kind(
    lambda v: isinstance(v, int) and not isinstance(v, bool), "an integer", {"type": "integer"}
)
FLAG = Kind(lambda v: isinstance(v, bool), "true or false", {"type": "boolean"})
TEXT = Kind(lambda v: isinstance(v, str), 'text in quotes, such as "a"', {"type": "string"})
TABLE = Kind(lambda v: isinstance(v, dict), "a table", {"type": "object"})
NUMBERS = _list(NUMBER, "numbers in brackets, such as [1.0, 2.0]")
COEFFICIENTS = _list(NUMBER, NUMBERS.wanted, least=0)
"""Of a law, which says how many: none of the filters of a cascade of order 2."""
INTEGERS = _list(INTEGER, "integers in brackets, such as [2, 1]")
TEXTS = _list(TEXT, 'texts in brackets, such as ["a", "b"]')
ROWS = _list(
    _either("", TEXT, TEXTS),
    'texts, or rows of them, in brackets, such as [["a", "b"], ["c", "d"]]',
)
TABLES = _list(TABLE, "tables, one [[...]] for each")
_PAIR = Kind(
    lambda v: NUMBERS.holds(v) and len(v) == 2, "", {**NUMBERS.schema, "minItems": 2, "maxItems": 2}
)
POLES = _list(
    _either("", NUMBER, _PAIR),
    "numbers, or pairs [real, imaginary], in brackets, such as [-1.0, [-2.0, 1.0], [-2.0, -1.0]]",
)
NUMBER_OR_NUMBERS = _either("a number or numbers", NUMBER, NUMBERS)
TEXT_OR_TEXTS = _either('text, or texts such as ["a", "b"]', TEXT, TEXTS)
NAMED_NUMBERS = _names(NUMBER, "named numbers, such as { M = 2.0 }")
NAMED_TEXTS = _names(TEXT, 'named texts, such as { q = "rad" }')
RANGES = _names(NUMBERS, "named ranges, such as { q = [-1.0, 1.0] }")
_UNIT = choice(UNITS)
UNIT = Kind(TEXT_OR_TEXTS.holds, TEXT_OR_TEXTS.wanted, _either("", _UNIT, _list(_UNIT, "")).schema)
GAIN = _either(
    'a number [1/s], or a law such as { law = "adaptive", p1 = 1.0, p2 = 1.0, b = 0.1 }',
    NUMBER,
    choice(OWN_GAINS),
    TABLE,
)


def _lists(law: Law) -> list[str]:
    return [name for name, _ in law.coefficients] if law.continuous else []


LISTS = [name for law in LAWS.values() for name in _lists(law)]
"""Lists of coefficients, of all laws."""

TOP: dict[str, Kind] = {
    "format": INTEGER,
    "observer": choice(OBSERVERS),
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
    "clip": choice(CLIPS),
    "method": choice(METHODS),
    "motion": choice(MOTIONS),
    "substeps": INTEGER,
    "timing": choice(TIMINGS),
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
    "from": choice(STARTS),
}
"""`[start]`: estimate and gain to start from, or the whole memory; of one in use, its time; or,
`from` = "first-sample" or "zero", where a run over a log begins.
"""

LOG: dict[str, Kind] = {
    "time": TEXT_OR_TEXTS,
    "output": TEXT_OR_TEXTS,
    "input": TEXT_OR_TEXTS,
    "dt": NUMBER,
    "unit": UNIT,
    "resets": choice(RESETS),
    "unwrap": NAMED_NUMBERS,
    "scale": NAMED_NUMBERS,
    "offset": NAMED_NUMBERS,
    "schedule": TABLE,
}
"""`[log]`: the arguments of `hgo_rs.logs.read_log`, and a schedule in place of times."""

SCHEDULE: dict[str, Kind] = {"alpha": NUMBER, "epsilon": NUMBER, "k0": NUMBER, "p": NUMBER}
"""`schedule = { ... }`: decreasing steps a(k) of `hgo_rs.StochasticApproximation`."""

TOLD = {
    "format": "The format of this file.",
    "observer": 'The law; "chains" for several outputs.',
    "order": "Number of estimated states; the model's, where it has one.",
    "gain": "The gain ell [1/s], or a law of the gain.",
    "epsilon": "1/gain [s], in place of gain.",
    "theta": "Of high-gain-ekf, in place of gain.",
    "shape": "Function of the innovation that is injected.",
    "poles": "Of the error at gain 1: numbers, and pairs [re, im].",
    "window": "Samples of a window.",
    "W": "Gains of a window, row by row.",
    "dt": "Period of a window [s].",
    "saturation": "Levels of the estimates: one, or one a state.",
    "clip": "How estimates are kept below their levels.",
    "method": "Discretisation.",
    "motion": "Integration of the model over a period.",
    "substeps": "Substeps of the model in a period.",
    "timing": "Whether the estimate at a sample uses this sample (current) or earlier ones "
    "(predictor).",
    "wrap": "Length of a turn of an output that wraps, in its unit.",
    "allow_unstable": "Go beyond the step limit.",
    "observers": "Of chains: the observer of each output.",
    "model": "The model; without this table there is none.",
    "start": "Start of the estimate.",
    "log": "Columns and units of the log.",
    "Q": "Of high-gain-ekf: intensity of the model error.",
    "R": "Of high-gain-ekf: variance of the measurement noise.",
    "P0": "Of high-gain-ekf: the first covariance.",
    **{law.size[0]: f"Second size of {law.kind}." for law in LAWS.values() if law.size},
    **{
        name: "Coefficients of "
        + ", ".join(law.kind for law in LAWS.values() if name in _lists(law))
        for name in LISTS
    },
    "h_bar": "Gains of reduced-order, each in (0, 1).",
}
"""What a key at the head is, in words."""
