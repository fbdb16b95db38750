"""Collections of observers that repel each other, and the observer with their gain."""

from __future__ import annotations

import warnings
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from hgo_rs.design.discrete import DEFAULT_TIMING
from hgo_rs.errors import HgoError, check, check_array, check_integer
from hgo_rs.laws import LAWS
from hgo_rs.models import System
from hgo_rs.observers import arguments
from hgo_rs.observers.base import Observer
from hgo_rs.observers.gains import AdaptiveGain
from hgo_rs.observers.online import initial_gain
from hgo_rs.observers.records import Array, vector
from hgo_rs.observers.turns import turn


class CopiesMetWarning(UserWarning):
    """Copies of a collection have become identical, which they stay."""


class _Copies(Observer):
    """What the collection and the modified observer share."""

    _kind: ClassVar[str]

    def __init__(
        self,
        gain: AdaptiveGain,
        *,
        k: npt.ArrayLike,
        k_bar: npt.ArrayLike,
        copies: int = 3,
        model: System | None = None,
        method: str = "rk4",
        timing: str = DEFAULT_TIMING,
        wrap: float | None = None,
        allow_unstable: bool = False,
    ) -> None:
        remedy = "the collection is defined for law (6) only"
        check(isinstance(gain, AdaptiveGain), "gain", gain, "an AdaptiveGain", remedy)
        spec = {
            "kind": self._kind,
            "n": 2,
            "k": vector(k, "k", 2).tolist(),
            "k_bar": vector(k_bar, "k_bar", 2).tolist(),
            "copies": check_integer(copies, "copies", least=2, most=5),
            "gain": gain.spec,
            "model": arguments.model(model, 2),
            **arguments.manner(LAWS[self._kind], method, timing),
            **turn(wrap),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)

    @property
    def copies(self) -> int:
        """Number of copies."""
        return int(self.spec["copies"])

    def _starts(self, x_hat0: npt.ArrayLike, r0: npt.ArrayLike) -> Array:
        """Flat memory [x_hat_1, r_1, x_hat_2, r_2, ...] of starts that differ."""
        starts, gains = check_array(x_hat0, "x_hat0"), check_array(r0, "r0")
        shape = (self.copies, self.n)
        if starts.shape != shape or not np.all(np.isfinite(starts)):
            raise HgoError(
                f"x_hat0 of shape {starts.shape}: must be finite and of shape {shape}; one row a "
                "copy"
            )
        fits = gains.shape in ((), (self.copies,))
        check(fits, "r0", r0, f"one number, or {self.copies}", "give one a copy")
        for value in gains.flat:
            initial_gain(float(value))
        rows = np.column_stack([starts, np.broadcast_to(gains, (self.copies,))]).ravel()
        self._check_apart(rows)
        return np.asarray(rows)

    def _held(self, memory: Array) -> Array:
        """The whole memory from the law's: no sample has been seen."""
        return np.concatenate([memory, np.zeros(self._core.memory_len - self._law_len)])

    def _copies_of(self, memory: npt.ArrayLike) -> Array:
        """What of memories (..., m) is the copies', (..., copies (n + 1))."""
        end = self._law_len
        return np.asarray(memory, dtype=float)[..., end - self.copies * (self.n + 1) : end]

    def _check_start(self, memory: Array, told: bool | None = None) -> None:
        """Every r_i >= 1, and copies that start apart.

        In a memory that was given as a whole copies may have met: `step` goes on from there, so all
        goes on, with a warning.
        """
        for value in np.ravel(memory[..., self.n : self._law_len : self.n + 1]):
            initial_gain(float(value))
        if not (self._told if told is None else told):
            self._check_apart(self._copies_of(memory))
        else:
            self._warn_met(memory)

    def _tell_end(self, start: Array, end: Array) -> None:
        if self._distinct(end) < self._distinct(start):
            self._warn_met(end)

    def _distinct(self, memory: Array) -> int:
        """How many copies differ; of several memories in the worst of them."""
        rows = self._copies_of(memory).reshape(-1, self.copies, self.n + 1)
        return min(len(np.unique(copies, axis=0)) for copies in rows)

    def _warn_met(self, memory: Array) -> None:
        if (left := self._distinct(memory)) < self.copies:
            warnings.warn(
                f"copies have met: {left} of {self.copies} differ, and identical copies never "
                f"separate; for {self.copies} again, start from spread(...)",
                CopiesMetWarning,
                stacklevel=4,
            )

    def _check_apart(self, copies: Array) -> None:
        for starts in copies.reshape(-1, self.copies, self.n + 1):
            holds = len(np.unique(starts, axis=0)) == self.copies
            allowed = "different from one another"
            remedy = "identical copies never separate; spread them with spread(...)"
            check(holds, "starts of the copies", starts.tolist(), allowed, remedy)

    def nominal_gain(self, memory: npt.ArrayLike) -> Array:
        """r_bar = mean r_i (24) of the copies in memories (..., m)."""
        gains = self._copies_of(memory)[..., self.n :: self.n + 1]
        return np.asarray(gains.mean(axis=-1))


class RepelledCollection(_Copies):
    """A collection of observers that repel each other. Sanfelice and Praly (23), (24).

    The estimate is the first copy's; `nominal_gain` is the mean of the gains r_i.

    Parameters
    ----------
    gain : AdaptiveGain
    k, k_bar : two numbers each
        Coefficients, and repulsion gains mu P^-1 (1, 0)' (`hgo_rs.design.repulsion_gains`).
    copies : int
        2 to 5.
    model, method, timing, wrap, allow_unstable
        As in `StandardObserver`.
    """

    _kind = "collection"

    def spread(self, x_hat0: npt.ArrayLike, r0: npt.ArrayLike = 1.0) -> Array:
        """A memory from starts (copies, 2) that differ, and initial gains r >= 1."""
        return self._held(self._starts(x_hat0, r0))


class ModifiedObserver(_Copies):
    """The observer with gain r r_bar, where r_bar comes from a collection. Sanfelice and Praly
    (25).

    Parameters as in `RepelledCollection`.
    """

    _kind = "modified"

    @property
    def gain(self) -> float:
        """The gain that acts: r r_bar."""
        return float(self.gains(self.memory))

    def gains(self, memory: npt.ArrayLike) -> Array:
        """The gain that acts, r r_bar, for memories (..., m)."""
        values = np.asarray(memory, dtype=float)
        return np.asarray(values[..., self.n] * self.nominal_gain(values))

    def spread(
        self,
        x_hat0: npt.ArrayLike,
        copies_x_hat0: npt.ArrayLike,
        r0: float = 1.0,
        copies_r0: npt.ArrayLike = 1.0,
    ) -> Array:
        """A memory from the main observer's start (2,) and the copies' starts (copies, 2)."""
        main = [*vector(x_hat0, "x_hat0", self.n), initial_gain(r0)]
        return self._held(np.concatenate([main, self._starts(copies_x_hat0, copies_r0)]))
