"""The WebAssembly module that pages carry, and pages from their parts."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs._version import __version__
from hgo_rs.errors import HgoError

_FOLDER = Path(__file__).parent
MODULE = _FOLDER / "hgo.wasm"
"""Made of `crates/wasm` when the package is built."""


def is_built() -> bool:
    """Whether this installation has the module."""
    return MODULE.is_file()


def require_module() -> bytes:
    """The module.

    Raises
    ------
    HgoError
        An installation that was made without it.
    """
    if not is_built():
        raise HgoError(
            "this installation has no WebAssembly module, which a page computes with: it was built "
            "from sources without it; run `rustup target add wasm32-unknown-unknown` and `make "
            "pages` in the sources, then install them again, or install a wheel"
        )
    return MODULE.read_bytes()


def packed(values: Any) -> str:
    """Numbers as base64 of their bits, little-endian doubles, row by row."""
    return base64.b64encode(np.asarray(values, dtype="<f8").tobytes()).decode()


def digest(values: Any) -> str:
    """A number that tells whether bits are the same: sum of (2 i + 1) bits_i, modulo 2^64."""
    bits = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64).ravel()
    return f"{int(np.sum(bits * (2 * np.arange(bits.size, dtype=np.uint64) + 1))):016x}"


def assembled(title: str, systems: Sequence[Mapping[str, Any]]) -> str:
    """A page as text, of one system or of several to choose among: template, style, script, module
    and data in one.
    """
    data = {"version": __version__, "systems": systems}
    parts = {
        "style": (_FOLDER / "page.css").read_text(encoding="utf-8"),
        "script": (_FOLDER / "page.js").read_text(encoding="utf-8"),
        "module": base64.b64encode(require_module()).decode(),
        # within <script>: no text of the data can end it
        "data": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        "title": title.replace("&", "&amp;").replace("<", "&lt;"),
    }
    text = (_FOLDER / "page.html").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace("{{" + name + "}}", part)
    return text
