"""The papers' plants, and what an observer knows of them.

A state is an array of columns, shape (n, runs).  ``drift`` is dx/dt of the plant; ``known`` is the
triangular part f_hat(x_hat) that an observer adds to its chain of integrators.  All of them are
told the input u, (n_u, runs) or None, and the time t [s]; the papers' use neither but for the ship.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .error import Array, Spec, choice, fail, integer, known, member, number, vector
from .table import Table

Time = float | Array  # one for all runs, or (runs,)


class Plant:
    """A plant x' = drift(x, u), y = first ``n_y`` entries of x, estimated: ``target`` of x."""

    kind = "none"
    n = 0
    n_y = 1
    n_u = 0

    @property
    def target(self) -> slice:
        """Which entries of the state an observer estimates."""
        return slice(0, self.n)

    @property
    def noisy(self) -> bool:
        """Whether there is process noise."""
        return False

    def diffusion(self, x: Array, u: Array | None, t: float) -> Array:
        """b(x) of the process noise, shape of ``x``."""
        return np.zeros_like(x)

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """dx/dt, shape of ``x``."""
        raise NotImplementedError

    def output(self, x: Array, u: Array | None, t: float) -> Array:
        """y without noise: shape (runs,) for one output, else (n_y, runs)."""
        y: Array = x[0]
        return y

    def control(self, x: Array, dt: float, t: float) -> Array | None:
        """u held over the sampling period ``dt`` that begins at state ``x`` and time ``t``."""
        return None

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """f_hat(x_hat, u), shape of ``x_hat``; None where it vanishes."""
        return None

    @property
    def carries(self) -> bool:
        """Whether the last state is an unknown, which ``enters``."""
        return False

    def enters(self, x_hat: Array, last: Array, u: Array | None, t: float) -> Array:
        """What ``last``, a value of the last state, does to the rate of the one before: itself."""
        return last

    def slope(self, x_hat: Array) -> Array | float:
        """The slope of ``enters`` in the last state."""
        return 1.0

    def slopes(self, x_hat: Array) -> Array:
        """The slope of each state in the rate of the one before it, 1 for the first."""
        slopes = np.ones_like(x_hat)
        slopes[-1] = self.slope(x_hat)
        return slopes


class NoModel(Plant):
    """Nothing is known: phi = 0."""


class InputGain(Plant):
    """A model only: a chain of integrators driven by one known input, phi = b0 u."""

    kind = "input"
    n_u = 1

    def __init__(self, b0: float) -> None:
        self.b0 = b0

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(0, ..., 0, b0 u); ``u``: (1, runs), None is zero."""
        if u is None:
            return None
        f = np.zeros_like(x_hat)
        f[-1] = self.b0 * u[0]
        return f


class Lee(Plant):
    """Lee, Choi, Khalil, eq. (38)."""

    kind = "lee"
    n = 2

    @staticmethod
    def phi(x: Array) -> Array:
        """phi(x) = -x1 / (1 + x1^2) - x2."""
        x1: Array = x[0]
        return -x1 / (1.0 + x1 * x1) - x[1]

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """x1' = x2, x2' = phi(x): (38)."""
        rate = np.empty_like(x)
        rate[0] = x[1]
        rate[1] = self.phi(x)
        return rate

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(0, phi(x_hat))."""
        f = np.zeros_like(x_hat)
        f[1] = self.phi(x_hat)
        return f


class SanfelicePraly(Plant):
    """Sanfelice, Praly, eq. (19): nu1 is known to the observer, nu2 is not."""

    kind = "sanfelice-praly"
    n = 2

    def __init__(self, nu1: float, nu2: float) -> None:
        self.nu1 = nu1
        self.nu2 = nu2

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """x1' = x2 + nu1 x1 + nu2, x2' = 0: (19)."""
        rate = np.empty_like(x)
        rate[0] = x[1] + self.nu1 * x[0] + self.nu2
        rate[1] = 0.0
        return rate

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(nu1 x1_hat, 0)."""
        f = np.zeros_like(x_hat)
        f[0] = self.nu1 * x_hat[0]
        return f


class VanDerPol(Plant):
    """Fu, Kang, Li, eq. (18): dx = a(x) dt + b(x) dw, b = (0, sigma) or (0, sigma x2)."""

    kind = "van-der-pol"
    n = 2

    def __init__(self, epsilon: float, sigma: float, multiplicative: bool = False) -> None:
        self.epsilon = epsilon
        self.sigma = sigma
        self.multiplicative = multiplicative

    @property
    def noisy(self) -> bool:
        """Whether sigma is not 0."""
        return self.sigma != 0.0

    def phi(self, x: Array) -> Array:
        """phi(x) = -x1 + epsilon (1 - x1^2) x2."""
        x1: Array = x[0]
        return -x1 + self.epsilon * (1.0 - x1 * x1) * x[1]

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """a(x): x1' = x2, x2' = phi(x): (18)."""
        rate = np.empty_like(x)
        rate[0] = x[1]
        rate[1] = self.phi(x)
        return rate

    def diffusion(self, x: Array, u: Array | None, t: float) -> Array:
        """b(x), shape of ``x``."""
        b = np.zeros_like(x)
        b[1] = self.sigma * x[1] if self.multiplicative else self.sigma
        return b

    def diffusion_derivative(self, x: Array) -> Array:
        """(db/dx) b, the Milstein term."""
        d = np.zeros_like(x)
        if self.multiplicative:
            d[1] = self.sigma * self.sigma * x[1]
        return d

    def jacobian_times(self, x: Array, v: Array) -> Array:
        """(da/dx) v."""
        x1 = x[0]
        out = np.empty_like(x)
        out[0] = v[1]
        out[1] = (-1.0 - 2.0 * self.epsilon * x1 * x[1]) * v[0] + self.epsilon * (
            1.0 - x1 * x1
        ) * v[1]
        return out

    def curvature(self, x: Array) -> Array:
        """1/2 sum b_i b_j d2a/dx_i dx_j: zero, for a is linear in x2 and b1 = 0."""
        return np.zeros_like(x)

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(0, phi(x_hat))."""
        f = np.zeros_like(x_hat)
        f[1] = self.phi(x_hat)
        return f


class Crackle(Plant):
    """Astolfi, Marconi, Praly, Teel, eq. (20): a chaotic chain of five integrators."""

    kind = "crackle"
    n = 5

    def __init__(self, phi_max: float) -> None:
        self.phi_max = phi_max

    @staticmethod
    def phi(x: Array) -> Array:
        """phi(x) = 0.2 (x1^2 - 1) - x2 - x3 - 4 x4 - x5: (20)."""
        x1: Array = x[0]
        return 0.2 * (x1 * x1 - 1.0) - x[1] - x[2] - 4.0 * x[3] - x[4]

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """(1) with (20): the plant's phi is not saturated."""
        rate = np.empty_like(x)
        rate[:4] = x[1:]
        rate[4] = self.phi(x)
        return rate

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(0, 0, 0, 0, phi_s), phi_s = phi clipped at +-phi_max."""
        f = np.zeros_like(x_hat)
        f[4] = np.minimum(np.maximum(self.phi(x_hat), -self.phi_max), self.phi_max)
        return f


class Ship(Plant):
    """Katayama, eq. (20) with controller (21): position x (3), velocity z (3), y = x.

    State (x1, x2, x3, z1, z2, z3); u = (u1, u2) is held between samples.
    """

    kind = "ship"
    n = 6
    n_y = 3
    n_u = 2

    M11, M22, M23, M33 = 198.8, 206.0, 15.6, 101.5
    D11, D22, D23, D32, D33 = 56.1, 90.9, -21.8, -26.9, 38.8

    def __init__(self, delta: float = 0.0, w: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        if not abs(delta) <= 0.5:
            raise fail("plant.delta", delta, "in [-0.5, 0.5]", "see Katayama, section III")
        self.delta = delta  # delta_bar
        self.w = vector(w, "plant.w", 3)

    @property
    def target(self) -> slice:
        """z."""
        return slice(3, 6)

    def damping(self, z: Array) -> tuple[Array, Array, Array]:
        """(d1, d2, d3) = -M^-1 [C(z) + D] z: appendix."""
        z1, z2, z3 = z[0], z[1], z[2]
        c1 = self.M22 * z2 + self.M23 * z3  # c_bar = (c1, c2)
        c2 = -self.M11 * z1
        f1 = -c1 * z3 + self.D11 * z1  # [C(z) + D] z
        f2 = -c2 * z3 + (self.D22 * z2 + self.D23 * z3)
        f3 = c1 * z1 + c2 * z2 + (self.D32 * z2 + self.D33 * z3)
        det = self.M22 * self.M33 - self.M23 * self.M23
        d1 = -f1 / self.M11
        d2 = -(self.M33 * f2 - self.M23 * f3) / det
        d3 = -(self.M22 * f3 - self.M23 * f2) / det
        return d1, d2, d3

    @staticmethod
    def rudder(z: Array) -> tuple[Array, Array, Array, Array]:
        """lambda21, lambda22, lambda31, lambda32: appendix.  Undefined (0/0) at z1 = s = 0.

        lambda22 jumps where z1 changes its sign; a z1 of nothing but rounding, and 0 of either
        sign, is +0.
        """
        z1 = z[0]
        s = z[1] - 1.18 * z[2]
        z1_2, s_2 = z1 * z1, s * s
        ahead = np.where(np.abs(z1) > 1e-12 * np.abs(s), z1, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            lambda22 = -0.0232 * (z1_2 + s_2) * np.arctan(s / ahead)
        return (
            0.102 * z1_2 - 0.0232 * s_2,
            lambda22,
            0.287 * z1_2 + 0.307 * s_2,
            -13.23 * lambda22,
        )

    def f2(self, x: Array, z: Array, u: Array, t: Time) -> Array:
        """f2(x, z, u) + delta = (1 + delta_bar) (-M^-1 [C + D] z + q(z, u)) + w."""
        d1, d2, d3 = self.damping(z)
        lambda21, lambda22, lambda31, lambda32 = self.rudder(z)
        rate = np.empty_like(z)
        rate[0] = d1 + u[0]
        rate[1] = d2 + lambda21 * u[1] + lambda22
        rate[2] = d3 + lambda31 * u[1] + lambda32
        return (1.0 + self.delta) * rate + self.w[:, None]

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """x' = R(x3) z, z' = f2 + delta: (20)."""
        if u is None:
            raise fail("u", None, "of shape (2, runs)", "give the control held over the step")
        z = x[3:]
        rate = np.empty_like(x)
        rate[:3] = self.x_rate(x[:3], z, u, t)
        rate[3:] = self.f2(x[:3], z, u, t)
        return rate

    def x_rate(self, x: Array, z: Array, u: Array, t: Time) -> Array:
        """R(x3) z: (20)."""
        sine, cosine = np.sin(x[2]), np.cos(x[2])
        return np.stack((cosine * z[0] - sine * z[1], sine * z[0] + cosine * z[1], z[2]))

    def explain(self, x: Array, rate: Array, u: Array, t: Time) -> Array:
        """R'(x3) x': the z of this rate."""
        sine, cosine = np.sin(x[2]), np.cos(x[2])
        return np.stack(
            (cosine * rate[0] + sine * rate[1], cosine * rate[1] - sine * rate[0], rate[2])
        )

    def output(self, x: Array, u: Array | None, t: float) -> Array:
        """(x1, x2, x3)."""
        return x[:3]

    def control(self, x: Array, dt: float, t: float) -> Array | None:
        """Controller (21) with T = dt, in the one reading that cancels exactly.

        (21) ends in -k z3_tilde (printed: z3_bar), and kappa begins with -k (z3 + Gamma v)
        (printed: -k x3_tilde), k = 0.3 / (T + 0.3).
        """
        x2, x3, z = x[1], x[2], x[3:]
        z1, z2, z3 = z[0], z[1], z[2]
        k = 0.3 / (dt + 0.3)
        sine, cosine = np.sin(x3), np.cos(x3)
        d1, d2, d3 = self.damping(z)
        lambda21, lambda22, lambda31, lambda32 = self.rudder(z)
        x3_tilde = x3 - np.arctan(-x2 / 6.0)
        gamma = 6.0 / (36.0 + x2 * x2)
        v = z1 * sine + z2 * cosine
        z3_bar = -k * x3_tilde - gamma * v
        z3_tilde = z3 - z3_bar
        kappa = (
            -k * (z3 + gamma * v)
            + gamma * gamma * x2 * v * v / 3.0
            - gamma * (d1 * sine + (d2 + lambda22) * cosine + (z1 * cosine - z2 * sine) * z3)
        )
        xi = lambda31 + lambda21 * gamma * cosine
        u1 = -(z1 - 0.8) / (dt + 0.3) - d1
        u2 = (-d3 - lambda32 + kappa - k * z3_tilde - gamma * u1 * sine) / xi
        return np.stack((u1, u2))


class Own(Plant):
    """A model of the user's own: its table, of (t, x, u, parameters), in one of six forms.

    ``form``: "phase" (phi), "triangular" (f_1 ... f_n), "nonlinear-chain" (the same, and the slopes
    of f_i + x_(i+1) in x_(i+1)), "chains" (phi_1, phi_2, ..., one for each
    of ``orders``), "sampled" (f, K_T, h; y and T are inputs after u), "strict-feedback" (f1, g row
    by row, f2; of ``n`` measured states x, and of ``n_z`` others after them).
    """

    kind = "own"

    def __init__(self, spec: Spec, where: str) -> None:
        self.form = choice(member(spec, "form", where), f"{where}.form", FORMS)
        self.n = n = integer(member(spec, "n", where), f"{where}.n", least=1)
        self.n_u = integer(spec.get("n_u", 0), f"{where}.n_u", least=0)
        self.table, self.parameters = _table(spec, where)
        self.orders, self.n_z = [n], 0
        if self.form == "chains":
            self.orders = [
                integer(order, f"{where}.orders[{i}]", least=1)
                for i, order in enumerate(member(spec, "orders", where))
            ]
            if sum(self.orders) != n:
                raise fail(f"{where}.orders", self.orders, f"of sum n = {n}", "list every chain")
        if self.form == "strict-feedback":
            self.n_z = integer(member(spec, "n_z", where), f"{where}.n_z", least=1)
        self.unknown = [bool(flag) for flag in spec.get("unknown", ())]
        if self.unknown and (
            self.form not in ("phase", "triangular", "chains")
            or len(self.unknown) != len(self.orders)
        ):
            allowed = "one flag a chain, in the form phase, triangular or chains"
            raise fail(f"{where}.unknown", self.unknown, allowed, "leave it out")
        outputs = {
            "phase": 1,
            "triangular": n - len(self.unknown),
            CHAINED: 2 * n - 1,  # and the slopes of all states but the first
            "chains": len(self.orders),
            "sampled": 2 * n + 1,
            "strict-feedback": n + (n + 1) * self.n_z,
        }
        told = 1 + n + self.n_z + self.n_u + 2 * (self.form == "sampled")
        made = outputs[self.form] + len(self.unknown)  # and the slopes in the unknowns
        _fits(self.table, told + len(self.parameters), made, where)

    def values(self, x: Array, u: Array | None, t: Time, *more: Any) -> Array:
        """All outputs of the table at (``t``, ``x``, ``u``, ``more``): (outputs, runs)."""
        told = np.zeros((self.n_u, *x.shape[1:])) if u is None else u
        made = self.table([t, *x, *told, *more, *self.parameters])
        return np.stack([np.broadcast_to(value, x.shape[1:]) for value in made])

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(0, ..., 0, phi), or (f_1, ..., f_n); without what an unknown enters, and its rate 0."""
        values = self.values(x_hat, u, t)
        f = np.zeros_like(x_hat)
        if self.form == CHAINED:
            f[:] = values[: self.n]
        elif not self.unknown:
            f[-len(values) :] = values
        elif self.form == "triangular":
            f[:-2] = values[:-2]
        return f

    @property
    def carries(self) -> bool:
        """Of a model of one chain."""
        return bool(self.unknown)

    def enters(self, x_hat: Array, last: Array, u: Array | None, t: float) -> Array:
        """phi(t, x, u, d) for ``last`` = d, where the last state is an unknown."""
        if not self.unknown:
            return last
        return self.values(np.concatenate((x_hat[:-1], last[None])), u, t)[-2]

    def slope(self, x_hat: Array) -> Array | float:
        """dphi/dd."""
        return self.values(x_hat, None, 0.0)[-1] if self.unknown else 1.0

    def slopes(self, x_hat: Array) -> Array:
        """Of a nonlinear chain: Farza, M'Saad, Rossignol, Automatica 40 (2004) 135."""
        if self.form != CHAINED:
            return super().slopes(x_hat)
        return np.concatenate((np.ones_like(x_hat[:1]), self.values(x_hat, None, 0.0)[self.n :]))

    def sampled(
        self, x: Array, u: Array | None, y: Array, t: float, dt: float
    ) -> tuple[Array, Array, Array]:
        """f and K_T, of the shape of ``x``, and h, (runs,)."""
        n, values = self.n, self.values(x, u, t, y, np.float64(dt))
        return values[:n], values[n : 2 * n], values[2 * n]

    def _f1_and_g(self, x: Array, u: Array, t: Time) -> tuple[Array, Array]:
        """f1, (n, runs), and g, (n, n_z, runs): functions of what is measured."""
        unknown = np.zeros((self.n_z, x.shape[1]))
        values = self.values(np.concatenate((x, unknown)), u, t)
        return values[: self.n], values[self.n : -self.n_z].reshape(self.n, self.n_z, -1)

    def x_rate(self, x: Array, z: Array, u: Array, t: Time) -> Array:
        """f1 + g z: Katayama, (1)."""
        f1, g = self._f1_and_g(x, u, t)
        return np.asarray(f1 + np.einsum("ijr,jr->ir", g, z))

    def explain(self, x: Array, rate: Array, u: Array, t: Time) -> Array:
        """Phi^-1 g' (x' - f1), Phi = g' g: the z of this rate, NaN where g loses rank."""
        f1, g = self._f1_and_g(x, u, t)
        phi = np.einsum("kir,kjr->rij", g, g)
        phi[np.linalg.det(phi) == 0.0] = np.nan
        right = np.einsum("kir,kr->ri", g, rate - f1)
        return np.asarray(np.linalg.solve(phi, right[..., None])[..., 0].T)

    def f2(self, x: Array, z: Array, u: Array, t: Time) -> Array:
        """f2, (n_z, runs)."""
        return self.values(np.concatenate((x, z)), u, t)[-self.n_z :]


class Chain(Plant):
    """One chain of a model of several: of the other chains' states it is told where they stand."""

    kind = "own"

    def __init__(self, model: Own, number: int) -> None:
        self.model, self.number = model, number
        self.n, self.n_u = model.orders[number], model.n_u
        first = sum(model.orders[:number])
        self.place = slice(first, first + self.n)
        self.unknown = bool(model.unknown) and model.unknown[number]
        self.stands: Array | None = None  # x_hat of all chains at the beginning of a step

    def known(self, x_hat: Array, u: Array | None, t: float) -> Array | None:
        """(0, ..., 0, phi_i), the states of the other chains held."""
        f = np.zeros_like(x_hat)
        if not self.unknown:
            f[-1] = self._values(x_hat, u, t)[self.number]
        return f

    @property
    def carries(self) -> bool:
        """Of this chain."""
        return bool(self.unknown)

    def enters(self, x_hat: Array, last: Array, u: Array | None, t: float) -> Array:
        """phi_i, where the last state of the chain is an unknown."""
        if not self.unknown:
            return last
        return self._values(np.concatenate((x_hat[:-1], last[None])), u, t)[self.number]

    def slope(self, x_hat: Array) -> Array | float:
        """The slope of phi_i in the unknown."""
        if not self.unknown:
            return 1.0
        return self._values(x_hat, None, 0.0)[len(self.model.orders) + self.number]

    def _values(self, x_hat: Array, u: Array | None, t: float) -> Array:
        assert self.stands is not None
        x = self.stands.copy()
        x[self.place] = x_hat
        return self.model.values(x, u, t)


class OwnPlant(Plant):
    """A plant of the user's own: dx = drift dt + diffusion dW, y = h, from a table of (t, x, u)."""

    kind = "own-plant"

    def __init__(self, spec: Spec, where: str) -> None:
        self.n = integer(member(spec, "n", where), f"{where}.n", least=1)
        self.n_u = integer(spec.get("n_u", 0), f"{where}.n_u", least=0)
        self.is_noisy = bool(spec.get("noisy", False))
        self.table, self.parameters = _table(spec, where)
        self.n_y = integer(spec.get("n_y", 1), f"{where}.n_y", least=1)
        outputs = (2 if self.is_noisy else 1) * self.n + self.n_y
        inputs = 1 + self.n + self.n_u + len(self.parameters)
        _fits(self.table, inputs, outputs, where)

    @property
    def noisy(self) -> bool:
        """Whether the table has a diffusion."""
        return self.is_noisy

    def _rows(self, x: Array, u: Array | None, t: float, first: int, count: int) -> Array:
        given = np.zeros(self.n_u) if u is None else u
        values = self.table([t, *x, *given, *self.parameters])[first : first + count]
        return np.stack([np.broadcast_to(value, x.shape[1:]) for value in values])

    def drift(self, x: Array, u: Array | None, t: float) -> Array:
        """Outputs 0 to n - 1."""
        return self._rows(x, u, t, 0, self.n)

    def diffusion(self, x: Array, u: Array | None, t: float) -> Array:
        """The next n outputs."""
        return self._rows(x, u, t, self.n, self.n) if self.noisy else np.zeros_like(x)

    def output(self, x: Array, u: Array | None, t: float) -> Array:
        """The last outputs."""
        y = self._rows(x, u, t, len(self.table.outputs) - self.n_y, self.n_y)
        return y if self.n_y > 1 else y[0]


def _table(spec: Spec, where: str) -> tuple[Any, Array]:
    """The table of a spec, or what is called like one, and the parameters: its last inputs."""
    table = member(spec, "table", where)
    if table is None:
        raise fail(f"{where}.table", None, "a table", "a Python callable cannot be run here")
    parameters = spec.get("parameters", ())
    called = table if callable(table) else Table(table, f"{where}.table")
    return called, vector(parameters, f"{where}.parameters", len(parameters))


def _fits(table: Any, inputs: int, outputs: int, where: str) -> None:
    sizes = (table.inputs, len(table.outputs))
    if sizes != (inputs, outputs):
        allowed = f"({inputs}, {outputs}) for this form"
        raise fail(f"{where}.table inputs and outputs", sizes, allowed, "correct the table")


CHAINED = "nonlinear-chain"
FORMS = ("phase", "triangular", CHAINED, "chains", "sampled", "strict-feedback")
KINDS = ("lee", "sanfelice-praly", "van-der-pol", "crackle", "ship", "own-plant")
MODELS = (*KINDS[:-1], "none", "input", "own")
KEYS: dict[str, tuple[str, ...]] = {
    "lee": (),
    "sanfelice-praly": ("nu1", "nu2"),
    "van-der-pol": ("epsilon", "sigma", "multiplicative"),
    "crackle": ("phi_max",),
    "ship": ("delta", "w"),
    "none": (),
    "input": ("b0",),
    "own": (
        *("form", "n", "n_u", "orders", "n_z", "unknown", "table", "parameters", "names", "units"),
    ),
    "own-plant": ("n", "n_u", "n_y", "noisy", "table", "parameters", "names"),
}


def plant_from(spec: Spec, where: str = "plant") -> Plant:
    """The plant that ``spec`` describes; as ``where`` = "model" what an observer knows."""
    allowed = KINDS if where == "plant" else MODELS
    kind = choice(member(spec, "kind", where), f"{where}.kind", allowed)
    known(spec, where, ("kind", *KEYS[kind]))
    if kind == "lee":
        return Lee()
    if kind == "sanfelice-praly":
        return SanfelicePraly(
            number(member(spec, "nu1", where), f"{where}.nu1"),
            number(spec.get("nu2", 0.1), f"{where}.nu2"),
        )
    if kind == "van-der-pol":
        return VanDerPol(
            number(spec.get("epsilon", 0.8), f"{where}.epsilon"),
            number(spec.get("sigma", 0.5), f"{where}.sigma", least=0.0),
            bool(spec.get("multiplicative", False)),
        )
    if kind == "crackle":
        return Crackle(number(spec.get("phi_max", 3.0), f"{where}.phi_max", least=0.5))
    if kind == "ship":
        return Ship(
            number(spec.get("delta", 0.0), f"{where}.delta"), spec.get("w", (0.0, 0.0, 0.0))
        )
    if kind == "own":
        return Own(spec, where)
    if kind == "own-plant":
        return OwnPlant(spec, where)
    if kind == "input":
        return InputGain(number(member(spec, "b0", where), f"{where}.b0"))
    return NoModel()
