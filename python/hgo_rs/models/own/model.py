"""A user's own model of a system, for an observer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.grammar import unknown
from hgo_rs.expressions.nodes import Node
from hgo_rs.models.own import analysis
from hgo_rs.models.own import unknowns as unknowns_of
from hgo_rs.models.own.analysis import Box, checked_box
from hgo_rs.models.own.base import OwnSystem, written
from hgo_rs.models.own.forms import form_of
from hgo_rs.models.own.names import Names
from hgo_rs.models.own.plant import Plant
from hgo_rs.models.own.sources import Arguments, Group, read_group
from hgo_rs.models.own.unknowns import Slopes

Array = npt.NDArray[np.float64]


class Model(OwnSystem):
    """A model of your own system, for an observer.

    One of six forms; y is the measured output and t the time [s]:

    - phase-variable: x_1' = x_2, ..., x_n' = phi(t, x, u), y = x_1.
    - chains, one for each output: the same with orders n_1, n_2, ... and phi_1(t, x, u),
      phi_2(t, x, u), ... of the states of all chains (block-triangular form).
    - triangular: x_i' = x_{i+1} + f_i(t, x_1 ... x_i, u), y = x_1: f_i comes beside the chain.
    - nonlinear chain: the same with an f_i of x_{i+1} too, of which x_{i+1} + f_i has a slope that
      keeps its sign. Farza, M'Saad and Rossignol, Automatica 40 (2004) 135.
    - sampled-data, Fu, Kang and Li (5): x' = f(t, x, u), corrected by K_T(t, x, u, y, T) at each
      sample; y = h(x).
    - strict-feedback, Katayama (1): x' = f1(x) + g(x) z, z' = f2(t, x, z, u), y = x.

    Parameters
    ----------
    states : list of names
        In order, chain by chain. In strict-feedback form the measured x, then z: as many x as f1
        has entries.
    inputs : list of names, optional
    parameters : dict of name -> value, optional
        Constants that have names, see `with_parameters`.
    phi, f, h, K_T, f1, f2 : expressions
        Strings in the grammar of `hgo_rs.expressions`, numbers, SymPy expressions, or callables:
        f(t, x, u), or f(t, x, u, p) with the parameters p["M"] or p.M; K_T(t, x, u, y, T);
        f1, g, f2(t, x, z, u). Lists where there are several; one callable may give all.
    orders : list of int, optional
        Orders of the chains, with as many phi; they add up to the number of states.
    unknown : name, or list of names, optional
        An unknown quantity in the last equation of a chain, such as a load torque: phi(t, x, u) may
        use the name. It becomes the last state of the chain, with rate 0 in the model, and is
        estimated in its own unit. For several chains one name each, None for a chain without one.
    box : dict of name -> (low, high), optional
        Bounds of states within which the slope of phi in an unknown, or of a nonlinear chain,
        keeps its sign. Outside, a correction uses the slope at the nearest point of the box.
    units : dict of name -> text, optional
        Units of states, unknowns and inputs, for plots, files and exported code.
    g : list of expressions
        Strict-feedback: n_x rows of n_z entries. Sampled-data: the diffusion (n), which `plant`
        uses and no observer.

    Attributes
    ----------
    compiled : bool
        False if a callable could not be traced and runs as Python; see `why_not_compiled`.

    Raises
    ------
    HgoError
        A name that is reserved, doubled or unknown (with the nearest one); a parameter that is
        not finite; an expression that cannot be read (ExpressionError, with a caret under the
        place); an f_i that depends on a state beyond x_{i+1}, with the symbol named; a g without
        full column rank; a slope of an unknown or of a nonlinear chain that may be 0, depends on t
        or an input, or is not of expressions.
    """

    def __init__(
        self,
        *,
        states: Sequence[str],
        inputs: Sequence[str] = (),
        parameters: Mapping[str, float] | None = None,
        phi: Any = None,
        orders: Sequence[int] | None = None,
        unknown: str | Sequence[str | None] | None = None,
        box: Box | None = None,
        units: Mapping[str, str] | None = None,
        f: Any = None,
        g: Any = None,
        h: Any = None,
        K_T: Any = None,
        f1: Any = None,
        f2: Any = None,
    ) -> None:
        given = {"phi": phi, "f": f, "g": g, "h": h, "K_T": K_T, "f1": f1, "f2": f2}
        unknowns = unknowns_of.names_of(unknown, orders)
        if unknowns:
            states, orders = unknowns_of.extended(states, orders, unknowns)
        names = Names.of(states, inputs, parameters)
        form = form_of(given, orders, names.states, names.inputs)
        form.carry(unknowns)
        names.leave_alone(form.taken)
        self._names, self._form = names, form
        if form.name == "sampled" and h is None:
            given["h"] = names.states[0]
        groups = [
            read_group(side, given[side], form.arguments(side), names, shape)
            for side, shape in form.sides.items()
        ]
        self._diffusion: Group | None = None
        if form.name == "sampled" and g is not None:
            self._diffusion = read_group("g", g, form.arguments("g"), names, (self.n,))
        by_name = {group.name: group for group in groups}
        form.check(by_name, names.parameters)
        self._units = unknowns_of.units_of(units, (*names.states, *names.inputs))
        chained = form.chained(by_name)
        allowed = "left out without unknown= or a nonlinear chain"
        check(bool(unknowns or chained) or not box, "box", box, allowed, "leave it out")
        self._slopes: Slopes | None = None
        if unknowns or chained:
            self._need_expressions(by_name[form.known])
            ends = checked_box(box or {}, set(names.states))
            of = names.states[1:] if chained else unknowns
            sides = chained or form.entered(by_name)
            self._slopes = Slopes(sides, of, names.states, ends, chained=bool(chained))
            self._slopes.check(names.parameters)
        slopes = None if self._slopes is None else self._slopes.table()
        self._compile(form.table_inputs(), groups, slopes)

    # --- unknowns and units ---------------------------------------------------------------------

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the unknowns, which are among the states."""
        return tuple(name for name in self._form.unknown if name)

    @property
    def sloped(self) -> bool:
        """Whether corrections are divided by slopes: of an unknown, or of a nonlinear chain."""
        return self._slopes is not None

    @property
    def units(self) -> dict[str, str]:
        """Units of states and inputs, as they were given."""
        return dict(self._units)

    def unknown_slope(self, box: Box | None = None) -> dict[str, tuple[float, float]]:
        """Guaranteed bounds of the slope of the right-hand side in each unknown, or in each state
        of a nonlinear chain behind the first.

        Parameters
        ----------
        box : dict of name -> (low, high), optional
            Bounds of states; default: those of the model.

        Returns
        -------
        dict of name -> (low, high), in units of the right-hand side for one unit of the unknown.
        """
        if self._slopes is None:
            return {}
        ends = None if box is None else checked_box(box, set(self.states))
        return self._slopes.intervals(self._names.parameters, ends)

    def slopes_at(self, x: npt.ArrayLike) -> Array:
        """1 for each state, for an unknown the slope at the states x: (..., n), as x; of a
        nonlinear chain the products of the slopes.
        """
        at = np.asarray(x, dtype=float)
        out = np.ones_like(at)
        values = {**self.parameters, **{name: at[..., i] for i, name in enumerate(self.states)}}
        for name, slope in ({} if self._slopes is None else self._slopes.at(values)).items():
            out[..., self.states.index(name)] = slope
        chained = self._slopes is not None and self._slopes.chained
        return np.asarray(np.cumprod(out, axis=-1)) if chained else out

    def with_parameters(
        self, values: Mapping[str, float] | None = None, /, **named: float
    ) -> Model:
        """The same model with other values of some parameters; refused if the slope in an unknown
        could then be 0."""
        new = super().with_parameters(values, **named)
        new.__dict__.pop("own_slope", None)  # it is of the old values
        if new._slopes is not None:
            new._slopes.check(new._names.parameters)
        return new

    # --- other systems made of it -------------------------------------------------------------

    def with_inputs(self, values: Mapping[str, Any] | None = None, /, **named: Any) -> Model:
        """The same model with expressions of t and the parameters in place of some inputs.

        An observer with this model has the input as a function of time, as a simulation without a
        feedback needs it.

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
        units = {name: unit for name, unit in self._units.items() if name not in new}
        left = {"inputs": [name for name in self.inputs if name not in new], "units": units}
        sides = {name: nodes.replaced(side, new) for name, side in self._all_sides().items()}
        return Model(**{**self.named_arguments(), **left, **sides})

    def plant(self, *, diffusion: Any = None) -> Plant:
        """The system as a plant to simulate; a feedback gives its inputs.

        Parameters
        ----------
        diffusion : n expressions, optional
            Default: g of the sampled-data form, else none.

        Raises
        ------
        HgoError
            A model with several outputs, or not compiled.
        """
        if len(self.outputs) > 1:
            remedy = "give hgo_rs.Plant the equations, with one output"
            raise HgoError(explain("outputs", list(self.outputs), "one", remedy))
        sides = self._all_sides()
        if diffusion is None and self.form == "sampled":
            diffusion = sides.get("g")
        return Plant(
            states=self.states,
            inputs=self.inputs,
            parameters=self.parameters,
            drift=self.drift,
            diffusion=diffusion,
            output=self.outputs[0],
        )

    # --- what it is ---------------------------------------------------------------------------

    @property
    def form(self) -> str:
        """One of "phase", "chains", "triangular", "nonlinear-chain", "sampled" and
        "strict-feedback".
        """
        return self._form.name

    @property
    def orders(self) -> tuple[int, ...]:
        """Orders of the chains; empty for the other forms."""
        return self._form.orders

    @property
    def n_x(self) -> int:
        """Measured states of the strict-feedback form; 0 for the other forms."""
        return self._form.n_x

    @property
    def order(self) -> int:
        """Order that an observer must have: n; for the strict-feedback form the number of z."""
        return self.n - self.n_x

    @property
    def spec(self) -> dict[str, Any]:
        """What the core reads, read-only; "table" is None where it is not compiled."""
        units = {"units": self.units} if self._units else {}
        return self._spec(kind="own", **self._form.own, n_u=self.n_u, **units)

    @property
    def known(self) -> tuple[Node, ...]:
        """phi, f or f2."""
        return self.equations[self._form.known]

    @property
    def known_names(self) -> tuple[str, ...]:
        """phi, or f[0] ..."""
        return self._groups[self._form.known].labels(self._form.known)

    @property
    def moves(self) -> bool:
        if not self.compiled:
            return True
        moving = {"t", *self.states} - set(self.unknown)
        return not moving.isdisjoint(nodes.symbols(self.known))

    def _chains(self) -> list[tuple[int, str]]:
        """Order of each chain, and the name of its unknown, "" where it has none."""
        orders = self.orders or (self.n,)
        return list(zip(orders, self._form.unknown or ("",) * len(orders), strict=True))

    @cached_property
    def own_slope(self) -> float | None:
        if not self.compiled or self.form not in (
            *("phase", "chains", "triangular", "nonlinear-chain"),
        ):
            return None
        moved = [state for state in self.states if state not in self.unknown]
        of_chain = [order - bool(name) for order, name in self._chains()]
        own = (
            moved
            if self.form in ("triangular", "nonlinear-chain")
            else [moved[i - 1] for i in np.cumsum(of_chain)]
        )
        names = ("t", *self.states, *self.inputs)
        return analysis.own_slope(self.known, own, names, self.parameters)

    @property
    def drift(self) -> tuple[Node, ...]:
        """dx/dt, one expression a state (x, then z)."""
        return tuple(self._form.drift(self.equations))

    @property
    def outputs(self) -> tuple[Node, ...]:
        """y: x_1, or the first state of each chain, or h, or all x of the strict-feedback form."""
        return tuple(self._form.outputs(self.equations))

    def shown_equations(self) -> list[tuple[str, Node]]:
        """As for every system, and K_T where there is one."""
        more = [(f"K_T[{i}]", node) for i, node in enumerate(self.equations.get("K_T", ()))]
        return super().shown_equations() + more

    def as_arguments(self) -> dict[str, Any]:
        """The arguments of this model as plain data: Model(**model.as_arguments()) == model.
        Expressions are text, so they can be written to a file.

        Raises
        ------
        HgoError
            A model that is not compiled; an expression whose text would be too long.
        """
        shapes = {"g": (self.n,), **self._form.sides}
        sides = {
            name: written(side, name, shapes[name]) for name, side in self._all_sides().items()
        }
        return {**self.named_arguments(), **sides}

    def named_arguments(self) -> dict[str, Any]:
        given = super().named_arguments()
        if self.orders:
            given["orders"] = list(self.orders)
        if self._slopes is not None:
            given |= self._slopes.arguments(self._form.orders)
        return {**given, **({"units": self.units} if self._units else {})}

    def _all_sides(self) -> dict[str, Sequence[Node]]:
        """The right-hand sides of the table, and the diffusion."""
        sides: dict[str, Sequence[Node]] = dict(self.equations)
        if self._diffusion is not None:
            self._need_expressions(self._diffusion)
            sides["g"] = self._diffusion.nodes or ()
        return sides

    @property
    def _title(self) -> str:
        known = "".join(f", {name} unknown" for name in self.unknown)
        return f"Model in {self._form.title}, {self.n} states{known}"

    def _same(self) -> tuple[Any, ...]:
        box = self._slopes and self._slopes.box
        return (*super()._same(), self._diffusion and self._diffusion.nodes, box)
