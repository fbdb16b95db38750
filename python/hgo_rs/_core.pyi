from collections.abc import Mapping
from typing import Any, Literal, final, overload

import numpy as np
import numpy.typing as npt
from typing_extensions import Self, disjoint_base

__all__ = [
    "Observer",
    "Online",
    "RecordKernel",
    "StudyKernel",
    "TextReader",
    "coefficients_from_poles",
    "coupled_paths",
    "ekf_covariances",
    "elementary_source",
    "evaluate_table",
    "filtered",
    "is_hurwitz",
    "kernel_agrees",
    "law_coefficients",
    "law_sizes",
    "laws",
    "live_numbers",
    "low_power_coefficients",
    "low_power_coefficients_from_poles",
    "low_power_polynomial",
    "mean_covariance",
    "placed_gains",
    "random",
    "run_single",
    "simulate",
    "study_source",
    "text_cells",
    "text_is_idle",
    "text_kind",
    "text_lines",
    "trace_step",
]

_Array = npt.NDArray[np.float64]
_Column = tuple[npt.NDArray[Any], npt.NDArray[np.uint64], npt.NDArray[np.int64]]
_Pairs = list[tuple[float, float]]

@final
class StudyKernel:
    def __new__(cls, runs: int, forms: list[tuple[int, bool, int]]) -> StudyKernel: ...

@final
class RecordKernel:
    def __new__(cls, address: int, widths: list[int]) -> RecordKernel: ...

@final
class Observer:
    def __new__(cls, spec: Mapping[str, Any]) -> Observer: ...
    @property
    def n(self) -> int: ...
    @property
    def n_y(self) -> int: ...
    @property
    def n_u(self) -> int: ...
    @property
    def memory_len(self) -> int: ...
    @property
    def is_current(self) -> bool: ...
    def initial(self) -> _Array: ...
    def begin(self, memory: npt.ArrayLike, y: npt.ArrayLike) -> _Array | None: ...
    def step(
        self,
        memory: npt.ArrayLike,
        y: npt.ArrayLike,
        u: npt.ArrayLike,
        t: float,
        dt: float,
    ) -> tuple[_Array, int]: ...
    def correct(self, memory: npt.ArrayLike, y: npt.ArrayLike, t: float) -> tuple[_Array, int]: ...
    def advance(
        self,
        memory: npt.ArrayLike,
        y: npt.ArrayLike,
        u: npt.ArrayLike,
        t: float,
        dt: float,
    ) -> tuple[_Array, int]: ...
    def run(
        self,
        t: npt.ArrayLike,
        y: npt.ArrayLike,
        u: npt.ArrayLike,
        memory0: npt.ArrayLike,
        innovation: bool = True,
        until: float | None = None,
        kernel: RecordKernel | None = None,
    ) -> dict[str, Any]: ...
    def record_source(self) -> dict[str, Any] | None: ...

@disjoint_base
class Online:
    @property
    def memory(self) -> _Array: ...
    @memory.setter
    def memory(self, memory: npt.ArrayLike) -> None: ...
    allow_unstable: bool
    _time: float
    _clock: tuple[int, list[float]]
    _started: bool
    _open: bool
    def __new__(cls, *_args: Any, **_kwargs: Any) -> Self: ...
    def __init__(self, law: Observer, lift: float, allow_unstable: bool) -> None: ...
    def step(
        self,
        y: npt.ArrayLike | None,
        u: npt.ArrayLike | None = None,
        *,
        dt: float,
        out: _Array | None = None,
    ) -> _Array: ...
    def correct(self, y: npt.ArrayLike | None, *, out: _Array | None = None) -> _Array: ...
    def predict(
        self,
        u: npt.ArrayLike | None = None,
        dt: float | None = None,
        *,
        out: _Array | None = None,
    ) -> _Array: ...
    def _bound(self, start: float, samples: float) -> float: ...

def simulate(spec: Mapping[str, Any], kernel: StudyKernel | None = None) -> dict[str, Any]: ...
def study_source(spec: Mapping[str, Any], lanes: int, copies: int = 0) -> dict[str, Any] | None: ...
def kernel_agrees(spec: Mapping[str, Any], kernel: StudyKernel) -> bool: ...
def coupled_paths(spec: Mapping[str, Any]) -> dict[str, _Array]: ...
def mean_covariance(spec: Mapping[str, Any]) -> dict[str, _Array]: ...
def laws() -> list[dict[str, Any]]: ...
def law_sizes(kind: str, n: int, m: int, moves: bool) -> dict[str, Any]: ...
def law_coefficients(kind: str, n: int, m: int, poles: _Pairs | None) -> list[list[float]]: ...
def ekf_covariances(
    n: int, sampled: bool, q: list[float], r: float, p0: list[float] | None, theta: float
) -> tuple[list[float], list[float]]: ...
def coefficients_from_poles(poles: _Pairs) -> list[float]: ...
def is_hurwitz(coefficients: list[float]) -> bool: ...
def low_power_coefficients(coefficients: list[float]) -> tuple[list[float], list[float]]: ...
def low_power_coefficients_from_poles(poles: _Pairs) -> tuple[list[float], list[float]]: ...
def low_power_polynomial(alpha: list[float], beta: list[float]) -> list[float]: ...
@overload
def random(
    kind: Literal["uniform", "normal"], count: int, seed: int, run: int = 0, channel: int = 0
) -> _Array: ...
@overload
def random(
    kind: Literal["bits"], count: int, seed: int, run: int = 0, channel: int = 0
) -> npt.NDArray[np.uint64]: ...
def elementary_source(
    language: Literal["c", "rust", "llvm"],
    precision: str,
    names: list[str],
    prefix: str = "hgo",
    lanes: int = 1,
) -> str: ...
def filtered(values: npt.ArrayLike, sections: npt.ArrayLike) -> _Array: ...
def trace_step(
    spec: Mapping[str, Any],
    single: bool = False,
    missing: bool = False,
    dt: float | None = None,
    part: str = "step",
    gains: Literal["computed", "held", "given"] = "computed",
    fixed_dt: float | None = None,
) -> dict[str, Any]: ...
def placed_gains(
    spec: Mapping[str, Any],
    lengths: list[float],
    single: bool = False,
    gains: Literal["held", "given"] = "held",
) -> list[tuple[int, int | None, list[list[float]]]]: ...
def live_numbers(spec: Mapping[str, Any]) -> _Array: ...
def evaluate_table(
    table: Mapping[str, Any], inputs: npt.ArrayLike, single: bool = False
) -> list[list[float]]: ...
def run_single(
    spec: Mapping[str, Any],
    t: npt.ArrayLike,
    y: npt.ArrayLike,
    u: npt.ArrayLike,
    memory0: npt.ArrayLike,
) -> list[list[float]]: ...

@final
class TextReader:
    def __new__(
        cls,
        delimiter: int | None,
        width: int,
        columns: list[tuple[int, str]],
        line: int,
        trailing: bool,
    ) -> Self: ...
    @property
    def commas(self) -> bool: ...
    @property
    def line(self) -> int: ...
    def read(
        self, block: bytes, begin: int, most: int, last: bool
    ) -> tuple[list[_Column], npt.NDArray[np.uint64], int] | dict[str, Any]: ...

def text_cells(line: bytes, delimiter: int | None) -> list[bytes] | None: ...
def text_is_idle(line: bytes) -> bool: ...
def text_kind(cell: bytes, commas: bool) -> str | None: ...
def text_lines(columns: list[npt.NDArray[Any]]) -> bytes: ...
