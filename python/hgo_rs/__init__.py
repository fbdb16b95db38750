"""High-gain observers of the literature: one definition each, from notebook to microcontroller.

Each module is loaded when a name of it is first used.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hgo_rs import upward
from hgo_rs._version import __version__

if TYPE_CHECKING:
    from hgo_rs.config import Config, ConfigError, load
    from hgo_rs.errors import DesignError, HgoError
    from hgo_rs.exports import export
    from hgo_rs.logs import estimate
    from hgo_rs.models import (
        Crackle,
        InputGain,
        Lee,
        Model,
        Plant,
        SanfelicePraly,
        Ship,
        System,
        Unknown,
        VanDerPol,
    )
    from hgo_rs.observers import (
        AdaptiveGain,
        BiHomogeneous,
        ConstantGain,
        DeadZone,
        DeadZoneGain,
        Fal,
        FixedStep,
        Gap,
        HighGainEKF,
        HighGainObserver,
        HomogeneousGain,
        InnovationGain,
        LowPowerObserver,
        ModifiedObserver,
        MultiOutputObserver,
        Observer,
        PeakingFreeObserver,
        PiecewiseLinear,
        PrescribedTimeGain,
        ReducedOrderObserver,
        RepelledCollection,
        RunResult,
        SampledDataObserver,
        StandardObserver,
        StochasticApproximation,
        Stubborn,
        SwitchedGain,
        WindowObserver,
        gap_bound,
    )
    from hgo_rs.simulation import (
        ColouredNoise,
        Controller,
        ImpulsiveNoise,
        LaplaceNoise,
        Noise,
        NormalNoise,
        RecordedNoise,
        SimulationResult,
        Sines,
        StudentTNoise,
        UniformNoise,
        filtered_noise,
        simulate,
    )
    from hgo_rs.simulation.studies import (
        StudyError,
        StudyInterrupted,
        StudyProgress,
        StudyResult,
        study,
    )
    from hgo_rs.smoothing import (
        Comparison,
        Derivative,
        Fit,
        Smoothed,
        compare,
        differentiate,
        fit,
        smooth,
    )
    from hgo_rs.tuning import TradeOff, Tuning, TuningWarning, tune

__all__ = [
    "AdaptiveGain",
    "BiHomogeneous",
    "ColouredNoise",
    "Comparison",
    "Config",
    "ConfigError",
    "ConstantGain",
    "Controller",
    "Crackle",
    "DeadZone",
    "DeadZoneGain",
    "Derivative",
    "DesignError",
    "Fal",
    "Fit",
    "FixedStep",
    "Gap",
    "HgoError",
    "HighGainEKF",
    "HighGainObserver",
    "HomogeneousGain",
    "ImpulsiveNoise",
    "InnovationGain",
    "InputGain",
    "LaplaceNoise",
    "Lee",
    "LowPowerObserver",
    "Model",
    "ModifiedObserver",
    "MultiOutputObserver",
    "Noise",
    "NormalNoise",
    "Observer",
    "PeakingFreeObserver",
    "PiecewiseLinear",
    "Plant",
    "PrescribedTimeGain",
    "RecordedNoise",
    "ReducedOrderObserver",
    "RepelledCollection",
    "RunResult",
    "SampledDataObserver",
    "SanfelicePraly",
    "Ship",
    "SimulationResult",
    "Sines",
    "Smoothed",
    "StandardObserver",
    "StochasticApproximation",
    "Stubborn",
    "StudentTNoise",
    "StudyError",
    "StudyInterrupted",
    "StudyProgress",
    "StudyResult",
    "SwitchedGain",
    "System",
    "TradeOff",
    "Tuning",
    "TuningWarning",
    "UniformNoise",
    "Unknown",
    "VanDerPol",
    "WindowObserver",
    "__version__",
    "compare",
    "differentiate",
    "estimate",
    "export",
    "filtered_noise",
    "fit",
    "gap_bound",
    "load",
    "simulate",
    "smooth",
    "study",
    "tune",
]

_MODULES = (
    "errors",
    "models",
    "observers",
    "simulation",
    "simulation.studies",
    "config",
    "logs",
    "exports",
    "tuning",
    "smoothing",
)
"""Where the names stand, those of lower floors first."""

_PUBLIC = (
    "config",
    "data",
    "design",
    "errors",
    "exports",
    "expressions",
    "laws",
    "logs",
    "models",
    "observers",
    "plots",
    "reference",
    "scenarios",
    "simulation",
    "smoothing",
    "tuning",
)
"""Modules of which names are public beside those of `__all__`."""


def __getattr__(name: str) -> Any:
    """A public name, or a module, on its first use (PEP 562)."""
    if name in (*_PUBLIC, "_core"):
        return import_module(f"hgo_rs.{name}")
    if name in __all__:
        for module in map(import_module, (f"hgo_rs.{name}" for name in _MODULES)):
            if name in module.__all__:
                globals()[name] = value = getattr(module, name)
                return value
    raise AttributeError(f"module 'hgo_rs' has no attribute {name!r}")


def _later(module: str, name: str) -> Callable[..., Any]:
    """A function of a module that is loaded when it is called."""
    return lambda *given, **named: getattr(import_module(f"hgo_rs.{module}"), name)(*given, **named)


# what an observer does by floors above its own
upward.register("export", _later("exports", "export"))
upward.register("save", _later("config", "save"))
upward.register("deviation", _later("smoothing.deviation", "deviation"))
upward.register("gated", _later("smoothing.deviation", "gated"))
upward.register("page", _later("pages", "write"))
upward.register("widget", _later("pages", "widget"))
upward.register("to_control", _later("exports.control", "to_control"))


def __dir__() -> list[str]:
    """Public names alone, and the modules behind them."""
    return sorted({*__all__, *_PUBLIC})
