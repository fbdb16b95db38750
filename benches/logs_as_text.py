"""CSV in and out beside pandas and pyarrow, and a large file in little memory.

    python benches/logs_as_text.py              # reading and writing 1e6 rows
    python benches/logs_as_text.py --gigabyte    # then `hgo estimate` over 1 GB

A figure is processor time, the least of several samples; the libraries take turns.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pyarrow.csv

from hgo_rs.logs import read_log, write_table

ROWS = 1_000_000
SAMPLES = 7


def least(calls: dict[str, Callable[[], Any]]) -> dict[str, float]:
    """Processor time [s] of each, the least of the samples."""
    found = dict.fromkeys(calls, np.inf)
    for _ in range(SAMPLES):
        for name, call in calls.items():
            begin = time.process_time()
            call()
            found[name] = min(found[name], time.process_time() - begin)
    return found


def tell(what: str, times: dict[str, float], other: str) -> None:
    shown = ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in times.items())
    print(f"{what}: {shown}; {times['hgo_rs'] / times[other]:.2f} of {other}", flush=True)


def speed(folder: Path) -> None:
    rng = np.random.default_rng(1)
    t = 1e-3 * np.arange(ROWS)
    q = 1e-3 * np.cumsum(rng.standard_normal(ROWS))
    path = folder / "log.csv"
    for digits, row in (("3 and 6 decimals", "%.3f,%.6f"), ("all digits", "%r,%r")):
        lines = (row % pair for pair in zip(t.tolist(), q.tolist(), strict=True))
        path.write_text("t,q\n" + "\n".join(lines) + "\n")
        read = {
            "hgo_rs": lambda: read_log(path, "t", "q"),
            "pandas": lambda: pandas.read_csv(path),
        }
        tell(f"read {ROWS} rows x 2 columns, {digits}", least(read), "pandas")
    columns = {"t": t, "q": q, "a": np.sin(q), "b": rng.standard_normal(ROWS), "c": np.exp(q)}
    table = pyarrow.table(columns)
    out = folder / "out.csv"
    written = {
        "hgo_rs": lambda: write_table(out, columns),
        "pyarrow": lambda: pyarrow.csv.write_csv(table, str(out)),
    }
    tell(f"write {ROWS} rows x 5 columns", least(written), "pyarrow")


def gigabyte(folder: Path) -> None:
    """The whole command, its largest memory as the system tells it."""
    path, block = folder / "large.csv", 500_000
    rng = np.random.default_rng(2)
    with path.open("w") as file:
        file.write("t,q\n")
        for begin in range(0, 10**9, block):
            t = 1e-3 * np.arange(begin, begin + block)
            q = np.sin(t) + 1e-3 * rng.standard_normal(block)
            pairs = zip(t.tolist(), q.tolist(), strict=True)
            file.write("\n".join(f"{a:.3f},{b:.17g}" for a, b in pairs) + "\n")
            if file.tell() >= 10**9:
                break
    options = [
        "--time",
        "t",
        "--output",
        "q",
        "--observer",
        "standard",
        "--order",
        "2",
        "--gain",
        "40",
    ]
    for size in (10**7, path.stat().st_size):
        log = path if size > 10**7 else folder / "small.csv"
        if log != path:
            with path.open("rb") as file:
                log.write_bytes(file.read(size).rsplit(b"\n", 1)[0] + b"\n")
        command = [sys.executable, "-m", "hgo_rs.cli", "estimate", str(log), *options]
        out = ["--out", str(folder / "out.csv"), "--figure", str(folder / "out.png")]
        process = subprocess.Popen([*command, *out], stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        assert status == 0
        print(
            f"hgo estimate, {size / 1e6:.0f} MB: {usage.ru_utime + usage.ru_stime:.1f} s of a "
            f"processor, {usage.ru_maxrss / 1024:.0f} MiB at most",
            flush=True,
        )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        speed(Path(folder))
        if "--gigabyte" in sys.argv:
            gigabyte(Path(folder))
