"""The axis' observers in plain Python, until the compiled core runs them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import hgo_rs as hgo
from hgo_rs.design import discrete


class AxisObserver:
    """Order 2, or 3 with a disturbance as last state: q' = v, v' = phi(v, u) + d, d' = 0."""

    def __init__(
        self, n: int, ell: float, parameters: dict[str, float] | None, poles: Any, timing: str
    ) -> None:
        method = "zoh" if timing == "current" else "euler"
        self.spec = {
            **hgo.StandardObserver(n, ell, poles=poles).spec,
            "method": method,
            "timing": timing,
        }
        self.n, self.parameters = n, parameters

    def run(self, t: Any, y: Any, u: Any = None, *, x_hat0: Any = None) -> Any:
        """Over a record with even steps: an object with x_hat (N, n) and innovation (N, 1)."""
        time = np.asarray(t, dtype=float)
        dt = float(np.median(np.diff(time))) if time.ndim else float(time)
        law = discrete(self.spec, dt)
        current = self.spec["timing"] == "current"
        k1, k2, k3 = [*(law.d if current else law.b)[:, 0].tolist(), 0.0][:3]
        p = self.parameters
        q, v, d = [*(np.zeros(self.n) if x_hat0 is None else x_hat0), 0.0][:3]
        half = 0.5 * dt * dt if current else 0.0
        out, innovation, held = [], [], 0.0
        volts = np.zeros(len(y)) if u is None else np.ravel(u)
        bound = 1e3 * max(1.0, float(np.max(np.abs(y))))
        for measured, now in zip(np.ravel(y).tolist(), volts.tolist(), strict=True):
            if not abs(q) < bound:
                raise hgo.HgoError("the estimate diverged")
            if current:
                a = d
                if p is not None:
                    friction = p["Fv"] * v + p["Fc"] * math.tanh(v / p["vs"]) + p["offset"]
                    a += (p["gtau"] * held - friction) / p["M"]
                if out:  # over the step that the sample ends
                    q, v = q + dt * v + half * a, v + dt * a
                e = measured - q
                q, v, d = q + k1 * e, v + k2 * e, d + k3 * e
                out.append((q, v, d)[: self.n])
                innovation.append(e)
                held = now
            else:
                out.append((q, v, d)[: self.n])
                e = measured - q
                innovation.append(e)
                a = d
                if p is not None:
                    friction = p["Fv"] * v + p["Fc"] * math.tanh(v / p["vs"]) + p["offset"]
                    a += (p["gtau"] * now - friction) / p["M"]
                q, v, d = q + dt * v + k1 * e, v + dt * a + k2 * e, d + k3 * e

        class Run:
            pass

        found = Run()
        found.x_hat = np.array(out)  # type: ignore[attr-defined]
        found.innovation = np.array(innovation)[:, None]  # type: ignore[attr-defined]
        return found
