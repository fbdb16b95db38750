"""Times of the command line, on one core: python benches/commands.py README.md

Writes the table of the page that is named, between <!-- commands --> and <!-- end of commands -->.
The log is a sine with noise, 100,000 rows at 1 kHz; each time is the shortest of three.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

BEGIN, END = "<!-- commands -->", "<!-- end of commands -->"
LOG = ["axis.csv", "--time", "t", "--output", "q"]
COMMANDS = {
    "`hgo new`, a log of 100,000 rows": ["new", *LOG],
    "`hgo estimate` with a figure, the same log": ["estimate", "axis.csv", "--config", "axis.toml"],
    "`hgo tune`, the same log": ["tune", *LOG],
    "`hgo tune --page`, the same log": ["tune", *LOG, "--page", "tune.html"],
    "`hgo run lee-fig6`": ["run", "lee-fig6"],
    "`hgo list`": ["list"],
}


def seconds(command: list[str], folder: Path) -> float:
    """The time of a command [s]."""
    began = time.perf_counter()
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return time.perf_counter() - began


def table(folder: Path) -> str:
    """A row for each command."""
    t = 1e-3 * np.arange(100_000)
    y = 0.5 * np.sin(3.0 * t) + 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    np.savetxt(folder / "axis.csv", np.c_[t, y], "%.9g", ",", header="t,q", comments="")
    rows = ["| Command | Takes (one core) |", "|---|---|"]
    for title, words in COMMANDS.items():
        taken = []
        for _ in range(3):
            if words[0] == "new":
                (folder / "axis.toml").unlink(missing_ok=True)
            taken.append(seconds([sys.executable, "-m", "hgo_rs.cli", *words], folder))
        rows.append(f"| {title} | {min(taken):.1f} s |")
        print(rows[-1], flush=True)
    return "\n".join(rows)


def main() -> None:
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    folder = Path(tempfile.mkdtemp())
    try:
        made = table(folder)
    finally:
        shutil.rmtree(folder)
    for page in map(Path, sys.argv[1:]):
        before, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
        _, end, after = rest.partition(END)
        if not end:
            raise SystemExit(f"{page}: must hold {BEGIN} and {END}; put both on lines of their own")
        page.write_text(f"{before}{begin}\n{made}\n{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
