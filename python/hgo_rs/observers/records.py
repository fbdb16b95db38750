"""Checks of records and vectors: samples, times, inputs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check, check_array, check_number

Array = npt.NDArray[np.float64]

MARK = "mark a missing sample as NaN"
STARTS = ("zero", "first-sample")

INPUT_HOLDS = ("previous", "mean")
"""Where an estimate begins if nothing else is said."""


def vector(values: npt.ArrayLike, parameter: str, length: int) -> Array:
    vector = check_array(values, parameter)
    if vector.shape != (length,):
        raise HgoError(f"{parameter} of shape {vector.shape}: must have {length} entries")
    check(np.all(np.isfinite(vector)), parameter, values, "finite", "leave out NaN and infinity")
    return vector


def floats(values: npt.ArrayLike, parameter: str, remedy: str = "give numbers") -> Array:
    """As `check_array`, but an array of floats is taken as it is."""
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    return check_array(values, parameter, remedy=remedy)


def samples(y: npt.ArrayLike, n_y: int) -> Array:
    """Samples (N, n_y), NaN where missing; what they hold is still to be checked."""
    if isinstance(y, (list, tuple)) and n_y > 1:
        y = [[np.nan] * n_y if row is None else row for row in y]
    values = floats(y, "y", MARK)
    if values.ndim == 1 and n_y == 1:
        values = values[:, np.newaxis]
    if values.ndim != 2 or values.shape[1] != n_y or len(values) == 0:
        wanted = "(N,)" if n_y == 1 else f"(N, {n_y})"
        many = values.ndim == 2 and values.shape[1] > 1 and n_y == 1
        remedy = "; take one of its columns, of a frame by its name" if many else ""
        raise HgoError(f"y of shape {values.shape}: must be {wanted} with N >= 1{remedy}")
    return values


def check_samples(values: Array, channels: int) -> None:
    if values.shape[-1] != channels:
        raise HgoError(f"y has {values.shape[-1]} entries: must have {channels}")
    infinite = np.isinf(values).any(axis=1)
    if infinite.any():
        k = int(np.argmax(infinite))
        raise HgoError(f"y at sample {k} is infinite: must be finite; {MARK}")


def first_of(values: Array) -> Array:
    """The first sample that is there, of each output, (n_y,); NaN where there is none."""
    there = ~np.isnan(values)
    rows = np.argmax(there, axis=0)
    return np.asarray(np.where(there.any(axis=0), values[rows, np.arange(values.shape[1])], np.nan))


def clock(t_or_dt: npt.ArrayLike, count: int) -> float | Array:
    """A sampling period, or times (N,) that are still to be checked."""
    given = floats(t_or_dt, "t_or_dt")
    if given.ndim == 0:
        period = check_number(float(given), "dt", above=0.0)
        allowed = f"such that {count} samples end at a finite time"
        ends = np.isfinite((count - 1) * period)
        check(ends, "dt", period, allowed, "choose a smaller one")
        return period
    if given.shape != (count,):
        raise HgoError(f"t of shape {given.shape}: must be ({count},); give one time a sample")
    return given


def after(until: float, clock: float | Array, count: int) -> float:
    """A time after the last sample."""
    end = check_number(until, "until")
    last = clock * (count - 1) if isinstance(clock, float) else float(clock[-1])
    check(
        end > last, "until", until, f"after the last sample, > {last:.9g} s", "give the next time"
    )
    return end


def check_times(clock: float | Array) -> None:
    t = np.atleast_1d(clock)
    bad = ~np.isfinite(t)
    if bad.any():
        raise HgoError(f"t at sample {int(np.argmax(bad))} is not finite: every sample needs one")
    backward = t[1:] <= t[:-1]
    if backward.any():
        k = int(np.argmax(backward)) + 1
        raise HgoError(
            f"t at sample {k} is {t[k]:.9g} s after {t[k - 1]:.9g} s: time must increase; "
            "sort the record or drop repeated samples"
        )


def inputs(u: npt.ArrayLike | None, count: int, n_u: int) -> Array:
    """Inputs (N, n_u); what they hold is still to be checked."""
    if n_u == 0:
        if u is not None and np.size(u) > 0:
            raise HgoError(
                "u is given, but this observer's model has no input: give it one, for example "
                "model=InputGain(b0)"
            )
        return np.empty((count, 0))
    if u is None:
        told = f"this observer's model has {n_u} known input(s); give (N, {n_u})"
        raise HgoError(f"u is missing: {told}")
    values = floats(u, "u")
    if values.ndim < 2 and values.size == count * n_u and 1 in (count, n_u):
        values = values.reshape(count, n_u)
    if values.shape != (count, n_u):
        raise HgoError(f"u of shape {values.shape}: must be ({count}, {n_u})")
    return values


def averaged(u: Array) -> Array:
    """The mean input of each period (N, n_u); that of the last one, whose end is open, held."""
    means = u.copy()
    means[:-1] = 0.5 * (u[:-1] + u[1:])
    return means


def check_inputs(u: Array) -> None:
    bad = ~np.isfinite(u).all(axis=1)
    if bad.any():
        raise HgoError(f"u at sample {int(np.argmax(bad))} is not finite: every sample needs one")
