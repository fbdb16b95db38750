"""The figures of results: estimates, a sweep over a parameter, the trade-off of a gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hgo_rs.errors import HgoError
from hgo_rs.plots.style import COLOURS, new_figure, require_matplotlib, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def shade_gaps(ax: Axes, time: np.ndarray, missing: np.ndarray) -> None:
    """Shade the spans where samples are missing."""
    edges = np.flatnonzero(np.diff(np.r_[0, np.asarray(missing, dtype=np.int8), 0]))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        end = time[min(stop, len(time) - 1)]
        ax.axvspan(time[start], end, color="#ececec", linewidth=0, zorder=0)


def estimate_figure(
    time: Any,
    x_hat: Any,
    *,
    y: Any = None,
    x: Any = None,
    innovation: Any = None,
    missing: Any = None,
    gain: Any = None,
    band: tuple[Any, Any] | None = None,
    names: Sequence[str] | None = None,
    output: str = "y",
    estimate: str = "estimate",
    title: str = "",
    figure: Figure | None = None,
) -> Figure:
    """Draw an observer's estimates over a record: a panel a state, then innovation and gain.

    Parameters
    ----------
    time : (N,), s
    x_hat : (N, n)
        Estimates.
    y : (N,), optional
        Measured output, shown behind the first estimate.
    x : (N, n), optional
        True states, where they are known.
    innovation : (N,) or (N, 1), optional
    missing : (N,) bool, optional
        Missing samples: shaded.
    gain : (N,), optional
        The gain over time; a constant one is not drawn.
    band : two (N, n), optional
        Lower and upper ends of a band around the estimates: shaded.
    names : n strings, optional
        Panel titles; default x̂1, x̂2, ...
    output : str
        What the measurement is called.
    estimate : str
        What the estimates are called.
    title : str
        Over all panels.
    figure : Figure, optional
        An empty figure to draw on; default a new one.

    Returns
    -------
    Figure
    """
    require_matplotlib()
    time = np.asarray(time, dtype=float)
    x_hat = np.asarray(x_hat, dtype=float)
    if x_hat.ndim == 1:
        x_hat = x_hat[:, None]
    n = x_hat.shape[1]
    states = list(names) if names is not None else [rf"$\hat x_{{{i + 1}}}$" for i in range(n)]
    if len(states) != n or len(time) != len(x_hat):
        raise HgoError(
            f"estimate_figure: {len(time)} times, {len(states)} names for x_hat of shape "
            f"{x_hat.shape}"
        )
    extra: list[tuple[str, np.ndarray]] = []
    if innovation is not None:
        extra.append(("innovation", np.asarray(innovation, dtype=float).reshape(len(time), -1)))
    if gain is not None:
        gain = np.asarray(gain, dtype=float)
        if gain.ndim and len(gain) == len(time) and np.ptp(gain) > 0.0:
            extra.append(("gain", gain.reshape(len(time), -1)))

    panels = n + len(extra)
    columns = 1 if panels <= 5 else 2
    lines = -(-panels // columns)
    size = (7.2 if columns == 1 else 10.5, 1.0 + 1.55 * lines)
    with style():
        if figure is None:
            figure = new_figure(size)
        else:
            figure.set_size_inches(*size)
        grid = figure.subplots(lines, columns, sharex=True, squeeze=False)
        axes = list(grid.T.flat)
        for ax in axes[panels:]:
            ax.remove()
        for i in range(n):
            ax = axes[i]
            if i == 0 and y is not None:
                # A dense record reads as a band, a sparse one as points.
                sparse = len(time) <= 400
                ax.plot(
                    time,
                    np.asarray(y, dtype=float).reshape(len(time), -1)[:, 0],
                    color=COLOURS["sky"] if not sparse else COLOURS["grey"],
                    linewidth=0 if sparse else 2.6,
                    marker="o" if sparse else "",
                    markersize=3,
                    alpha=0.75,
                    label=output,
                )
            if x is not None:
                truth = np.asarray(x, dtype=float).reshape(len(time), -1)
                ax.plot(time, truth[:, i], color=COLOURS["black"], linewidth=2.2, label="true")
            if band is not None:
                low, high = (np.asarray(end, dtype=float)[:, i] for end in band)
                ax.fill_between(time, low, high, color=COLOURS["vermillion"], alpha=0.25, lw=0)
            ax.plot(time, x_hat[:, i], color=COLOURS["vermillion"], linewidth=1.1, label=estimate)
            ax.set_title(states[i])
            _leave_peak_out(ax, time, x_hat[:, i])
        if len(axes[0].get_lines()) > 1:
            axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        for ax, (name, values) in zip(axes[n:], extra, strict=False):
            ax.plot(time, values, color=COLOURS["blue"], linewidth=0.8)
            ax.set_title(name)
            if name == "innovation":
                _leave_peak_out(ax, time, values)
        for ax in axes[:panels]:
            if missing is not None and np.any(missing):
                shade_gaps(ax, time, missing)
            ax.tick_params(labelbottom=False)
            ax.margins(x=0.0)
        for column in range(columns):
            last = axes[min((column + 1) * lines, panels) - 1]
            last.set_xlabel("time (s)")
            last.tick_params(labelbottom=True)
        if title:
            figure.suptitle(title, x=0.01, ha="left")
    return figure


def _leave_peak_out(ax: Axes, time: np.ndarray, values: np.ndarray) -> None:
    """Scale to what follows the first 5 % if the start-up peak would flatten it; say so."""
    later = values[time >= time[0] + 0.05 * (time[-1] - time[0])]
    later, whole = later[np.isfinite(later)], values[np.isfinite(values)]
    if not len(later):
        return
    low, high = float(later.min()), float(later.max())
    span = max(high - low, 1e-12 * max(abs(low), abs(high), 1e-300))
    if float(np.ptp(whole)) <= 4.0 * span:
        return
    ax.set_ylim(low - 0.12 * span, high + 0.12 * span)
    note_peak(ax, whole)


def note_peak(ax: Axes, values: np.ndarray) -> None:
    """Say in the corner what the axis leaves out at the start."""
    low, high = float(values.min()), float(values.max())
    ax.annotate(
        f"start-up peak off scale: {low:.3g} to {high:.3g}",
        (0.0, 1.0),
        xytext=(4, -2),
        xycoords="axes fraction",
        textcoords="offset points",
        va="top",
        fontsize=8,
        color="#5a5a5a",
        bbox={"boxstyle": "square,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
    )


def sweep_figure(
    lines: Mapping[str, tuple[Any, Any, Any]], *, x: str, y: str, figure: Figure | None = None
) -> Figure:
    """Draw a quantity over a parameter, with error bars; a line for each named (x, y, error)."""
    require_matplotlib()
    with style():
        figure = new_figure() if figure is None else figure
        ax = figure.subplots()
        for name, (values, means, errors) in lines.items():
            numbers = np.issubdtype(np.asarray(values).dtype, np.number)
            order = np.argsort(values, kind="stable") if numbers else np.arange(len(values))
            ax.errorbar(
                np.asarray(values)[order],
                np.asarray(means)[order],
                yerr=np.nan_to_num(np.asarray(errors)[order]),
                marker="o",
                markersize=3.5,
                capsize=2.5,
                label=name,
            )
        for axis, all_values in (
            ("x", np.concatenate([np.asarray(line[0]) for line in lines.values()])),
            ("y", np.concatenate([np.asarray(line[1]) for line in lines.values()])),
        ):
            if _spans_decades(all_values):
                ax.set(**{f"{axis}scale": "log"})
        ax.set_xlabel(x)
        ax.set_ylabel(y)
        ax.margins(x=0.03)
        if len(lines) > 1:
            ax.legend()
    return figure


def error_figure(
    methods: Sequence[str],
    errors: Mapping[str, Any],
    *,
    title: str = "",
    figure: Figure | None = None,
) -> Figure:
    """Draw errors as bars, a panel for each quantity (methods,), NaN where there is none; the
    least one is marked.
    """
    require_matplotlib()
    with style():
        size = (2.2 + 2.9 * len(errors), 1.2 + 0.34 * len(methods))
        figure = new_figure(size) if figure is None else figure
        figure.set_size_inches(*size)
        axes = figure.subplots(1, len(errors), sharey=True, squeeze=False)[0]
        place = np.arange(len(methods))
        for ax, (name, values) in zip(axes, errors.items(), strict=True):
            values = np.asarray(values, dtype=float)
            colours = [COLOURS["blue"]] * len(values)
            if np.isfinite(values).any():
                colours[int(np.nanargmin(values))] = COLOURS["vermillion"]
            ax.barh(place, np.nan_to_num(values), color=colours, height=0.62)
            if _spans_decades(values):
                ax.set_xscale("log")
            for y, value in zip(place.tolist(), values.tolist(), strict=True):
                if np.isfinite(value):
                    told = {"xytext": (3, 0), "textcoords": "offset points", "va": "center"}
                    ax.annotate(f"{value:.3g}", (value, y), fontsize=8, **told)
            ax.set(title=name, yticks=place, yticklabels=list(methods))
            ax.margins(x=0.22)
            ax.grid(visible=False, axis="y")
        axes[0].invert_yaxis()
        if title:
            figure.suptitle(title, x=0.01, ha="left")
    return figure


def tuning_figure(
    curves: Mapping[str, Any],
    chosen: str,
    point: Mapping[str, float],
    *,
    title: str,
    figure: Figure | None = None,
) -> Figure:
    """Draw the trade-off of `tune`, curves by structure, with the chosen point marked.

    Error over the gain, measured and as noise and model error make it; noise and peaking against
    bandwidth; from a log the innovation.
    """
    require_matplotlib()
    several = len(curves) > 1
    measured = any(np.isfinite(curve.innovation).any() for curve in curves.values())
    panels: list[tuple[str, str, str, tuple[str, ...]]] = [
        ("error of the estimate", "gain (1/s)", "ell", ("measured", "error", "noise", "model")),
        ("noise of the estimate", "bandwidth (rad/s)", "bandwidth", ("noise",)),
        ("peaking", "bandwidth (rad/s)", "bandwidth", ("peaking",)),
    ]
    if measured:
        panels.insert(1, ("innovation, RMS over the log", "gain (1/s)", "ell", ("innovation",)))
    judged = any(np.isfinite(curve.measured).any() for curve in curves.values())
    looks = {"noise": "--", "model": ":"} | ({"error": "-."} if judged else {})
    with style():
        size = (9.4, 6.4) if measured else (11.0, 3.6)
        figure = new_figure(size) if figure is None else figure
        figure.set_size_inches(*size)
        shape = (2, 2) if measured else (1, 3)
        axes = list(figure.subplots(*shape, squeeze=False).flat)
        colours = [COLOURS[c] for c in ("blue", "green", "purple", "orange", "sky", "grey")]
        for ax, (heading, label, across, shown) in zip(axes, panels, strict=True):
            for j, (name, curve) in enumerate(curves.items()):
                first = next((q for q in shown if np.isfinite(getattr(curve, q)).any()), shown[0])
                for quantity in shown:
                    x, y = getattr(curve, across), getattr(curve, quantity)
                    there = np.isfinite(x) & np.isfinite(y) & (y > 0.0)
                    if not there.any():
                        continue
                    told = name if several else quantity
                    ax.plot(
                        x[there],
                        y[there],
                        color=colours[j % len(colours)],
                        linestyle=looks.get(quantity, "-") if len(shown) > 1 else "-",
                        label=told if not several or quantity == first else None,
                    )
            known = [point[name] for name in (*shown, "noise") if point.get(name, np.nan) > 0.0]
            y = known[0] if known else np.nan
            if shown[0] == "innovation":
                curve = curves[chosen]
                alive = np.isfinite(curve.innovation)
                y = np.interp(
                    np.log(point["ell"]), np.log(curve.ell[alive]), curve.innovation[alive]
                )
            if np.isfinite(point[across]) and np.isfinite(y):
                mark = {"marker": "o", "markersize": 8, "linestyle": "none", "zorder": 5}
                ax.plot(point[across], y, color=COLOURS["vermillion"], label="chosen", **mark)
            ax.set(xscale="log", yscale="log", xlabel=label, title=heading)
        axes[1 if several and measured else 0].legend(loc="best")  # room beside the curves
        figure.suptitle(title, x=0.01, ha="left")
    return figure


def structures_figure(
    errors: Mapping[str, float], chosen: str, *, title: str, figure: Figure | None = None
) -> Figure:
    """Draw one error a structure as bars, the chosen one marked."""
    require_matplotlib()
    with style():
        size = (7.0, 1.2 + 0.4 * len(errors))
        figure = new_figure(size) if figure is None else figure
        figure.set_size_inches(*size)
        ax = figure.subplots()
        colours = [COLOURS["vermillion" if name == chosen else "blue"] for name in errors]
        bars = ax.barh(list(errors), list(errors.values()), color=colours)
        ax.bar_label(bars, fmt="%.3g", padding=3)
        ax.invert_yaxis()
        ax.margins(x=0.15)
        ax.set(xlabel="error")
        figure.suptitle(title, x=0.01, ha="left")
    return figure


def _spans_decades(values: np.ndarray) -> bool:
    """Whether positive numbers differ by more than a factor of ten."""
    if not np.issubdtype(values.dtype, np.number):
        return False
    finite = values[np.isfinite(values)]
    return len(finite) > 0 and finite.min() > 0.0 and finite.max() > 10.0 * finite.min()
