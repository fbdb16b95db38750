"""Systems: the papers' plants, and what an observer knows of a system.

Each object is a small immutable description; `spec` is plain data, read-only, that the compiled
core and the NumPy reference both understand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hgo_rs.errors import check, check_array, check_number
from hgo_rs.read_only import Described


@dataclass(frozen=True)
class System(Described):
    """A system as the model of an observer and, for a plant, to simulate.

    Base of the systems here and of the user's own, `hgo_rs.Model` and `hgo_rs.Plant`.
    """

    @property
    def order(self) -> int | None:
        """Order that an observer of this system must have; None: any."""
        return None

    @property
    def bounds(self) -> tuple[float, ...] | None:
        """Known bounds of |x_i| along the system's own trajectories, if any."""
        return None

    @property
    def n_u(self) -> int:
        """Number of known inputs u."""
        return 0

    @property
    def moves(self) -> bool:
        """Whether the known terms depend on the state or the time, and so change over a period."""
        return True

    @property
    def own_slope(self) -> float | None:
        """Bound of |df_i/dx_i| [1/s] of the known terms; inf where one may jump in x_i. None where
        it is not known.
        """
        return None


@dataclass(frozen=True)
class Unknown(System):
    """No model: phi = 0. The observer is then a differentiator. Any order."""

    _kind = ("kind", "none")

    @property
    def moves(self) -> bool:
        return False


@dataclass(frozen=True)
class InputGain(System):
    """A chain of integrators driven by one known input: phi = b0 u. Any order.

    Parameters
    ----------
    b0 : float
        Input gain, in units of the n-th derivative of y for one unit of u.
    """

    _kind = ("kind", "input")

    b0: float

    def __post_init__(self) -> None:
        check_number(self.b0, "b0")

    @property
    def n_u(self) -> int:
        return 1

    @property
    def moves(self) -> bool:
        return False


@dataclass(frozen=True)
class Lee(System):
    """x1' = x2, x2' = -x1/(1 + x1^2) - x2, y = x1. Lee, Choi and Khalil (38). State (2,)."""

    _kind = ("kind", "lee")

    @property
    def own_slope(self) -> float:
        """|d phi/dx2| = 1."""
        return 1.0

    @property
    def order(self) -> int:
        return 2


@dataclass(frozen=True)
class SanfelicePraly(System):
    """x1' = x2 + nu1 x1 + nu2, x2' = 0, y = x1. Sanfelice and Praly (19). State (2,).

    An observer knows nu1 [1/s] and not nu2.
    """

    _kind = ("kind", "sanfelice-praly")

    nu1: float
    nu2: float = 0.1

    def __post_init__(self) -> None:
        check_number(self.nu1, "nu1")
        check_number(self.nu2, "nu2")

    @property
    def own_slope(self) -> float:
        """|nu1|, of the known term of x1'."""
        return abs(self.nu1)

    @property
    def order(self) -> int:
        return 2

    @property
    def equilibrium(self) -> tuple[float, float]:
        """The state (-nu2/nu1, 0) at which the paper's example rests; nu1 must not be 0."""
        remedy = "with nu1 = 0 every x2 = -nu2 is at rest"
        check(self.nu1, "nu1", self.nu1, "different from 0", remedy)
        return (-self.nu2 / self.nu1, 0.0)


@dataclass(frozen=True)
class VanDerPol(System):
    """dx1 = x2 dt, dx2 = [-x1 + epsilon (1 - x1^2) x2] dt + g dW, y = x1. Fu, Kang and Li (18).

    g = sigma, or sigma x2 where `multiplicative`. State (2,).
    """

    _kind = ("kind", "van-der-pol")

    epsilon: float = 0.8
    sigma: float = 0.5
    multiplicative: bool = False

    def __post_init__(self) -> None:
        check_number(self.epsilon, "epsilon")
        check_number(self.sigma, "sigma", least=0.0)

    @property
    def own_slope(self) -> float:
        """|epsilon|: |d phi/dx2| where |x1| <= 1."""
        return abs(self.epsilon)

    @property
    def order(self) -> int:
        return 2


@dataclass(frozen=True)
class Crackle(System):
    """The chaotic crackle system, order 5. Astolfi, Marconi, Praly and Teel (1), (20). State (5,).

    x_i' = x_{i+1}, x5' = phi(x) = 0.2 (x1^2 - 1) - x2 - x3 - 4 x4 - x5, y = x1. An observer uses
    phi clipped at +-phi_max.
    """

    _kind = ("kind", "crackle")

    phi_max: float = 3.0

    def __post_init__(self) -> None:
        check_number(
            self.phi_max,
            "phi_max",
            least=0.5,
            remedy="|phi| reaches 0.5 along the system's own trajectory; take the paper's 3",
        )

    @property
    def own_slope(self) -> float:
        """|d phi/dx5| = 1."""
        return 1.0

    @property
    def order(self) -> int:
        return 5

    @property
    def bounds(self) -> tuple[float, ...]:
        """|x1| < 2.5, |x2| < 1, |x3|, |x4|, |x5| < 0.5 from x(0) = (-0.8, 0, 0, 0, 0)."""
        return (2.5, 1.0, 0.5, 0.5, 0.5)


@dataclass(frozen=True)
class Ship(System):
    """A ship of three degrees of freedom under its tracking controller. Katayama (20), (21).

    State (6,): position x1, x2 [m] and heading x3 [rad], then surge z1, sway z2 [m/s] and yaw
    rate z3 [rad/s]. y = (x1, x2, x3). Inputs u (2,): surge force over mass [m/s^2] and rudder.

    Parameters
    ----------
    delta : float
        Model uncertainty in [-0.5, 0.5], unknown to the observer.
    w : tuple of three floats
        Disturbance [m/s^2, m/s^2, rad/s^2], unknown to the observer.
    """

    _kind = ("kind", "ship")

    delta: float = 0.0
    w: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_number(self.delta, "delta", least=-0.5, most=0.5)
        w = check_array(self.w, "w")
        fits = w.shape == (3,) and np.isfinite(w).all()
        check(fits, "w", self.w, "three finite numbers", "give one disturbance for each z_i")
        object.__setattr__(self, "w", tuple(w.tolist()))  # no list of the caller's

    @property
    def n_u(self) -> int:
        return 2
