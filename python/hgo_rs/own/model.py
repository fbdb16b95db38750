"""A user's own model of a system, for an observer."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, check_integer, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.derivative import add, mul
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.grammar import unknown
from hgo_rs.expressions.nodes import Node
from hgo_rs.own.base import OwnSystem, written
from hgo_rs.own.names import Names
from hgo_rs.own.plant import Plant
from hgo_rs.own.sources import Arguments, Group, read_group

__all__ = ["Model"]

_FORMS = {
    frozenset({"phi"}): "phase",
    frozenset({"f"}): "triangular",
    frozenset({"f", "K_T"}): "sampled",
    frozenset({"f1", "g", "f2"}): "strict-feedback",
}
_REMEDY = (
    "give phi= (phase-variable form; with orders= several chains), f= (triangular), f= and K_T= "
    "with g= and h= where wanted (sampled-data), or f1=, g= and f2= (strict-feedback)"
)


class Model(OwnSystem):
    """A system of your own, as an observer knows it.

    One of five forms; y is the measured output and t the time [s]:

    - phase-variable: x_1' = x_2, ..., x_n' = phi(t, x, u), y = x_1.
    - chains, one for each output: the same with orders n_1, n_2, ... and phi_1(t, x, u),
      phi_2(t, x, u), ... of the states of all chains (block-triangular form).
    - triangular: x_i' = x_{i+1} + f_i(t, x_1 ... x_i, u), y = x_1: f_i comes beside the chain.
    - sampled-data, Fu, Kang and Li (5): x' = f(t, x, u), corrected by K_T(t, x, u, y, T) at each
      sample; y = h(x).
    - strict-feedback, Katayama (1): x' = f1(x) + g(x) z, z' = f2(t, x, z, u), y = x.

    Parameters
    ----------
    states : list of names
        In order. Of several chains one chain after the other. In strict-feedback form x, which is
        measured, then z: as many x as f1 has entries.
    inputs : list of names, optional
    parameters : dict of name -> value, optional
        Constants that have names, see `with_parameters`.
    phi, f, h, K_T, f1, f2 : expressions
        Strings in the grammar of `hgo_rs.expressions`, numbers, SymPy expressions, or callables:
        f(t, x, u), or f(t, x, u, p) with the parameters p["M"] or p.M; K_T(t, x, u, y, T);
        f1, g, f2(t, x, z, u). Lists where there are several; one callable may give all.
    orders : list of int, optional
        Orders of the chains, with as many phi; they add up to the number of states.
    g : list of expressions
        Strict-feedback: n_x rows of n_z entries. Sampled-data: the diffusion (n), which `plant`
        uses and no observer.

    Attributes
    ----------
    form : str
        "phase", "chains", "triangular", "sampled" or "strict-feedback".
    compiled : bool
        False where a callable could not be traced: it then runs as Python, slowly; see
        `why_not_compiled`.

    Raises
    ------
    HgoError
        A name that is reserved, doubled or unknown (with the nearest one); a parameter that is
        not finite; an expression that cannot be read (ExpressionError, with a caret under the
        place); an f_i that depends on a later state, with the symbol named; a g without full
        column rank.
    """

    form: str

    def __init__(
        self,
        *,
        states: Sequence[str],
        inputs: Sequence[str] = (),
        parameters: Mapping[str, float] | None = None,
        phi: Any = None,
        orders: Sequence[int] | None = None,
        f: Any = None,
        g: Any = None,
        h: Any = None,
        K_T: Any = None,
        f1: Any = None,
        f2: Any = None,
    ) -> None:
        given = {"phi": phi, "f": f, "g": g, "h": h, "K_T": K_T, "f1": f1, "f2": f2}
        self.form = _form(given, orders)
        reserved = ("t", "y", "T") if self.form == "sampled" else ("t",)
        self._names = Names.of(states, inputs, parameters, reserved)
        self._diffusion: Group | None = None
        self.orders = _orders(orders, self.n) if orders is not None else ()
        {
            "phase": self._phase,
            "chains": self._chains,
            "triangular": self._triangular,
            "sampled": self._sampled,
            "strict-feedback": self._strict_feedback,
        }[self.form](given)

    # --- the forms ----------------------------------------------------------------------------

    def _phase(self, given: Mapping[str, Any]) -> None:
        phi = self._read("phi", given, self._txu(), ())
        self._compile(self._table_inputs(x=self.states), [("phi", phi)])

    def _chains(self, given: Mapping[str, Any]) -> None:
        phi = self._read("phi", given, self._txu(), (len(self.orders),))
        self._compile(self._table_inputs(x=self.states), [("phi", phi)], list_all=True)

    def _triangular(self, given: Mapping[str, Any]) -> None:
        f = self._read("f", given, self._txu(), (self.n,))
        _check_triangular(f, self.states)
        self._compile(self._table_inputs(x=self.states), [("f", f)])

    def _sampled(self, given: Mapping[str, Any]) -> None:
        n, arguments = self.n, self._txu()
        f = self._read("f", given, arguments, (n,))
        corrected = Arguments((*arguments.groups, ("y", None), ("T", None)))
        k_t = self._read("K_T", given, corrected, (n,))
        sources = given if given["h"] is not None else {"h": self.states[0]}
        h = self._read("h", sources, arguments, ())
        _check_output(h, self.states)
        if given["g"] is not None:
            self._diffusion = self._read("g", given, arguments, (n,))
        inputs = self._table_inputs(x=self.states, samples=("y", "T"))
        self._compile(inputs, [("f", f), ("K_T", k_t), ("h", h)])

    def _strict_feedback(self, given: Mapping[str, Any]) -> None:
        self.n_x = _length("f1", given["f1"], self.n - 1)
        x, z = self.states[: self.n_x], self.states[self.n_x :]
        every = Arguments((("t", None), ("x", x), ("z", z), ("u", self.inputs)))
        f1 = self._read("f1", given, every, (len(x),))
        g = self._read("g", given, every, (len(x), len(z)))
        f2 = self._read("f2", given, every, (len(z),))
        for group in (f1, g):
            _check_measured(group, x)
        _check_rank(g, len(x), len(z), every, self.parameters)
        self._compile(self._table_inputs(x=x, z=z), [("f1", f1), ("g", g), ("f2", f2)])

    def _read(
        self, name: str, given: Mapping[str, Any], arguments: Arguments, shape: tuple[int, ...]
    ) -> Group:
        return read_group(name, given[name], arguments, self._names, shape)

    def _txu(self) -> Arguments:
        return Arguments((("t", None), ("x", self.states), ("u", self.inputs)))

    def _table_inputs(
        self, *, x: Sequence[str], z: Sequence[str] = (), samples: Sequence[str] = ()
    ) -> dict[str, str]:
        """Symbol -> name of the table's input."""
        return {
            "t": "t",
            **{name: f"x[{i}]" for i, name in enumerate(x)},
            **{name: f"z[{i}]" for i, name in enumerate(z)},
            **{name: f"u[{i}]" for i, name in enumerate(self.inputs)},
            **{name: name for name in samples},
            **{name: name for name in self._names.parameters},
        }

    # --- other systems made of it -------------------------------------------------------------

    def with_inputs(self, values: Mapping[str, Any] | None = None, /, **named: Any) -> Model:
        """The same model with expressions of t and the parameters in place of some inputs.

        An observer of it then knows the input as a function of time, which a simulation needs.

        Raises
        ------
        HgoError
            A name that is no input; an expression of anything else; a model that is not compiled.
        """
        given = {**(values or {}), **named}
        arguments = Arguments((("t", None),))
        new: dict[str, Node] = {}
        for name, source in given.items():
            if name not in self.inputs:
                raise HgoError(unknown(name, self.inputs, "input"))
            group = read_group(name, source, arguments, self._names, ())
            self._need_expressions(group)
            new[name], *_ = group.nodes or ()
        sides: dict[str, Any] = {
            name: nodes.replaced(roots, new) for name, roots in self.equations.items()
        }
        if self._diffusion is not None:
            self._need_expressions(self._diffusion)
            sides["g"] = nodes.replaced(self._diffusion.nodes or (), new)
        return Model(
            states=self.states,
            inputs=[name for name in self.inputs if name not in new],
            parameters=self.parameters,
            orders=self.orders or None,
            **sides,
        )

    def plant(self, *, diffusion: Any = None) -> Plant:
        """The system itself, to simulate.

        Parameters
        ----------
        diffusion : n expressions, optional
            Default: g of the sampled-data form, else none.

        Raises
        ------
        HgoError
            A model with inputs (see `with_inputs`), with several outputs, or not compiled.
        """
        if self.inputs:
            remedy = f'write model.with_inputs({self.inputs[0]}="sin(t)").plant()'
            raise HgoError(explain("inputs", list(self.inputs), "expressions of t", remedy))
        if len(self.outputs) > 1:
            remedy = "give hgo_rs.Plant the equations, with one output"
            raise HgoError(explain("outputs", list(self.outputs), "one", remedy))
        if diffusion is None and self._diffusion is not None:
            self._need_expressions(self._diffusion)
            diffusion = self._diffusion.nodes
        return Plant(
            states=self.states,
            parameters=self.parameters,
            drift=self.drift,
            diffusion=diffusion,
            output=self.outputs[0],
        )

    # --- what it is ---------------------------------------------------------------------------

    orders: tuple[int, ...] = ()
    """Orders of the chains; empty for the other forms."""

    n_x: int = 0
    """Measured states of the strict-feedback form; 0 for the other forms."""

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def order(self) -> int | None:
        """Order that an observer must have: n; for the strict-feedback form the number of z."""
        return self.n - self.n_x

    @property
    def _title(self) -> str:
        words = {
            "phase": "phase-variable form",
            "chains": f"phase-variable form, {len(self.orders)} chains",
            "triangular": "triangular form",
            "sampled": "sampled-data form",
            "strict-feedback": "strict-feedback form",
        }
        return f"Model in {words[self.form]}, {self.n} states"

    @property
    def known(self) -> tuple[Node, ...]:
        """phi (1), f (n) or f2 (n_z)."""
        return self.equations[self._known_group]

    @property
    def known_names(self) -> tuple[str, ...]:
        """phi, f[0] ... or f2[0] ..."""
        name = self._known_group
        return (
            (name,)
            if self.form == "phase"
            else tuple(f"{name}[{i}]" for i in range(len(self.known)))
        )

    @property
    def _known_group(self) -> str:
        return {"phase": "phi", "chains": "phi", "strict-feedback": "f2"}.get(self.form, "f")

    @property
    def drift(self) -> tuple[Node, ...]:
        """dx/dt, one expression a state (x, then z)."""
        equations = self.equations
        chain = [nodes.symbol(name) for name in self.states]
        if self.form == "phase":
            return (*chain[1:], *equations["phi"])
        if self.form == "chains":
            rates = chain[1:] + chain[:1]
            for (_, end), phi in zip(self._spans, equations["phi"], strict=True):
                rates[end - 1] = phi
            return tuple(rates)
        if self.form == "triangular":
            return (*map(add, chain[1:], equations["f"]), equations["f"][-1])
        if self.form == "sampled":
            return equations["f"]
        z = chain[self.n_x :]
        rates = list(equations["f1"])
        for i, entry in enumerate(equations["g"]):
            rates[i // len(z)] = add(rates[i // len(z)], mul(entry, z[i % len(z)]))
        return (*rates, *equations["f2"])

    @property
    def outputs(self) -> tuple[Node, ...]:
        """y: x_1, or the first state of each chain, or h, or all x of the strict-feedback form."""
        if self.form == "sampled":
            return self.equations["h"]
        measured = [start for start, _ in self._spans] or range(max(self.n_x, 1))
        return tuple(nodes.symbol(self.states[i]) for i in measured)

    @property
    def _spans(self) -> list[tuple[int, int]]:
        """Where each chain begins and ends among the states."""
        ends = list(itertools.accumulate(self.orders))
        return list(zip([0, *ends[:-1]], ends, strict=True)) if ends else []

    def shown_equations(self) -> list[tuple[str, Node]]:
        """As for every system, and K_T where there is one."""
        more = [(f"K_T[{i}]", node) for i, node in enumerate(self.equations.get("K_T", ()))]
        return super().shown_equations() + more

    def as_arguments(self) -> dict[str, Any]:
        """What makes the same model again, as plain data: Model(**model.as_arguments()) == model.

        Expressions are text, so that it can be written to a file.

        Raises
        ------
        HgoError
            A model that is not compiled; an expression whose text would be too long.
        """
        sides = dict(self.equations)
        if self._diffusion is not None:
            self._need_expressions(self._diffusion)
            sides["g"] = self._diffusion.nodes or ()
        shown: dict[str, Any] = {
            name: [written(node, f"{name}[{i}]") for i, node in enumerate(side)]
            for name, side in sides.items()
        }
        for name in ("h", "phi") if self.form != "chains" else ("h",):
            if name in shown:
                shown[name] = shown[name][0]
        if self.form == "strict-feedback":
            n_z = self.n - self.n_x
            shown["g"] = [shown["g"][i * n_z : (i + 1) * n_z] for i in range(self.n_x)]
        orders = {"orders": list(self.orders)} if self.orders else {}
        return {**self._arguments(), **orders, **shown}

    @property
    def spec(self) -> dict[str, Any]:
        """The plain dict that the core reads; "table" is None where it is not compiled."""
        own: dict[str, Any] = {"kind": "own", "form": self.form, "n": self.n_x or self.n}
        if self.form == "chains":
            own["orders"] = list(self.orders)
        if self.form == "strict-feedback":
            own["n_z"] = self.n - self.n_x
        return self._spec(**own, n_u=self.n_u)


def _form(given: Mapping[str, Any], orders: Any) -> str:
    there = {name for name, value in given.items() if value is not None}
    core = there - {"g", "h"} if "K_T" in there else there
    form = _FORMS.get(frozenset(core))
    if form is None:
        shown = ", ".join(sorted(there)) or "nothing"
        raise HgoError(f"a model of {shown}: must be one of the five forms; {_REMEDY}")
    if orders is not None:
        check(form == "phase", "orders", orders, "given with phi alone", "leave it out")
        return "chains"
    return form


def _orders(orders: Any, n: int) -> tuple[int, ...]:
    """Checked orders of chains."""
    if isinstance(orders, str) or not isinstance(orders, Sequence):
        raise HgoError(explain("orders", orders, "a list of integers", "write orders=[2, 2]"))
    found = tuple(check_integer(value, f"orders[{i}]", least=1) for i, value in enumerate(orders))
    allowed = f"orders that add up to {n}, the number of states"
    check(sum(found) == n, "orders", list(found), allowed, "list the states chain by chain")
    return found


def _length(name: str, source: Any, most: int) -> int:
    """Number of measured states, from the length of f1."""
    if callable(source) or isinstance(source, str):
        remedy = "give f1 as a list, so that it is known how many states are measured"
        raise HgoError(explain(name, source, "a list of expressions", remedy))
    count = len(source.tolist() if hasattr(source, "tolist") else source)
    if not 1 <= count <= most:
        raise HgoError(
            f"{name} has {count} expressions: must have 1 to {most}, one for each measured state, "
            "with at least one state z left; list x, then z in states"
        )
    return count


def _check_triangular(f: Group, states: Sequence[str]) -> None:
    """f_i may use x_1 ... x_i only."""
    for i, node in enumerate(f.nodes or ()):
        for name in nodes.symbols([node]):
            if name in states[i + 1 :]:
                allowed = ", ".join(states[: i + 1])
                raise ExpressionError(
                    f"{node} depends on {name}, so that the model is not triangular: must depend "
                    f"on {allowed} only (f_i on x_1 ... x_i); reorder the states, or leave out "
                    "what the chain x_i' = x_{i+1} + f_i has already",
                    name=f"f[{i}]",
                )


def _check_measured(group: Group, x: Sequence[str]) -> None:
    """f1 and g are functions of the measured states."""
    others = {name for name in group.arguments.symbols if name not in x}
    for i, node in enumerate(group.nodes or ()):
        for name in nodes.symbols([node]):
            if name in others:
                raise ExpressionError(
                    f"{node} depends on {name}: must depend on the measured states "
                    f"{', '.join(x)} only (Katayama (1)); move the term to f2",
                    name=f"{group.name}[{i}]",
                )


def _check_output(h: Group, states: Sequence[str]) -> None:
    """An output is a function of the states, and an output that no state moves tells nothing."""
    if h.nodes is None:
        return
    used = nodes.symbols(h.nodes)
    for name in used:
        if name in h.arguments.symbols and name not in states:
            raise ExpressionError(
                f"{h.nodes[0]} depends on {name}: must depend on the states only, y = h(x)",
                name="h",
            )
    if not set(used) & set(states):
        raise ExpressionError(
            f"{h.nodes[0]} depends on no state, so that y has no relative degree: must depend on "
            f"one of {', '.join(states)}; give the measured output",
            name="h",
        )


def _check_rank(
    g: Group, rows: int, columns: int, arguments: Arguments, parameters: Mapping[str, float]
) -> None:
    """g of full column rank (A2) somewhere: else y' does not tell z."""
    rng = np.random.default_rng(0)
    call = g.call(parameters)
    points = [call(*arguments.probe(rng)).reshape(rows, columns) for _ in range(5)]
    ranks = [int(np.linalg.matrix_rank(p)) for p in points if np.isfinite(p).all()]
    if ranks and max(ranks) < columns:
        raise HgoError(
            f"g has rank {max(ranks)} at every point looked at: must have the rank {columns}, one "
            "for each state z (relative degree 1, Katayama (A2)); measure more, or leave out a z"
        )
