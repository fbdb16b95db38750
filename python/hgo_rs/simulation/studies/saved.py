"""A study in a Parquet file: a row for each finished run, and what the study is as JSON.

The file is written whole each time, beside the earlier one, and takes its place when it is on the
disk: at every moment one of the two is there and readable. A row is placed by its columns `case`
and `run`, so that rows may be sorted or left out; its column `checksum` is over the study and the
numbers of the run, so that a row that was changed, or comes from another study, is seen.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs._version import __version__
from hgo_rs.errors import HgoError, check, explain, need
from hgo_rs.files import replacing
from hgo_rs.simulation.studies.cases import label
from hgo_rs.simulation.studies.result import FRAMES, StudyResult

_KEY = b"hgo_rs.study"
_FORMAT = 2
_SUM = "checksum"
_LONG = 16
"""Arrays of more numbers are compared by their digest."""
_PART = 2**18
"""Numbers that a check sum is taken of at once."""
_SHARE = 10.0
"""Writing takes at most one part in so many of the time."""


class Saved:
    """The file of a study: `load` what it holds, `keep` what is finished."""

    def __init__(self, path: str | os.PathLike[str], result: StudyResult) -> None:
        pa = self.pa = need("pyarrow", "save needs pyarrow", "data")
        self.pq = need("pyarrow.parquet", "save needs pyarrow", "data")
        pa.array(np.zeros(1))  # loads pandas, if it is there: now, not when Ctrl-C waits for it
        try:
            self.path = Path(path)
        except TypeError:
            raise HgoError(explain("save", path, "a path", "give a file's name")) from None
        remedy = "make it first, or choose another"
        check(self.path.parent.is_dir(), "save", str(path), "in an existing folder", remedy)
        check(not self.path.is_dir(), "save", str(path), "a file", "choose another name")
        self.result = result
        self.identity = _identity(result)
        self.unsaved = False
        self.on_disk = 0
        """Runs that the file holds."""
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
            self._place(table)
            for out, times in zip(self.result.outputs, saved["times"], strict=True):
                if "t" in out:
                    out["t"][:] = times
            self.on_disk = len(table)
        except HgoError:
            raise
        except (self.pa.ArrowException, OSError, LookupError, TypeError, ValueError) as error:
            told = " ".join(f"{type(error).__name__}: {error}".split())
            raise HgoError(
                f"save = {str(self.path)!r}: must be a study saved by hgo_rs, and whole; it cannot "
                f"be read ({told}); move it away or choose another name"
            ) from error

    def _place(self, table: Any) -> None:
        """Put rows into the result, each by its case and run; ValueError where one is not right."""
        result = self.result
        for name in ("case", "run"):
            if not self.pa.types.is_integer(table[name].type) or table[name].null_count:
                raise ValueError(f"column {name!r} holds something else than whole numbers")
        order = np.lexsort((table["run"].to_numpy(), table["case"].to_numpy()))
        columns = {name: table[name].to_numpy()[order] for name in table.column_names}
        case, run = columns["case"], columns["run"]
        cases, runs = result.finished.shape
        outside = (case < 0) | (case >= cases) | (run < 0) | (run >= runs)
        if outside.any():
            k = int(np.argmax(outside))
            raise ValueError(f"a row is of case {case[k]}, run {run[k]}, which do not exist")
        twice = (np.diff(case) == 0) & (np.diff(run) == 0)
        if twice.any():
            k = int(np.argmax(twice))
            raise ValueError(f"run {run[k]} of case {case[k]} occurs twice")
        result.finished[case, run] = True
        result.fill(columns)
        for i, out in enumerate(result.outputs):
            rows = case == i
            for key in FRAMES if rows.any() else ():
                if key in out:
                    values = np.stack(columns[key][rows])
                    out[key][result.finished[i]] = values.reshape(-1, *out[key].shape[1:])
        wrong = columns[_SUM] != self._sums()
        if wrong.any():
            k = int(np.argmax(wrong))
            raise ValueError(
                f"the numbers of run {run[k]} of case {case[k]} are not those that were saved"
            )

    def _sums(self) -> np.ndarray:
        """The check sum of each finished run, in the order of the table of runs, (rows,).

        Of the bits of all its numbers, each times an odd number of its own, modulo 2^64; which
        numbers those are is drawn from the study, the case and the run.
        """
        result = self.result
        told = {key: value for key, value in self.identity.items() if key != "runs"}
        salt = zlib.crc32(json.dumps(told, sort_keys=True).encode())
        sums = []
        for i, out in enumerate(result.outputs):
            runs = np.flatnonzero(result.finished[i])
            total = _mixed(np.uint64(salt), np.uint64(i), runs.astype(np.uint64))
            for key, shape in result.experiments[i].shapes.items():
                width = math.prod(shape)
                name = np.uint64(zlib.crc32(key.encode()))
                weights = _mixed(name, np.arange(width, dtype=np.uint64)) | np.uint64(1)
                at_once = max(1, _PART // max(1, width))
                for rows in (slice(k, k + at_once) for k in range(0, len(runs), at_once)):
                    part = out[key][runs[rows]]
                    values = part.astype(np.float64).reshape(len(part), width)
                    values = np.where(np.isnan(values), np.nan, values)  # one of the many NaNs
                    total[rows] += (values.view(np.uint64) * weights).sum(axis=1, dtype=np.uint64)
            sums.append(total)
        return np.concatenate(sums)

    def told(self) -> str:
        """What of the study is on the disk, in words."""
        place = f"save={str(self.path)!r}"
        if not (self.on_disk and self.path.exists()):
            return f"none is saved in {place}"
        count = "all" if self.on_disk == self.result.finished.sum() else f"{self.on_disk}"
        return f"{count} of them saved; the next call with {place} continues from these"

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
        columns[_SUM] = pa.array(self._sums())
        times = [out["t"].tolist() if "t" in out else None for out in result.outputs]
        metadata = {_KEY: json.dumps({"study": self.identity, "times": times})}
        table = pa.table(columns).replace_schema_metadata(metadata)
        with replacing(self.path) as file:
            self.pq.write_table(table, file, write_page_checksum=True)
        self.on_disk = len(table)


def _identity(result: StudyResult) -> dict[str, Any]:
    """What a study is, as JSON has it: what all cases share, and the rest of each."""
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


def _mixed(*parts: Any) -> Any:
    """Whole numbers, mixed to one of 64 bits (the finaliser of splitmix64)."""
    total = np.zeros((1,), dtype=np.uint64)
    for part in parts:
        total = (total ^ part) + np.uint64(0x9E3779B97F4A7C15)
        total = (total ^ (total >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        total = (total ^ (total >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        total = total ^ (total >> np.uint64(31))
    return total


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
