"""One step of each scheme.  States are columns: shape (components, runs)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .error import Array

if TYPE_CHECKING:
    from .models import Plant, VanDerPol

Rate = Callable[[float, Array], Array]


def euler(rate: Rate, t: float, x: Array, h: float) -> Array:
    """Forward Euler, order 1."""
    return x + h * rate(t, x)


def rk4(rate: Rate, t: float, x: Array, h: float) -> Array:
    """The classical Runge-Kutta scheme, order 4."""
    half = 0.5 * h
    k1 = rate(t, x)
    k2 = rate(t + half, x + half * k1)
    k3 = rate(t + half, x + half * k2)
    k4 = rate(t + h, x + h * k3)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def bogacki_shampine(rate: Rate, t: float, x: Array, h: float) -> Array:
    """Bogacki-Shampine (1989) with a fixed step, order 3."""
    k1 = rate(t, x)
    k2 = rate(t + 0.5 * h, x + 0.5 * h * k1)
    k3 = rate(t + 0.75 * h, x + 0.75 * h * k2)
    return x + h / 9.0 * (2.0 * k1 + 3.0 * k2 + 4.0 * k3)


DETERMINISTIC: dict[str, Callable[[Rate, float, Array, float], Array]] = {
    "euler": euler,
    "rk4": rk4,
    "bogacki-shampine": bogacki_shampine,
}


def brownian(h: float, xi1: Array, xi2: Array) -> tuple[Array, Array]:
    """dW = int dw and dZ = int (w(s) - w(0)) ds over a step ``h``, from standard normals.

    Kloeden, Platen (1992), section 10.4: E dW^2 = h, E dZ^2 = h^3/3, E dW dZ = h^2/2.
    """
    return np.sqrt(h) * xi1, 0.5 * h * np.sqrt(h) * (xi1 + xi2 / np.sqrt(3.0))


def euler_maruyama(
    plant: Plant, x: Array, h: float, dw: Array, dz: Array, t: float, u: Array | None = None
) -> Array:
    """Euler-Maruyama: Fu, Kang, Li, eq. (4).  Strong order 1/2, 1 for additive noise."""
    return x + plant.drift(x, u, t) * h + plant.diffusion(x, u, t) * dw


def milstein(
    plant: VanDerPol, x: Array, h: float, dw: Array, dz: Array, t: float, u: Array | None = None
) -> Array:
    """Milstein, strong order 1 (one Wiener process)."""
    return (
        x
        + plant.drift(x, u, t) * h
        + plant.diffusion(x, u, t) * dw
        + 0.5 * plant.diffusion_derivative(x) * (dw * dw - h)
    )


def taylor_15(
    plant: VanDerPol, x: Array, h: float, dw: Array, dz: Array, t: float, u: Array | None = None
) -> Array:
    """Strong order 1.5 Taylor scheme for additive noise, one Wiener process.

    x + a h + b dW + (J b) dZ + (J a + 1/2 b'(d2a/dx2) b) h^2/2: Kloeden, Platen (1992), (10.4.5).
    """
    a = plant.drift(x, u, t)
    b = plant.diffusion(x, u, t)
    ja = plant.jacobian_times(x, a) + plant.curvature(x)
    return x + a * h + b * dw + plant.jacobian_times(x, b) * dz + ja * (0.5 * h * h)


STOCHASTIC: dict[str, Callable[..., Array]] = {
    "euler-maruyama": euler_maruyama,
    "milstein": milstein,
    "taylor-1.5": taylor_15,
}
