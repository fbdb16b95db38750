"""What `tune` returns: the choice, and the trade-off behind it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs import upward
from hgo_rs.errors import HgoError, need
from hgo_rs.observers import Observer, RunResult
from hgo_rs.signals import Given, of_log
from hgo_rs.tuning.report import as_html, choice, report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]

_DRAWN = 6  # structures, those that err least


@dataclass(frozen=True, eq=False, repr=False)
class TradeOff:
    """Results of one structure at each gain `ell`, all (points,), for the wanted estimate. Refused
    gains are left out.

    Attributes
    ----------
    ell : [1/s]
    bandwidth : [rad/s]
        See `Observer.bandwidth`; infinite where it has no cutoff below the Nyquist frequency.
    settling : [s]
    peaking
        Largest error after a start with x_hat_1 wrong by 1.
    noise
        Standard deviation of the estimate from measurement noise; NaN if the noise is not known.
    model
        Standard deviation of the estimate from model error; NaN if that is not known.
    innovation
        RMS of y - y_hat, before the sample is used, over the log; NaN without a log.
    measured
        RMS error of the estimate over the log, from its distance to the smoothed state; NaN where
        there is none.
    """

    ell: Array
    bandwidth: Array
    settling: Array
    peaking: Array
    noise: Array
    model: Array
    innovation: Array
    measured: Array

    @property
    def error(self) -> Array:
        """Standard deviation of the error: noise and model error together."""
        return np.asarray(np.hypot(self.noise, self.model))

    def __repr__(self) -> str:
        ends = f"{self.ell.min():.4g} to {self.ell.max():.4g} /s" if len(self.ell) else "none"
        return f"TradeOff({len(self.ell)} gains, {ends})"


@dataclass(frozen=True, eq=False, repr=False)
class Tuning:
    """The chosen observer, the reason for the choice, and the trade-off behind it.

    Attributes
    ----------
    observer : Observer
        The chosen one.
    ell : float [1/s]
    structure : str
        Its name, where several were offered.
    state : int
        The wanted estimate, 1 to n.
    criterion : str
    noise : float
        Standard deviation of the measurement noise, including the rounding of a quantised y: given,
        or estimated from the log; NaN if unknown.
    model_error : float
        Square root of the spectral density of the model error in x_n': given, or estimated from the
        log; NaN if unknown.
    point : dict
        The columns of `TradeOff`, and `error`, at the chosen gain.
    curves : dict
        A `TradeOff` a structure.
    whiteness : float
        p-value of a portmanteau test (20 lags) of the innovation at the chosen gain, if noise and
        model error are white; NaN without a log.
    warnings : tuple of str
        Warnings about the choice, each also given as a `TuningWarning`.
    errors : (n,)
        Predicted RMS error of each estimate: over a log from its distance to the smoothed state,
        else from noise and model error; NaN where these are unknown.
    bounds : (n,)
        Upper bounds of `errors`, for the worst case of the error of the smoothed state; without a
        log equal to `errors`.
    quantisation : float
        Step of y, found in the log; 0 where it moves in none.
    horizon : float
        Range of later samples that the smoothed state uses [s], 1/gain of the smoother; NaN without
        one.
    judged_by : str
        The model and samples of the smoothed state; empty without one.
    moving_gain : str
        Comparison of a gain that moves with constant gains over the log, or the reason why none was
        tried; empty where it does not apply.
    tried : tuple of (str, float, float)
        Each structure with its best gain [1/s] and its value of the criterion, least first.
    remarks : tuple of str
        What was left out, and why.
    built : dict
        An observer a structure, at its own best gain; of several outputs none.
    log : the log, as it was given; None without one
    smoothed : tuple of (N,) and (N, n)
        Times and smoothed states of the comparison; None without them.
    """

    observer: Observer
    ell: float
    structure: str
    state: int
    criterion: str
    noise: float
    model_error: float
    point: dict[str, float]
    curves: dict[str, TradeOff] = field(repr=False)
    whiteness: float = math.nan
    warnings: tuple[str, ...] = ()
    errors: Array = field(default_factory=lambda: np.empty(0))
    bounds: Array = field(default_factory=lambda: np.empty(0))
    quantisation: float = 0.0
    horizon: float = math.nan
    judged_by: str = ""
    moving_gain: str = ""
    tried: tuple[tuple[str, float, float], ...] = ()
    remarks: tuple[str, ...] = ()
    built: Mapping[str, Observer] = field(default_factory=dict, repr=False)
    log: Given | None = field(default=None, repr=False)
    smoothed: tuple[Array, Array] | None = field(default=None, repr=False)

    def __str__(self) -> str:
        if np.ndim(self.ell):
            return self.report()
        name = f"{self.structure}: " if self.structure else ""
        rows = [f"{name}gain {self.ell:.4g} /s, {self.criterion} of estimate {self.state}"]
        units = {"bandwidth": " rad/s", "settling": " s"}
        rows += [f"  {k:10s} {v:.4g}{units.get(k, '')}" for k, v in self.point.items() if v == v]
        if self.whiteness == self.whiteness:
            rows.append(f"  {'whiteness':10s} {self.whiteness:.2g}")
        rows += [f"  warning: {text}" for text in self.warnings]
        return "\n".join(rows)

    def __repr__(self) -> str:
        return f"Tuning({choice(self)})"

    def _repr_html_(self) -> str:
        return as_html(self)

    @property
    def R(self) -> float:
        """Variance of the measurement noise."""
        return self.noise**2

    @property
    def Q(self) -> float:
        """Spectral density of the model error in x_n'."""
        return self.model_error**2

    def report(self) -> str:
        """The report: structures tried, estimates of noise and model error, and the reasons for the
        choice."""
        return report(self)

    def run(self, log: Given) -> RunResult:
        """The chosen observer over a log: (t, y), (t, y, u) or a `Log`, begun at the first
        sample; with the deviations of its estimates where noise and model error are
        known and the law has them.
        """
        t, y, u = of_log(log)
        observer, u = self.observer, u if self.observer.n_u else None
        result = observer.run(t, y, u, start=observer._usual_start)
        noise, model_error = self.noise, self.model_error  # of several outputs one each
        if np.isfinite(noise).all() and np.isfinite(model_error).all() and np.all(noise > 0.0):
            with contextlib.suppress(HgoError):  # of a law or a model without deviations
                observer._deviate(result, u, noise, model_error)
        return result

    def columns(self) -> dict[str, Any]:
        """The curves of all structures, one below the other, as named columns."""
        out: dict[str, Any] = {"structure": []}
        for name, curve in self.curves.items():
            out["structure"] += [name] * len(curve.ell)
            for key, values in (*vars(curve).items(), ("error", curve.error)):
                out.setdefault(key, []).extend(values.tolist())
        return out

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of `columns`. Needs the extra `data`."""
        pd = need("pandas", "a table needs pandas", "data")
        return pd.DataFrame(self.columns())

    def page(self, path: str | Path, *, title: str = "", **log: Any) -> None:
        """Write a tuning page: one self-contained HTML file.

        It has controls for gain, structure, method and noise; estimates, error bands, spectrum,
        Bode plot and peaking follow, computed by the core as WebAssembly with the bits of `run`. A
        button gives the `observer.toml`, with `log` as its table `[log]`. A log of more than 50,000
        samples is decimated, with a `TuningWarning`.

        Raises
        ------
        HgoError
            No log; several outputs; observers that call Python functions; an installation without
            the WebAssembly module.
        """
        upward.call("page", self, path, title, log)

    def widget(self, *, title: str = "", **log: Any) -> Any:
        """`page` in a cell of a notebook, as a widget. Needs the extra `notebook`.

        Its `observer` has the values of the sliders, its `toml` is the text of that
        `observer.toml`; `observe(..., names="toml")` follows changes. Errors as for `page`.

        Examples
        --------
        >>> page = tuning.widget()  # doctest: +SKIP
        >>> page.observer.run(t, y)  # doctest: +SKIP
        """
        return upward.call("widget", self, title, log)

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw the trade-off with the chosen point marked; of several outputs, whose gains are not
        on one curve, the errors of the structures. Needs the extra `plot`.
        """
        from hgo_rs.plots import structures_figure, tuning_figure

        if not self.curves:
            title = "Geometric mean of the wanted errors, each structure at its best gains"
            errors = {name or "given": error for name, _, error in self.tried}
            return structures_figure(errors, self.structure or "given", title=title, figure=figure)
        name = f"{self.structure}, " if self.structure else ""
        title = f"{name}estimate {self.state}: gain {self.ell:.4g} /s by {self.criterion}"
        best = [name for name, _, _ in self.tried[:_DRAWN]]
        curves = {name: self.curves[name] for name in {self.structure: 0} | dict.fromkeys(best)}
        point = {**self.point, "ell": self.ell}
        return tuning_figure(curves, self.structure, point, title=title, figure=figure)
