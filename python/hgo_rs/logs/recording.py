"""Files whose signals have clocks of their own, as the modules of the formats give them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Recording:
    """An open file of signals.

    Attributes
    ----------
    clocks : mapping of str to str or None
        Every column, and the column of its times; None: the file does not say.
    load : function
        Some of the columns, by their names; those of different clocks may differ in length.
    remarks : tuple of str
        What was found out about the file.
    """

    clocks: Mapping[str, str | None]
    load: Callable[[list[str]], Mapping[str, np.ndarray]]
    remarks: tuple[str, ...] = ()


_DATES = 946_684_800 * 10**9
"""Stamps from here on, the year 2000 in ns, are dates; others count from a start of their own."""


def stamps(nanoseconds: list[int]) -> np.ndarray:
    """Times in ns as dates, or as durations."""
    since = bool(nanoseconds) and nanoseconds[0] < _DATES
    return np.array(nanoseconds, dtype="timedelta64[ns]" if since else "datetime64[ns]")


def elements(name: str, count: int) -> list[str]:
    """The columns of `count` values that are recorded together: name[0], name[1], ..."""
    return [f"{name}[{i}]" for i in range(min(count, 10_000))]
