"""Right-hand sides as a user writes them: strings, numbers, SymPy expressions, callables.

A callable is called once with symbols. If it cannot be traced, or if what was traced gives other
numbers than the callable itself, it stays a callable.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError, UntraceableError
from hgo_rs.expressions.from_sympy import from_sympy, is_sympy
from hgo_rs.expressions.grammar import parse, unknown
from hgo_rs.expressions.nodes import Node
from hgo_rs.expressions.numeric import evaluate
from hgo_rs.expressions.printing import text
from hgo_rs.expressions.tracing import Symbolic, as_node, symbolic_vector
from hgo_rs.models.own.names import Names, Parameters

Array = npt.NDArray[np.float64]

_PROBES = 3  # points at which a trace is compared with its callable
_AGREE = 1e-9


@dataclass(frozen=True)
class Arguments:
    """What a right-hand side may use: groups of symbols, in the order a callable gets them.

    A group is ("t", None) for one symbol or ("x", names) for a vector of them.
    """

    groups: tuple[tuple[str, tuple[str, ...] | None], ...]

    @property
    def symbols(self) -> tuple[str, ...]:
        """All names."""
        found: list[str] = []
        for name, members in self.groups:
            found += [name] if members is None else members
        return tuple(found)

    @property
    def shown(self) -> str:
        """As in (t, x, u)."""
        return "(" + ", ".join(name for name, _ in self.groups) + ")"

    def symbolic(self) -> list[Any]:
        """One symbolic argument a group."""
        return [
            Symbolic(nodes.symbol(name)) if members is None else symbolic_vector(list(members))
            for name, members in self.groups
        ]

    def values(self, arguments: Sequence[Any]) -> dict[str, Any]:
        """Symbol -> value, of numeric arguments."""
        found: dict[str, Any] = {}
        for (name, members), value in zip(self.groups, arguments, strict=True):
            if members is None:
                found[name] = value
            else:
                found |= dict(zip(members, value, strict=True))
        return found

    def given(self, values: Mapping[str, float]) -> list[Any]:
        """Numeric arguments, of values by name."""
        return [
            values[name] if members is None else np.array([values[member] for member in members])
            for name, members in self.groups
        ]

    def probe(self, rng: np.random.Generator) -> list[Any]:
        """Numeric arguments at random."""
        return [
            float(rng.uniform(0.1, 1.0))
            if members is None
            else rng.uniform(-1.0, 1.0, len(members))
            for _, members in self.groups
        ]


@dataclass(frozen=True)
class Group:
    """One named right-hand side with one or several entries.

    `nodes` where all entries are expressions; else `calls`, one Python callable an entry or one for
    all, and `reason`, why it could not be compiled.
    """

    name: str
    arguments: Arguments
    shape: tuple[int, ...]
    nodes: tuple[Node, ...] | None
    calls: tuple[Callable[..., Any], ...] = ()
    reason: str = ""

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.shape)

    def labels(self, name: str) -> tuple[str, ...]:
        """What to call each entry: the name itself where there is no index."""
        return tuple(f"{name}[{i}]" for i in range(self.size)) if self.shape else (name,)

    def entries(
        self, name: str, parameters: Mapping[str, float]
    ) -> list[tuple[str, str, Callable[[Mapping[str, float]], float | None]]]:
        """For each entry its label, its text and its value for values by name, None where one is
        not given.
        """
        labels = self.labels(name)
        if self.nodes is not None:
            return [
                (label, text(node), partial(_value, node))
                for label, node in zip(labels, self.nodes, strict=True)
            ]
        called = self.call(parameters)

        def entry(i: int, known: Mapping[str, float]) -> float | None:
            if any(symbol not in known for symbol in self.arguments.symbols):
                return None
            with np.errstate(all="ignore"):
                return float(called(*self.arguments.given(known))[i])

        return [(label, "a Python function", partial(entry, i)) for i, label in enumerate(labels)]

    def call(self, parameters: Mapping[str, float]) -> Callable[..., Array]:
        """A Python function of the arguments that gives the (size,) array."""
        if self.nodes is not None:
            roots = self.nodes

            def evaluated(*arguments: Any) -> Array:
                values = {**self.arguments.values(arguments), **parameters}
                return np.array([float(v) for v in evaluate(roots, values)])

            return evaluated
        told = Parameters(parameters)
        calls = self.calls
        with_p = [_takes_parameters(call, self.arguments, self.name) for call in calls]

        def called(*arguments: Any) -> Array:
            parts = [
                call(*arguments, told) if p else call(*arguments)
                for call, p in zip(calls, with_p, strict=True)
            ]
            values = np.asarray(parts[0] if len(parts) == 1 else parts, dtype=np.float64).ravel()
            if values.shape != (self.size,):
                raise HgoError(
                    f"{self.name} gave {values.size} values: must give {self.size}; "
                    "return one for each equation"
                )
            return values

        return called


def _value(node: Node, known: Mapping[str, float]) -> float | None:
    used = nodes.symbols([node])
    if any(name not in known for name in used):
        return None
    return float(evaluate([node], {name: known[name] for name in used})[0])


def read_group(
    name: str, source: Any, arguments: Arguments, names: Names, shape: tuple[int, ...]
) -> Group:
    """The right-hand side ``name`` of ``shape`` = (), (n,) or (rows, columns)."""
    size = math.prod(shape)
    entries = _entries(name, source, shape, size)
    found: list[Node] = []
    reason = ""
    for i, entry in enumerate(entries):
        label = name if len(entries) == 1 else f"{name}[{i}]"
        if _is_callable(entry):
            wanted = size if len(entries) == 1 else 1
            traced = _trace(label, entry, arguments, names, wanted)
            if isinstance(traced, str):
                reason = traced
                break
            found += traced
        else:
            found.append(_expression(label, entry, arguments, names))
    if not reason:
        return Group(name, arguments, shape, tuple(found))
    calls = tuple(
        entry
        if _is_callable(entry)
        else _Evaluated(_expression(f"{name}[{i}]", entry, arguments, names), arguments)
        for i, entry in enumerate(entries)
    )
    return Group(name, arguments, shape, None, calls, reason)


def _is_callable(source: Any) -> bool:
    """Whether it is to be called: SymPy's symbols can be called, too, but are expressions."""
    return callable(source) and not is_sympy(source)


@dataclass(frozen=True)
class _Evaluated:
    """An expression beside callables, as a callable of the same arguments and the parameters."""

    node: Node
    arguments: Arguments

    def __call__(self, *given: Any) -> float:
        *values, parameters = given
        return float(evaluate([self.node], {**self.arguments.values(values), **parameters})[0])


def _entries(name: str, source: Any, shape: tuple[int, ...], size: int) -> list[Any]:
    """The entries, row by row; one callable may stand for all."""
    if _is_callable(source):
        return [source]
    if shape == ():
        if isinstance(source, (list, tuple)) and len(source) == 1:
            source = source[0]
        return [source]
    wanted = " by ".join(str(length) for length in shape)
    if is_sympy(source) or hasattr(source, "tolist"):  # a matrix
        listed = source.tolist() if hasattr(source, "tolist") else [source]
    else:
        listed = source
    if isinstance(listed, str) or not isinstance(listed, (list, tuple)):
        raise HgoError(explain(name, source, f"{wanted} expressions", "give a list"))
    flat: list[Any] = []
    for row in listed:
        flat += row if isinstance(row, (list, tuple)) else [row]
    if len(flat) != size:
        raise HgoError(
            f"{name} has {len(flat)} expressions: must have {wanted}; give one for each equation"
        )
    return flat


def _expression(label: str, entry: Any, arguments: Arguments, names: Names) -> Node:
    """An entry that is no callable."""
    known = {*arguments.symbols, *names.parameters}
    try:
        if isinstance(entry, str):
            return parse(entry, known)
        if is_sympy(entry):
            node = from_sympy(entry)
        elif isinstance(entry, Node):
            node = entry
        else:
            node = as_node(entry)
    except ExpressionError as error:
        raise error.of(label) from None
    return _checked(label, node, known)


def _checked(label: str, node: Node, known: set[str]) -> Node:
    for name in nodes.symbols([node]):
        if name not in known:
            raise ExpressionError(unknown(name, known), name=label)
    if node.is_condition:
        raise ExpressionError(
            "it is true or false: must be a number; write piecewise(1, condition, 0)", name=label
        )
    return node


def _takes_parameters(call: Callable[..., Any], arguments: Arguments, label: str) -> bool:
    """Whether the callable wants the parameters after its other arguments."""
    count = len(arguments.groups)
    try:
        signature = inspect.signature(call)
    except (TypeError, ValueError):  # a builtin that does not tell
        return False
    for extra in (0, 1):
        try:
            signature.bind(*range(count + extra))
        except TypeError:
            continue
        return extra == 1 or any(
            kind.kind is inspect.Parameter.VAR_POSITIONAL for kind in signature.parameters.values()
        )
    shown = arguments.shown
    raise HgoError(
        f"{label} is a callable with the signature {signature}: must take {shown}, or "
        f"{shown[:-1]}, p) with the parameters; change its arguments"
    )


def _trace(
    label: str, call: Callable[..., Any], arguments: Arguments, names: Names, size: int
) -> list[Node] | str:
    """The entries as expressions, or why there are none."""
    with_p = _takes_parameters(call, arguments, label)
    p = Parameters({name: Symbolic(nodes.symbol(name)) for name in names.parameters})
    try:
        with np.errstate(all="ignore"):
            given = call(*arguments.symbolic(), *([p] if with_p else []))
    except UntraceableError as error:
        reason = str(error)
    except ExpressionError as error:
        raise error.of(label) from None
    except Exception as error:  # whatever a callable does with symbols
        reason = f"{type(error).__name__}: {error}"
    else:
        flat = np.ravel(_objects(given))
        if len(flat) != size:
            raise HgoError(
                f"{label} gives {len(flat)} values: must give {size}; return one for each equation"
            )
        known = {*arguments.symbols, *names.parameters}
        try:
            traced = [_checked(label, as_node(value), known) for value in flat]
        except ExpressionError as error:
            raise error.of(label) from None
        doubt = _compare(label, call, with_p, traced, arguments, names)
        return doubt or traced
    _try(label, call, with_p, arguments, names)
    return reason


def _objects(given: Any) -> Any:
    """What a callable returned, as an array of objects."""
    if isinstance(given, Symbolic):
        return [given]
    if isinstance(given, (list, tuple)):
        return [part for row in given for part in np.ravel(_objects(row))]
    return np.asarray(given, dtype=object)


def _try(
    label: str, call: Callable[..., Any], with_p: bool, arguments: Arguments, names: Names
) -> None:
    """Refuse a callable that fails with numbers as well."""
    told = [Parameters(names.parameters)] if with_p else []
    try:
        with np.errstate(all="ignore"):
            call(*arguments.probe(np.random.default_rng(0)), *told)
    except Exception as error:
        raise HgoError(
            f"{label} failed with {type(error).__name__}: {error}; must be a function of "
            f"{arguments.shown} that returns numbers; correct it"
        ) from error


def _compare(
    label: str,
    call: Callable[..., Any],
    with_p: bool,
    traced: list[Node],
    arguments: Arguments,
    names: Names,
) -> str:
    """Empty if the trace gives the numbers of the callable at some points."""
    rng = np.random.default_rng(0)
    told = [Parameters(names.parameters)] if with_p else []
    for _ in range(_PROBES):
        point = arguments.probe(rng)
        try:
            with np.errstate(all="ignore"):
                want = np.ravel(np.asarray(call(*point, *told), dtype=np.float64))
        except Exception:  # no value at this point: nothing to compare
            continue
        values = {**arguments.values(point), **names.parameters}
        have = np.array([float(v) for v in evaluate(traced, values)])
        if want.shape != have.shape or not np.allclose(have, want, _AGREE, _AGREE, equal_nan=True):
            return (
                f"{label} gives other numbers when it is called again: it looks at a type, at the "
                "clock or at random numbers"
            )
    return ""
