"""Parameters of a model from a record, by the likelihood of the filter's innovations.

The parameters, R and Q are those that make the record most likely (`forward`).  Where the model
and its noises are right, the inverse of the Hessian H of -ln L is the covariance of what is found.
Innovations of real machines last, which H does not know of.  So scores s (slopes of -ln L) are
summed over stretches of the record, for the covariance of a quasi-maximum-likelihood estimate,

    H^-1 (sum over stretches of s s') H^-1       (White, Econometrica 50, 1982),

or H^-1, whichever says the larger standard error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, check_choice, explain
from hgo_rs.markup import table
from hgo_rs.models import Model
from hgo_rs.observers.whiteness import whiteness
from hgo_rs.smoothing.forward import Forward, forward
from hgo_rs.smoothing.likelihood import noises
from hgo_rs.smoothing.motion import Motion
from hgo_rs.smoothing.samples import Array, Given, Samples

_STRETCHES = 24
_STEP = 1e-3  # of a parameter, for a first derivative
_TRIES = 6  # of a step of the Hessian
_ROUNDS = 4  # of the search, each in units of the last
_SETTLED = 0.2  # standard errors that a round still moves by
_FLAT = 1e-8  # of the largest curvature, which a search takes a flat way to have
_TOLD = 1e-4  # of the largest curvature where all are made alike: less, and nothing is told


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Parameters found in a record.

    Attributes
    ----------
    model : Model
        With these values.
    parameters, errors : dict of name -> float
        Values and their standard errors.
    start : dict of name -> float
        Where the search began.
    correlation : (p, p)
        Of the errors.
    R : (n_y,)
    Q : (n, n)
        As in `Smoothed`.
    log_likelihood, before : float
        ln of the density of the record, with these values and with those at the start.
    whiteness : float
        As in `Smoothed`.
    filters : int
        How many were run.
    remarks : tuple of str
    """

    model: Model
    parameters: dict[str, float]
    errors: dict[str, float]
    start: dict[str, float]
    correlation: Array = field(repr=False)
    R: Array
    Q: Array
    log_likelihood: float
    before: float
    whiteness: float
    filters: int
    remarks: tuple[str, ...] = ()

    def columns(self) -> dict[str, Any]:
        """Parameter, value, standard error, start."""
        return {
            "parameter": list(self.parameters),
            "value": list(self.parameters.values()),
            "error": list(self.errors.values()),
            "start": list(self.start.values()),
        }

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of `columns`, indexed by parameter. Needs the extra `data`."""
        from hgo_rs.errors import need

        pd = need("pandas", "a table needs pandas", "data")
        return pd.DataFrame(self.columns()).set_index("parameter")

    def __repr__(self) -> str:
        found = (f"{k} = {v:.4g} ± {self.errors[k]:.2g}" for k, v in self.parameters.items())
        return f"Fit({', '.join(found)})"

    def _repr_html_(self) -> str:
        """Each parameter with its standard error."""
        rows = [
            (name, f"{value:.6g}", f"{error:.3g}", f"{start:.6g}")
            for name, value, error, start in zip(*self.columns().values(), strict=True)
        ]
        return table("Fit", rows, ["parameter", "value", "std. error", "start"])

    def __str__(self) -> str:
        wide = max(len(name) for name in self.parameters)
        lines = [f"{'':{wide}s} {'value':>12s} {'std. error':>11s} {'start':>12s}"]
        for name, value in self.parameters.items():
            error, start = self.errors[name], self.start[name]
            lines.append(f"{name:{wide}s} {value:12.6g} {error:11.3g} {start:12.6g}")
        gained = self.log_likelihood - self.before
        lines.append(f"ln likelihood {self.log_likelihood:.6g}, {gained:+.4g} by the fit")
        lines.append(f"innovation white: {self.whiteness:.2g}")
        return "\n".join([*lines, *self.remarks])


def fit(
    model: Model,
    log: Given,
    parameters: Sequence[str] | None = None,
    *,
    R: Any = None,
    Q: Any = None,
    progress: Callable[[int], None] | None = None,
) -> Fit:
    """Parameters of a model from a record, by maximum likelihood, with standard errors.

    Parameters
    ----------
    model : Model
        As in `smooth`; the search starts at its values.
    log : Log, frame, (t, y) or (t, y, u)
        As in `smooth`.
    parameters : names, optional
        Parameters to estimate. Default: all.
    R, Q : optional
        As in `smooth`; by default estimated with the parameters.
    progress : callable, optional
        Called with the number of filters run so far.

    Raises
    ------
    HgoError
        Errors of `smooth`; an unknown parameter; a parameter that the record does not determine.

    Warns
    -----
    TurnWarning
        As `smooth`.
    """
    from scipy.optimize import minimize

    remedy = "write Model(..., parameters={...})"
    fits = isinstance(model, Model) and bool(model.parameters)
    check(fits, "model", model, "a Model with parameters", remedy)
    listed = parameters is None or (
        isinstance(parameters, Sequence) and not isinstance(parameters, str)
    )
    remedy = f'write ["{next(iter(model.parameters))}"]'
    check(listed, "parameters", parameters, "a list of names", remedy)
    names = tuple(model.parameters if parameters is None else parameters)
    check(len(names) > 0, "parameters", parameters, "one name or more", "name some")
    for name in names:
        check_choice("parameters", name, tuple(model.parameters))
    motion = Motion(model)
    samples = Samples.of(log, len(motion.orders), motion.n_u)
    samples.warn_of_turns(stacklevel=2)
    given_r = None if R is None else motion.variances(R)
    given_q = None if Q is None else motion.intensity(Q)
    remarks: list[str] = []
    tried = 0

    def count(more: int = 0) -> None:
        nonlocal tried
        tried += 1
        if progress is not None:
            progress(tried)

    r0, q0 = noises(motion, samples, given_r, given_q, remarks.append, lambda _: count())
    start = np.array([model.parameters[name] for name in names])
    # a parameter that is 0 at the start has no size of its own
    scale = np.where(start != 0.0, np.abs(start), 1.0)
    last = list(motion.last)
    free_r = len(r0) if given_r is None else 0
    free_q = len(last) if given_q is None and np.all(np.diag(q0)[last] > 0.0) else 0

    def values(z: Array) -> tuple[dict[str, float], Array, Array]:
        """Parameters, R and Q of what is searched."""
        found = dict(zip(names, (start + scale * z[: len(names)]).tolist(), strict=True))
        rest = z[len(names) :]
        r = r0 * np.exp(rest[:free_r]) if free_r else r0
        q = q0.copy()
        if free_q:
            q[last, last] = q0[last, last] * np.exp(rest[free_r:])
        return found, r, q

    def filtered(z: Array) -> Forward | None:
        count()
        found, r, q = values(z)
        try:
            with np.errstate(all="ignore"):
                return forward(Motion(model.with_parameters(found)), samples, r, q)
        except HgoError:
            return None

    def loss(z: Array) -> float:
        """-ln L; where the filter diverges, far more than any that does not."""
        known = filtered(z)
        value = math.inf if known is None else 0.5 * known.loss
        return value if math.isfinite(value) else worst

    z = np.zeros(len(names) + free_r + free_q)
    worst = math.inf
    before = loss(z)
    if not math.isfinite(before):
        told = "near enough for the filter to follow the record"
        raise HgoError(explain("parameters", dict(model.parameters), told, "start nearer"))
    worst = before + 10.0 * len(samples.t)
    basis = np.diag(_steps(loss, z, np.full(len(z), _STEP)))
    for _ in range(_ROUNDS):
        origin = z

        def along(w: Array, origin: Array = origin, basis: Array = basis) -> float:
            return loss(origin + basis @ w)

        step = {"eps": 0.05, "gtol": 0.05}
        found = minimize(along, np.zeros(len(z)), method="BFGS", options=step)
        z = origin + basis @ found.x
        basis = np.diag(_steps(loss, z, np.diag(basis)))
        basis = _whitened(loss, z, basis)
        if float(np.max(np.abs(np.linalg.solve(basis, z - origin)))) < _SETTLED:
            break
    hessian = _hessian(loss, z, basis)
    covariance = _covariance(filtered, z, basis, hessian, names)
    size = np.sqrt(np.diag(covariance))
    known = filtered(z)
    assert known is not None
    at, r, q = values(z)
    used = known.count > 0.0
    standard = np.sqrt(known.squares[used] / known.count[used])
    standard = np.copysign(standard, known.innovation[used, 0])
    p = len(names)
    return Fit(
        model=model.with_parameters(at),
        parameters=at,
        errors=dict(zip(names, (size[:p] * scale).tolist(), strict=True)),
        start=dict(zip(names, start.tolist(), strict=True)),
        correlation=(covariance / np.outer(size, size))[:p, :p],
        R=r,
        Q=q,
        log_likelihood=-0.5 * known.loss,
        before=-before,
        whiteness=whiteness(standard),
        filters=tried,
        remarks=tuple(remarks),
    )


def _steps(loss: Callable[[Array], float], z: Array, steps: Array) -> Array:
    """Steps by which -ln L rises by about 1/2: standard errors of each, the others held."""
    here, out = loss(z), np.abs(steps)
    for i in range(len(z)):
        for _ in range(_TRIES):
            e = np.zeros(len(z))
            e[i] = out[i]
            rise = 0.5 * (loss(z + e) + loss(z - e)) - here
            if 0.1 <= rise <= 2.5:
                break
            factor = math.sqrt(0.5 / rise) if rise > 0.0 else 30.0
            out[i] *= min(max(factor, 1e-3), 30.0)
    return out


def _hessian(loss: Callable[[Array], float], z: Array, basis: Array) -> Array:
    """Of -ln L along the columns of a basis, by central differences."""
    n, here = len(z), loss(z)
    out = np.empty((n, n))
    moves = basis.T
    for i in range(n):
        out[i, i] = loss(z + moves[i]) + loss(z - moves[i]) - 2.0 * here
        for j in range(i):
            both, apart = moves[i] + moves[j], moves[i] - moves[j]
            mixed = loss(z + both) + loss(z - both) - loss(z + apart) - loss(z - apart)
            out[i, j] = out[j, i] = 0.25 * mixed
    return out


def _whitened(loss: Callable[[Array], float], z: Array, basis: Array) -> Array:
    """A basis along which -ln L rises alike, each way by itself: differences tell the more of what
    is found together.
    """
    size, ways = np.linalg.eigh(_hessian(loss, z, basis))
    size = np.maximum(size, _FLAT * size[-1])
    return basis @ ways / np.sqrt(size)


def _covariance(
    filtered: Callable[[Array], Forward | None],
    z: Array,
    basis: Array,
    hessian: Array,
    names: Sequence[str],
) -> Array:
    """Of the errors of z."""
    size, ways = np.linalg.eigh(hessian)
    if not size[0] > _TOLD * size[-1]:
        weak = np.abs(basis @ ways[:, 0])[: len(names)]
        name = names[int(np.argmax(weak))]
        told = "determined by the record, separately from the other parameters"
        raise HgoError(explain("parameters", name, told, "leave it out, or excite the system more"))
    inverse = np.linalg.inv(hessian)
    scores = []
    for move in basis.T:
        ends = [filtered(z + move), filtered(z - move)]
        both = [0.5 * (one.squares + one.log_det) for one in ends if one is not None]
        if len(both) < 2:
            return np.asarray(basis @ inverse @ basis.T)
        scores.append(0.5 * (both[0] - both[1]))
    stretches = np.array_split(np.array(scores), _STRETCHES, axis=1)
    sums = np.array([stretch.sum(axis=1) for stretch in stretches])
    sums = sums - sums.mean(axis=0)
    outer = sums.T @ sums * _STRETCHES / (_STRETCHES - 1.0)
    robust = inverse @ outer @ inverse
    larger = robust if np.trace(robust) > np.trace(inverse) else inverse
    return np.asarray(basis @ larger @ basis.T)
