"""Argument checks that the design functions share.  All raise ``DesignError``."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hgo_rs.errors import DesignError, MissingExtraError, check, check_integer, check_number

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MAX_ORDER = 12


def demand(holds: object, parameter: str, value: object, allowed: str, remedy: str) -> None:
    """``check``, with a ``DesignError``."""
    check(holds, parameter, value, allowed, remedy, DesignError)


def order(n: Any, parameter: str = "n", *, least: int = 1) -> int:
    """An observer's order, ``least`` to 12."""
    return check_integer(n, parameter, least=least, most=MAX_ORDER, error=DesignError)


def number(value: Any, parameter: str, **limits: Any) -> float:
    """A finite float within ``limits`` (above, least, below, most, remedy)."""
    return check_number(value, parameter, error=DesignError, **limits)


def positive(value: Any, parameter: str) -> float:
    """A finite float > 0."""
    return number(value, parameter, above=0.0)


def _real(value: ArrayLike, parameter: str) -> Array:
    """``value`` as a finite real array; complex numbers are refused, not truncated."""
    try:
        given = np.asarray(value)
        holds = not np.iscomplexobj(given) or not np.any(np.imag(given))
        demand(holds, parameter, given.tolist(), "real", "drop the imaginary parts")
        array = np.real(given).astype(np.float64)
    except (TypeError, ValueError) as error:
        if isinstance(error, DesignError):
            raise
        raise DesignError(f"{parameter}: must be an array of numbers; got {value!r}") from None
    finite = bool(np.all(np.isfinite(array)))
    check(finite, parameter, array.tolist(), "finite", "remove NaN and infinities", DesignError)
    return array


def vector(value: ArrayLike, parameter: str, length: int | None = None) -> Array:
    """``value`` as a finite float array, shape (length,)."""
    array = np.atleast_1d(_real(value, parameter))
    fits = array.ndim == 1 and array.size == (length if length is not None else max(array.size, 1))
    shape = "(n,), n >= 1" if length is None else f"({length},)"
    demand(fits, parameter, array.tolist(), f"of shape {shape}", f"it has shape {array.shape}")
    return array


def positive_vector(value: ArrayLike, parameter: str, length: int | None = None) -> Array:
    """``vector`` with all entries > 0."""
    array = vector(value, parameter, length)
    remedy = "choose positive entries"
    demand(np.all(array > 0.0), parameter, array.tolist(), "> 0 in every entry", remedy)
    return array


def square(value: ArrayLike, parameter: str, n: int | None = None) -> Array:
    """``value`` as a finite float array, shape (n, n)."""
    array = np.atleast_2d(_real(value, parameter))
    fits = array.ndim == 2 and array.shape[0] == array.shape[1] and n in (None, array.shape[0])
    shape = "(n, n)" if n is None else f"({n}, {n})"
    remedy = "pass a square matrix"
    demand(fits, parameter, f"array of shape {array.shape}", f"of shape {shape}", remedy)
    return array


def symmetric(value: ArrayLike, parameter: str, n: int | None = None) -> Array:
    """``value`` as a symmetric float array, shape (n, n)."""
    array = square(value, parameter, n)
    scale = float(np.max(np.abs(array)))
    holds = np.allclose(array, array.T, rtol=0.0, atol=1e-9 * scale)
    demand(holds, parameter, array.tolist(), "symmetric", "pass (M + M.T)/2")
    return np.asarray(0.5 * (array + array.T), dtype=np.float64)


def positive_definite(value: ArrayLike, parameter: str, n: int | None = None) -> Array:
    """``symmetric`` with all eigenvalues > 0."""
    array = symmetric(value, parameter, n)
    least = float(np.linalg.eigvalsh(array)[0])
    remedy = "pass a positive definite matrix"
    demand(least > 0.0, f"smallest eigenvalue of {parameter}", least, "> 0", remedy)
    return array


def hurwitz(value: ArrayLike, parameter: str) -> Array:
    """``square`` with all eigenvalues in Re < 0."""
    array = square(value, parameter)
    rightmost = float(np.max(np.linalg.eigvals(array).real))
    holds = rightmost < 0.0
    remedy = "place all poles in the open left half plane"
    demand(holds, f"largest real part of the eigenvalues of {parameter}", rightmost, "< 0", remedy)
    return array


def load_cvxpy() -> Any:
    """cvxpy with Clarabel, or an error that names the extra."""
    try:
        import clarabel  # noqa: F401
        import cvxpy
    except ImportError as error:
        raise MissingExtraError(
            f"linear matrix inequalities need cvxpy and Clarabel ({error}): "
            'pip install "hgo_rs[design]"'
        ) from error
    return cvxpy


def solve(problem: Any) -> str:
    """Solve a cvxpy problem by Clarabel; its status, "failed" if the solver gave up.

    The status is for the record only: callers verify the answer themselves.
    """
    cp = load_cvxpy()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "solution may be inaccurate": it is verified
        try:
            problem.solve(solver=cp.CLARABEL)
        except cp.error.SolverError:
            return "failed"
    return str(problem.status)
