"""What `smooth` returns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from hgo_rs.errors import check_choice, need
from hgo_rs.files import replacing
from hgo_rs.markup import number, table
from hgo_rs.observers.whiteness import normal_width
from hgo_rs.smoothing.samples import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Smoothed:
    """The states of a record of N samples, each estimated from all samples.

    Attributes
    ----------
    t : (N,) [s]
    x : (N, n)
        The states.
    covariance : (N, n, n)
        Covariance of the errors, if R, Q and the model are right.
    filtered : (N, n)
        The estimates of the extended Kalman filter, from the samples up to each.
    y : (N, n_y)
        The samples.
    innovation : (N, n_y)
        y - y_hat of the filter, before the sample is used; NaN where it is missing.
    states : tuple of str
        Their names.
    outputs : tuple of int
        The states that are measured, counted from 0.
    R : (n_y,)
        Variance of the noise of a sample.
    Q : (n, n)
        Intensity of white noise in x'; (order, order) of a chain that replaces the model.
    log_likelihood : float
        ln of the density of the record, under R, Q and the model.
    whiteness, normality : float
        p-values of tests of the innovations for whiteness and normality: below 0.001 the deviations
        are rough. See `docs/smoothing.md`.
    remarks : tuple of str
        Remarks on the result.
    """

    t: Array
    x: Array
    covariance: Array = field(repr=False)
    filtered: Array = field(repr=False)
    y: Array = field(repr=False)
    innovation: Array = field(repr=False)
    states: tuple[str, ...]
    outputs: tuple[int, ...]
    R: Array
    Q: Array
    log_likelihood: float
    whiteness: float
    normality: float
    remarks: tuple[str, ...] = ()

    def of_states(self, names: tuple[str, ...], told: str) -> Smoothed:
        """The first states alone, under these names, and a remark."""
        n = len(names)
        return replace(
            self,
            x=self.x[:, :n],
            covariance=self.covariance[:, :n, :n],
            filtered=self.filtered[:, :n],
            states=names,
            remarks=(*self.remarks, told),
        )

    @property
    def deviation(self) -> Array:
        """Standard deviation of each state, (N, n)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def missing(self) -> Any:
        """(N,) bool: samples of which an output was missing."""
        return ~np.isfinite(self.y).all(axis=1)

    def band(self, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper ends, (N, n) each, between which a state lies with this probability."""
        wide = normal_width(level) * self.deviation
        return self.x - wide, self.x + wide

    def state(self, name: str) -> Array:
        """One state by its name, (N,)."""
        return self.x[:, self.states.index(check_choice("state", name, self.states))]

    def columns(self) -> dict[str, Array]:
        """Time, samples, states and their deviations as named columns (N,)."""
        out = {"time": self.t}
        single = self.y.shape[1] == 1
        out |= {"y" if single else f"y{i + 1}": column for i, column in enumerate(self.y.T)}
        out |= dict(zip(self.states, self.x.T, strict=True))
        out |= {f"std {n}": c for n, c in zip(self.states, self.deviation.T, strict=True)}
        return out

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of `columns`, indexed by time. Needs the extra `data`."""
        pd = need("pandas", "a table needs pandas", "data")
        return pd.DataFrame(self.columns()).set_index("time")

    def to_csv(self, path: str | Path) -> None:
        """Write `columns` as a CSV file, whole or not at all."""
        with replacing(path) as file:
            self.write_csv(file)

    def write_csv(self, file: IO[bytes]) -> None:
        """Write `columns` as CSV to an open file."""
        columns = self.columns()
        file.write((",".join(columns) + "\n").encode())
        np.savetxt(file, np.column_stack(list(columns.values())), fmt="%.12g", delimiter=",")

    def plot(self, figure: Figure | None = None, *, level: float = 0.95) -> Figure:
        """Draw the states with their bands, and the filter's innovation. Needs the extra
        `plot`.
        """
        from hgo_rs.plots import estimate_figure

        single = self.y.shape[1] == 1
        return estimate_figure(
            self.t,
            self.x,
            y=self.y[:, 0] if single else None,
            innovation=self.innovation,
            missing=self.missing,
            band=self.band(level),
            names=self.states,
            estimate="smoothed",
            figure=figure,
        )

    def __repr__(self) -> str:
        span = f"{self.t[0]:g} to {self.t[-1]:g} s"
        return f"Smoothed({len(self.t)} samples from {span}; {', '.join(self.states)})"

    def _repr_html_(self) -> str:
        """Each state: range, and the RMS of its deviation."""
        usual = np.sqrt(np.mean(self.deviation**2, axis=0)).tolist()
        rows = [
            (name, number(x.min()), number(x.max()), number(spread))
            for name, x, spread in zip(self.states, self.x.T, usual, strict=True)
        ]
        return table(repr(self), rows, ["state", "least", "largest", "deviation (RMS)"])

    def __str__(self) -> str:
        lines = [f"{len(self.t)} samples smoothed, ln likelihood {self.log_likelihood:.6g}"]
        for i, spread in zip(self.outputs, self.R.tolist(), strict=True):
            lines.append(f"  sqrt(R) of {self.states[i]:6s} {np.sqrt(spread):.4g}")
        for name, intensity in zip(self.states, np.diag(self.Q).tolist(), strict=False):
            if intensity > 0.0:
                lines.append(f"  sqrt(Q) of {name + chr(39):6s} {np.sqrt(intensity):.4g}")
        usual = np.sqrt(np.mean(self.deviation**2, axis=0)).tolist()
        for name, value in zip(self.states, usual, strict=True):
            lines.append(f"  {name:14s} +- {value:.4g}")
        lines.append(f"  innovation: white {self.whiteness:.2g}, normal {self.normality:.2g}")
        return "\n".join([*lines, *(f"  {text}" for text in self.remarks)])
