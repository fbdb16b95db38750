"""Terminal runs that pages show: `console` blocks, whose commands stand behind `$`.

python docs/site/recorded.py docs/first-minute.md runs them and writes what they say into the page.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"^```console\n(.*?)^```$", re.M | re.S)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def again(block: str, folder: Path) -> str:
    """A block, its commands run in a folder, one after the other."""
    here = str(Path(sys.executable).parent)
    environment = {**os.environ, "PATH": os.pathsep.join([here, os.environ["PATH"]])}
    lines = []
    for line in block.splitlines():
        if not line.startswith("$ "):
            continue
        run = subprocess.run(
            line[2:],
            shell=True,
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=True,
        )
        lines += [line, *run.stdout.rstrip().splitlines()]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def alike(one: str, other: str, rel: float = 0.02) -> bool:
    """Whether two runs say the same: words and the order of numbers, these within `rel`."""
    if NUMBER.sub("#", one).split() != NUMBER.sub("#", other).split():
        return False
    pairs = zip(NUMBER.findall(one), NUMBER.findall(other), strict=True)
    return all(abs(float(a) - float(b)) <= rel * max(abs(float(a)), 1e-12) for a, b in pairs)


def main() -> None:
    """Write the pages that are named anew, and the pictures that they show from the run."""
    for page in map(Path, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as folder:
            text = page.read_text(encoding="utf-8")
            text = BLOCK.sub(lambda block: f"```console\n{again(block[1], Path(folder))}```", text)
            page.write_text(text, encoding="utf-8")
            for name in re.findall(r"\]\(([^)/]+\.png)\)", text):
                if (Path(folder) / name).is_file():
                    shutil.copy(Path(folder) / name, page.parent / name)


if __name__ == "__main__":
    main()
