"""Identifiers of an export: the user's words where they are free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hgo_rs import _core
from hgo_rs.errors import HgoError
from hgo_rs.exports.names import Names
from hgo_rs.exports.traced import model_of
from hgo_rs.observers import Observer
from hgo_rs.observers.online import EKF, is_one_filter

__all__ = [
    "ELAPSED",
    "SINCE",
    "UNUSED",
    "Words",
    "memory_words",
    "parameters_of",
    "words_of",
]

ELAPSED = "time that the next correction is for, s"
SINCE = "time since that sample, s"
UNUSED = "not used"
"""Of entries of a memory that an export leaves out."""


@dataclass(frozen=True)
class Words:
    """Identifiers: the user's words where they are free."""

    memory: tuple[str, ...]
    samples: tuple[str, ...]
    controls: tuple[str, ...]
    parameters: tuple[str, ...]
    started: str
    """Whether a sample was taken, which current timing knows."""
    renamed: tuple[str, ...]
    """What is told of the user's words that could not stay."""


def words_of(observer: Observer, names: Names | None = None, counted: Sequence[int] = ()) -> Words:
    """Identifiers of memory, samples, inputs and parameters; of times that are `counted`, of the
    counts.
    """
    names = Names() if names is None else names
    memory = [
        word.replace("elapsed", "periods") if i in counted else word
        for i, (word, _) in enumerate(memory_words(observer))
    ]
    controls = _controls(observer)
    parameters = [word for word, _ in parameters_of(observer.spec)]
    n, n_u, n_p = observer.n, len(controls), len(parameters)
    samples = ["y"] if observer.n_y == 1 else _numbered("y", observer.n_y)
    users = [("state", word) for word in memory[:n]]
    users += [("input", word) for word in controls]
    users += [("parameter", word) for word in parameters]
    ours = [("memory", word) for word in [*memory[n:], "started"]]
    ours += [("sample", word) for word in samples]
    found = names.several([(word, role) for role, word in users + ours])
    renamed = [
        f"{role} {word} is called {new}"
        for (role, word), new in zip(users, found, strict=False)
        if new != word
    ]
    rest = found[n + n_u + n_p :]
    at = len(memory) - n
    return Words(
        (*found[:n], *rest[:at]),
        tuple(rest[at + 1 :]),
        tuple(found[n : n + n_u]),
        tuple(found[n + n_u : n + n_u + n_p]),
        rest[at],
        tuple(renamed),
    )


def _numbered(word: str, count: int) -> list[str]:
    return [f"{word}{i + 1}" for i in range(count)]


def _own_names(spec: Mapping[str, Any]) -> Mapping[str, Sequence[str]]:
    """The user's names of states, inputs and parameters."""
    return dict(model_of(spec).get("names") or {})


def parameters_of(spec: Mapping[str, Any]) -> list[tuple[str, float]]:
    model = model_of(spec)
    if model.get("kind") != "own":
        return []
    values = [float(value) for value in model.get("parameters", ())]
    return list(zip(_own_names(spec).get("parameters", ()), values, strict=True))


OF_GAIN = {
    "adaptive": ("r", "gain"),
    "dead-zone": ("r", "gain"),
    "switched": ("quiet", "time since the last large innovation, s"),
    "prescribed-time": ("clock", "time since the start, s"),
    "innovation": ("theta", "gain"),
}
"""What gain laws remember."""


def memory_words(observer: Observer) -> list[tuple[str, str]]:
    """A name and a meaning for every entry of the memory.

    Raises
    ------
    HgoError
        A law whose memory has another number of entries.
    """
    words, count = _memory_words(observer), len(observer.memory)
    if len(words) != count:
        told = f"{len(words)} names for {count} entries of the memory"
        raise HgoError(f"kind = {observer.spec['kind']!r} cannot be exported: {told}")
    return words


def _memory_words(observer: Observer) -> list[tuple[str, str]]:
    n, spec = observer.n, observer.spec
    states = list(_own_names(spec).get("states", ()))
    if len(states) < n:
        states = _numbered("z" if spec["kind"] == "reduced-order" else "x", n)
    states = states[-n:]
    units = model_of(spec).get("units") or {}
    told = {word: f", {units[word]}" if word in units else "" for word in states}
    words = [(word, f"estimate of {word}{told[word]}") for word in states]
    count = len(observer.memory) - n
    if spec["kind"] == "reduced-order":
        n_y, n_u = observer.n_y, observer.n_u
        words += [(f"last_{word}", "last sample") for word in _numbered("y", n_y)]
        words += [(f"held_{word}", "input since then") for word in _numbered("u", n_u)]
        unused = len(observer.memory) - 2 - len(words)
        words += [(word, UNUSED) for word in _numbered("unused", unused)]
        return [*words, ("elapsed", SINCE), ("period", "length of the period since then, s")]
    if spec["kind"] != "chains":
        return words + _rest_of(spec, states, count)
    if is_one_filter(spec):  # one covariance of all chains, then a time of each output
        rest = _rest_of(spec["observers"][0], states, count - observer.n_y + 1)[:-1]
        return words + rest + [(word, ELAPSED) for word in _numbered("elapsed_", observer.n_y)]
    for i, chain in enumerate(spec["observers"], start=1):
        of_chain, states = states[: chain["n"]], states[chain["n"] :]
        rest = _rest_of(chain, of_chain, _core.Observer(chain).memory_len - chain["n"])
        words += [(f"{word}_{i}", f"{meaning} (output {i})") for word, meaning in rest]
    return words


def _rest_of(spec: Mapping[str, Any], states: Sequence[str], count: int) -> list[tuple[str, str]]:
    """The entries, `count` in number, that a continuous law remembers behind its estimates."""
    words = [
        (f"d{j}", f"residual of the sample {j} periods old") for j in range(spec.get("window", 0))
    ]
    if spec["kind"] in ("low-power", "peaking-free"):
        words += [(f"eta_{word}", f"auxiliary state, follows {word}") for word in states[1:]]
    if spec["kind"] == EKF:
        n = len(states)
        words += [(f"z{n + i + 1}", "auxiliary state") for i in range(n * (n + 1) // 2)]
    gain = spec.get("gain")
    if isinstance(gain, Mapping) and gain["law"] in OF_GAIN:
        words.append(OF_GAIN[gain["law"]])
    threshold = [("sigma", "squared threshold of the shape")]
    threshold *= "decay" in (spec.get("shape") or ())
    last = [("elapsed", ELAPSED)] if spec.get("timing") == "current" else []
    last = threshold + last
    rest = range(len(words), count - len(last))
    return words + [(f"z{len(states) + i + 1}", "auxiliary state") for i in rest] + last


def _controls(observer: Observer) -> list[str]:
    own = _own_names(observer.spec).get("inputs")
    return list(own or (["u"] if observer.n_u == 1 else _numbered("u", observer.n_u)))
