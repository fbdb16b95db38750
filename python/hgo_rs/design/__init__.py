"""Coefficients and certificates, all computed: what to choose before an observer runs.

Importing this package loads NumPy alone; SciPy is loaded by the functions that need it, cvxpy and
Clarabel (``pip install "hgo_rs[design]"``) by ``lmi_step`` and ``adaptation_design``.
"""

from __future__ import annotations

from .adaptation import (
    AdaptationCertificate,
    AdaptationDesign,
    AdaptationRates,
    ErrorBound,
    adaptation_design,
    best_d,
    check_adaptation,
    collection_gain,
    error_bound,
    error_bound_vanishing,
    largest_noise,
    repulsion_gains,
    smallest_p2,
)
from .coefficients import (
    LowPowerCoefficients,
    companion,
    levant_coefficients,
    low_power_coefficients,
    low_power_matrix,
    low_power_polynomial,
    observer_coefficients,
    routh_hurwitz,
)
from .delay import delay_limit
from .discrete import Continuous, Discrete, continuous, discrete
from .discretisation import StepLimit, check_step, step_limit
from .low_power import (
    LowPowerStability,
    h_infinity_norm,
    largest_real_part,
    low_power_small_gain_design,
    low_power_strong_stability,
)
from .lyapunov import crackle_gradient, ell_frozen, ell_star, lipschitz_constant, lyapunov
from .response import (
    bandwidth,
    innovation_covariance,
    innovation_gain,
    model_gain,
    noise_gain,
    peaking,
    settling,
)
from .riccati import SteadyGains, poles_of_gains, riccati
from .stochastic_approximation import (
    StationaryError,
    StepCertificate,
    StepSizes,
    clock,
    lmi_step,
    norm_bound,
    schur_limit,
    stationary_error,
    step_margin,
    step_sizes,
)

__all__ = [
    "AdaptationCertificate",
    "AdaptationDesign",
    "AdaptationRates",
    "Continuous",
    "Discrete",
    "ErrorBound",
    "LowPowerCoefficients",
    "LowPowerStability",
    "StationaryError",
    "SteadyGains",
    "StepCertificate",
    "StepLimit",
    "StepSizes",
    "adaptation_design",
    "bandwidth",
    "best_d",
    "check_adaptation",
    "check_step",
    "clock",
    "collection_gain",
    "companion",
    "continuous",
    "crackle_gradient",
    "delay_limit",
    "discrete",
    "ell_frozen",
    "ell_star",
    "error_bound",
    "error_bound_vanishing",
    "h_infinity_norm",
    "innovation_covariance",
    "innovation_gain",
    "largest_noise",
    "largest_real_part",
    "levant_coefficients",
    "lipschitz_constant",
    "lmi_step",
    "low_power_coefficients",
    "low_power_matrix",
    "low_power_polynomial",
    "low_power_small_gain_design",
    "low_power_strong_stability",
    "lyapunov",
    "model_gain",
    "noise_gain",
    "norm_bound",
    "observer_coefficients",
    "peaking",
    "poles_of_gains",
    "repulsion_gains",
    "riccati",
    "routh_hurwitz",
    "schur_limit",
    "settling",
    "smallest_p2",
    "stationary_error",
    "step_limit",
    "step_margin",
    "step_sizes",
]
