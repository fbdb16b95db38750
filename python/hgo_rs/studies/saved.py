"""A study in a Parquet file: a row for each finished run, and what the study is as JSON.

The file is written whole each time, beside the earlier one, and takes its place when it is on the
disk: at every moment one of the two is there and readable.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, MissingExtraError, check, explain
from hgo_rs.studies.cases import label
from hgo_rs.studies.result import FRAMES, StudyResult

__all__ = ["Saved"]

_KEY = b"hgo_rs.study"
_FORMAT = 1
_LONG = 16
"""Arrays of more numbers are compared by their digest."""
_SHARE = 10.0
"""Writing takes at most one part in so many of the time."""


class Saved:
    """The file of a study: `load` what it holds, `keep` what is finished."""

    def __init__(self, path: str | os.PathLike[str], result: StudyResult) -> None:
        try:
            import pyarrow as pa
            import pyarrow.parquet as pq
        except ImportError as error:
            raise MissingExtraError("save needs pyarrow: pip install 'hgo_rs[data]'") from error
        self.pa, self.pq = pa, pq
        pa.array(np.zeros(1))  # loads pandas, if it is there: now, not when Ctrl-C waits for it
        try:
            self.path = Path(path)
        except TypeError:
            raise HgoError(explain("save", path, "a path", "give a file's name")) from None
        remedy = "make it first, or choose another"
        check(self.path.parent.is_dir(), "save", str(path), "in a folder that is there", remedy)
        check(not self.path.is_dir(), "save", str(path), "a file", "choose another name")
        self.result = result
        self.identity = _identity(result)
        self.unsaved = False
        self.due = time.perf_counter() + 1.0

    def load(self) -> None:
        """Put the runs of the file, if there is one, into the result.

        Raises
        ------
        HgoError
            The file is no saved study, is damaged, or is of another study; what differs is named.
        """
        if not self.path.exists():
            return
        try:
            with self.pq.ParquetFile(self.path, page_checksum_verification=True) as file:
                saved = json.loads((file.schema_arrow.metadata or {})[_KEY])
                self._check_same(saved["study"])
                table = file.read()
            columns = {name: table[name].to_numpy() for name in table.column_names}
            result = self.result
            result.finished[columns["case"], columns["run"]] = True
            if result.finished.sum() != len(table):
                raise ValueError("rows are double")
            result.fill(columns)
            for i, out in enumerate(result.outputs):
                rows = columns["case"] == i
                if "t" in out:
                    out["t"][:] = saved["times"][i]
                for key in FRAMES if rows.any() else ():
                    if key in out:
                        values = np.stack(columns[key][rows])
                        out[key][result.finished[i]] = values.reshape(-1, *out[key].shape[1:])
        except HgoError:
            raise
        except (self.pa.ArrowException, OSError, LookupError, TypeError, ValueError) as error:
            told = " ".join(f"{type(error).__name__}: {error}".split())
            raise HgoError(
                f"save = {str(self.path)!r}: must be a study saved by hgo_rs, and whole; it cannot "
                f"be read ({told}); move it away or choose another name"
            ) from error

    def _check_same(self, saved: Mapping[str, Any]) -> None:
        """Refuse a file of another study; one with fewer runs may be continued."""
        given = self.identity
        different = list(_differences(saved, given))
        if different:
            told = ", ".join(different[:3])
            more = f", and {len(different) - 3} more" if len(different) > 3 else ""
            raise HgoError(
                f"save = {str(self.path)!r}: holds another study: {told}{more}; give the same "
                "arguments to continue it, or choose another name"
            )

    def keep(self, *, now: bool = False) -> None:
        """Write the file if there is something new and it is time (or `now`)."""
        if not self.unsaved or (not now and time.perf_counter() < self.due):
            return
        start = time.perf_counter()
        self._write()
        end = time.perf_counter()
        self.unsaved, self.due = False, end + max(1.0, _SHARE * (end - start))

    def _write(self) -> None:
        pa, result = self.pa, self.result
        columns = {name: pa.array(values) for name, values in result.run_table().items()}
        for key in FRAMES:
            if any(key in out for out in result.outputs):
                runs = [
                    row.ravel() if key in out else None
                    for out, mask in zip(result.outputs, result.finished, strict=True)
                    for row in out.get(key, mask)[mask]
                ]
                columns[key] = pa.array(runs, pa.list_(pa.float64()))
        times = [out["t"].tolist() if "t" in out else None for out in result.outputs]
        metadata = {_KEY: json.dumps({"study": self.identity, "times": times})}
        table = pa.table(columns).replace_schema_metadata(metadata)
        beside = self.path.with_name(f".{self.path.name}.{os.getpid()}.tmp")
        try:
            with beside.open("wb") as file:
                self.pq.write_table(table, file, write_page_checksum=True)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(self.path)
        finally:
            beside.unlink(missing_ok=True)


def _identity(result: StudyResult) -> dict[str, Any]:
    """What a study is, as JSON has it: what all cases share, and the rest of each."""
    from hgo_rs import __version__

    cases = []
    for parameters, experiment in zip(result.parameters, result.experiments, strict=True):
        spec = {k: v for k, v in experiment.spec.items() if k not in ("runs", "seed")}
        named = {f"parameter {name}": label(value) for name, value in parameters.items()}
        cases.append({**named, **dict(_flat(spec, ""))})
    shared = {k: v for k, v in cases[0].items() if all(k in c and c[k] == v for c in cases)}
    identity = {
        "hgo_rs": __version__,
        "format": _FORMAT,
        "backend": result.backend,
        "seed": result.seed,
        "runs": result.finished.shape[1],
        "shared": shared,
        "cases": [{k: v for k, v in case.items() if k not in shared} for case in cases],
    }
    return dict(json.loads(json.dumps(identity)))


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """The leaves of a spec with their paths; long arrays as digests."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, np.ndarray) and value.size > _LONG:
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
        yield path, f"{value.shape} {digest}"
    else:
        yield path, value.tolist() if isinstance(value, np.ndarray) else value


def _differences(saved: Mapping[str, Any], given: Mapping[str, Any]) -> Iterator[str]:
    """What differs, in words."""
    for key in ("hgo_rs", "format", "backend", "seed"):
        if saved[key] != given[key]:
            yield f"{key} is {saved[key]!r} there and {given[key]!r} here"
    if saved["runs"] > given["runs"]:
        yield f"runs is {saved['runs']} there and {given['runs']} here (more would continue it)"
    if len(saved["cases"]) != len(given["cases"]):
        yield f"it has {len(saved['cases'])} cases there and {len(given['cases'])} here"
        return
    for i, (one, other) in enumerate(zip(saved["cases"], given["cases"], strict=True)):
        there, here = saved["shared"] | one, given["shared"] | other
        for key in dict.fromkeys((*there, *here)):
            a, b = there.get(key, "nothing"), here.get(key, "nothing")
            if a != b and json.dumps(a) != json.dumps(b):  # NaN is equal to itself here
                yield f"{key} of case {i} is {a!r} there and {b!r} here"
