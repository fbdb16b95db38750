"""Pages that compute: one file each, observers and data within, the core as WebAssembly."""

from __future__ import annotations

from hgo_rs.pages.drawn import check_outputs
from hgo_rs.pages.module import require_module
from hgo_rs.pages.tuning import page, write
from hgo_rs.pages.widget import widget

__all__ = ["check_outputs", "page", "require_module", "widget", "write"]
