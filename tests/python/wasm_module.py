"""The module of pages, run by wasmtime as a browser runs it."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest

from hgo_rs.pages.module import MODULE


class Module:
    """`hgo.wasm`: arrays in, arrays out."""

    def __init__(self) -> None:
        wasmtime = pytest.importorskip("wasmtime")
        if not MODULE.is_file():
            pytest.skip("the package was built without the module: make pages")
        engine = wasmtime.Engine()
        self._store = wasmtime.Store(engine)
        module = wasmtime.Module.from_file(engine, str(MODULE))
        assert not module.imports
        self._exports = wasmtime.Instance(self._store, module, []).exports(self._store)

    def call(self, name: str, *given: Any) -> Any:
        return self._exports[name](self._store, *given)

    def put(self, values: Any) -> int:
        values = np.ascontiguousarray(values, dtype="<f8")
        at: int = self.call("room", values.size)
        self._exports["memory"].write(self._store, values.tobytes(), at)
        return at

    def get(self, at: int, count: int) -> np.ndarray:
        return np.frombuffer(self._exports["memory"].read(self._store, at, at + 8 * count))

    def observer(self, packed: str) -> int:
        values = np.frombuffer(base64.b64decode(packed))
        made: int = self.call("observer", self.put(values), values.size)
        return made

    def run(
        self, way: dict[str, Any], n: int, ell: float, clock: Any, y: Any, u: Any = None
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Estimates, innovations, and how many samples there are of them."""
        count, x, e = len(y), self.call("room", len(y) * n), self.call("room", len(y))
        t, period = (0, clock) if np.ndim(clock) == 0 else (self.put(clock), 0.0)
        inputs = 0 if u is None else self.put(u)
        start = self.put(np.frombuffer(base64.b64decode(way["memory"])))
        live = self.observer(way["numbers"])
        given = (live, ell, count, t, float(period), self.put(y), inputs, start, x, e)
        done = int(self.call("run", *given))
        return self.get(x, count * n).reshape(count, n), self.get(e, count), done

    def figures(self, way: dict[str, Any], n: int, ell: float, dt: float) -> dict[str, Any]:
        unit, out = self.observer(way["unit"]), self.call("room", 2 + 3 * n)
        lift = self.put(np.frombuffer(base64.b64decode(way["lift"])))
        assert self.call("figures", unit, ell, dt, lift, 1, out) == 1
        of = self.get(out, 2 + 3 * n)
        noise, model, cutoff = of[2:].reshape(3, n)
        return {"radius": of[0], "noise": noise, "model": model, "cutoff": cutoff}

    def errors(self, way: dict[str, Any], n: int, ell: float, dt: float, count: int) -> Any:
        unit, out = self.observer(way["unit"]), self.call("room", count * n)
        assert self.call("decay", unit, ell, dt, count, out) == 1
        return self.get(out, count * n).reshape(count, n)

    def bode(self, way: dict[str, Any], n: int, ell: float, dt: float, omega: Any) -> Any:
        unit, out = self.observer(way["unit"]), self.call("room", 2 * n * len(omega))
        assert self.call("bode", unit, ell, dt, self.put(omega), len(omega), out) == 1
        return self.get(out, 2 * n * len(omega)).view(np.complex128).reshape(len(omega), n)

    def density(self, values: Any, length: int, dt: float) -> np.ndarray:
        out = self.call("room", length // 2 + 1)
        self.call("density", self.put(values), len(values), length, dt, out)
        return self.get(out, length // 2 + 1)
