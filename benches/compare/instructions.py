"""Instructions of one step of each observer, counted by callgrind: a figure without noise.

`benches/instructions.rs` steps every observer of `tests/catalogue` under every scheme, in the
release profile for plain x86-64. Callgrind counts inside its function ``counted`` and writes the
count down at ``counted_one``, once an observer.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from compare.harness import LeftOut, NotInstalled

ROOT = Path(__file__).resolve().parents[2]
UNSET = ("RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET", "CARGO_BUILD_RUSTFLAGS")
"""Variables that would compile for another processor."""


@dataclass(frozen=True)
class Count:
    """Instructions of a step, the mean over the steps."""

    law: str
    scheme: str
    instructions: float


@dataclass(frozen=True)
class Counts:
    """All counts, and the compiler and target that they hold for."""

    compiler: str
    counts: tuple[Count, ...]

    @classmethod
    def of(cls, stored: dict[str, object]) -> Counts:
        """From what `dataclasses.asdict` made of it, by way of JSON."""
        counts = stored["counts"]
        assert isinstance(counts, list)
        return cls(str(stored["compiler"]), tuple(Count(**count) for count in counts))


def _run(command: Sequence[str]) -> str:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\nended with {done.returncode}:\n{done.stderr}")
    return done.stdout


def compiler() -> str:
    """The Rust compiler and the target; raises `LeftOut` where the counts cannot be had."""
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        raise LeftOut(f"counts are for Linux on x86_64, not {sys.platform} on {platform.machine()}")
    for tool in ("cargo", "rustc", "valgrind"):
        if shutil.which(tool) is None:
            raise NotInstalled(f"{tool} is not installed")
    given = [name for name in UNSET if os.environ.get(name)]
    if given:
        raise LeftOut(f"counts are for plain x86_64 code; {', '.join(given)} is set: unset it")
    lines = _run(["rustc", "--version", "--verbose"]).splitlines()
    host = next(line for line in lines if line.startswith("host: "))
    return f"{lines[0]}, {host.removeprefix('host: ')}"


def built() -> Path:
    """The program, compiled."""
    command = ["cargo", "build", "--quiet", "--release", "--bench", "instructions"]
    messages = map(json.loads, _run([*command, "--message-format=json"]).splitlines())
    return Path(
        next(
            message["executable"]
            for message in messages
            if message["reason"] == "compiler-artifact"
            and message["target"]["name"] == "instructions"
        )
    )


def count() -> Counts:
    """Build, run under callgrind, read off; raises `LeftOut` where that cannot be."""
    made_by, program = compiler(), built()
    with tempfile.TemporaryDirectory() as folder:
        options = ["--collect-atstart=no", "--toggle-collect=*::counted"]
        options += ["--dump-after=*::counted_one", f"--callgrind-out-file={folder}/counts"]
        valgrind = [shutil.which("valgrind") or "valgrind", "--quiet", "--tool=callgrind"]
        said = _run([*valgrind, *options, str(program)])
        counts = []
        for place, line in enumerate(said.splitlines(), 1):
            law, scheme, steps = line.removeprefix("row ").split("|")
            text = Path(folder, f"counts.{place}").read_text(encoding="utf-8")
            total = next(one for one in text.splitlines() if one.startswith("summary: "))
            counts.append(Count(law, scheme, int(total.split()[1]) / int(steps)))
    return Counts(made_by, tuple(counts))


def table(counts: Counts) -> str:
    """Observers down, schemes across, as Markdown."""
    schemes = list(dict.fromkeys(one.scheme for one in counts.counts))
    found = {(one.law, one.scheme): f"{one.instructions:.0f}" for one in counts.counts}
    lines = [["observer", *schemes], ["---", *["---:"] * len(schemes)]]
    for law in dict.fromkeys(one.law for one in counts.counts):
        lines.append([law, *(found.get((law, scheme), "") for scheme in schemes)])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def differences(stated: Counts, now: Counts) -> list[str]:
    """In which of the stated observers two counts differ, in full digits; a law that is new since
    then has no count yet.
    """
    a = {(one.law, one.scheme): one.instructions for one in stated.counts}
    b = {(one.law, one.scheme): one.instructions for one in now.counts}
    return [
        f"{law}, {scheme}: {a[law, scheme]} stated, {b.get((law, scheme))} counted"
        for law, scheme in sorted(a)
        if a[law, scheme] != b.get((law, scheme))
    ]
