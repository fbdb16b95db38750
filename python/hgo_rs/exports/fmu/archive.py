"""The file of an FMU: an archive of its texts and, where there is a C compiler, of its binary."""

from __future__ import annotations

import io
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path

__all__ = ["archive"]

_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off")
_SYSTEMS = {
    "linux": ("linux64", "linux", "so"),
    "darwin": ("darwin64", "darwin", "dylib"),
    "win32": ("win64", "windows", "dll"),
}
"""By Python's name: folder of FMI 2.0, system of FMI 3.0, what a shared library ends in."""

_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def archive(texts: Mapping[str, str], name: str) -> bytes:
    """The archive, the same for the same texts and compiler.

    Without a C compiler (`CC`, or cc) it has sources only, and a UserWarning says so.
    """
    inside = {file: text.encode() for file, text in texts.items()} | _binary(texts, name)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        for path, content in inside.items():
            entry = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            file.writestr(entry, content)
    return packed.getvalue()


def _binary(texts: Mapping[str, str], name: str) -> dict[str, bytes]:
    """The shared library of this computer, by its path; nothing where it cannot be made."""
    machine = _MACHINES.get(platform.machine().lower())
    if sys.platform not in _SYSTEMS or machine is None:
        return _sources_only(f"no binary of FMI for {sys.platform} on {platform.machine()}")
    second, system, end = _SYSTEMS[sys.platform]
    third = "sources/buildDescription.xml" in texts
    folder = f"{machine}-{system}" if third else second
    compiler = shlex.split(os.environ.get("CC") or "cc")
    if shutil.which(compiler[0]) is None:
        return _sources_only(f"no C compiler ({compiler[0]}) is here")
    with tempfile.TemporaryDirectory() as scratch:
        here = Path(scratch)
        for file, text in texts.items():
            if file.startswith("sources/"):
                (here / Path(file).name).write_text(text, encoding="utf-8")
        library = f"{name}.{end}"
        made = subprocess.run(
            [*compiler, *_FLAGS, f"{name}.c", f"{name}_fmu.c", "-lm", "-o", library],
            cwd=here,
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode != 0:
            lines = made.stderr.strip().splitlines() or ["no message"]
            first = next((line for line in lines if "error" in line), lines[0])
            return _sources_only(f"the C compiler ({compiler[0]}) failed: {first}")
        return {f"binaries/{folder}/{library}": (here / library).read_bytes()}


def _sources_only(why: str) -> dict[str, bytes]:
    warnings.warn(
        f"{why}: the FMU has sources only, which the importing tool must compile; for a binary "
        "install a C compiler, or name one in CC, and export again",
        UserWarning,
        stacklevel=4,
    )
    return {}
