"""Single and double precision, as the languages call them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["PRECISIONS", "Precision"]


@dataclass(frozen=True)
class Precision:
    """How one precision is called, and of how many bits its numbers are."""

    name: str
    rust: str
    width: int
    real: type[np.floating[Any]]


PRECISIONS = {
    "double": Precision("double", "f64", 64, np.float64),
    "single": Precision("single", "f32", 32, np.float32),
}
