"""High-gain observers of the literature: one definition each, from notebook to microcontroller.

Each module is loaded when a name of it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hgo_rs.config import Config, ConfigError, load
    from hgo_rs.errors import DesignError, HgoError
    from hgo_rs.estimation import estimate
    from hgo_rs.exports import export
    from hgo_rs.gains import (
        AdaptiveGain,
        ConstantGain,
        DeadZoneGain,
        FixedStep,
        StochasticApproximation,
    )
    from hgo_rs.gaps import gap_bound
    from hgo_rs.models import (
        Crackle,
        InputGain,
        Lee,
        SanfelicePraly,
        Ship,
        System,
        Unknown,
        VanDerPol,
    )
    from hgo_rs.noise import (
        Noise,
        NormalNoise,
        RecordedNoise,
        Sines,
        UniformNoise,
        filtered_noise,
    )
    from hgo_rs.observers import (
        LowPowerObserver,
        ModifiedObserver,
        MultiOutputObserver,
        Observer,
        PeakingFreeObserver,
        ReducedOrderObserver,
        RepelledCollection,
        SampledDataObserver,
        StandardObserver,
    )
    from hgo_rs.own import Model, Plant
    from hgo_rs.results import Gap, RunResult, SimulationResult
    from hgo_rs.simulation import simulate
    from hgo_rs.studies import StudyError, StudyInterrupted, StudyProgress, StudyResult, study
    from hgo_rs.tuning import TradeOff, Tuning, TuningWarning, tune

__version__ = "0.1.0"

__all__ = [
    "AdaptiveGain",
    "Config",
    "ConfigError",
    "ConstantGain",
    "Crackle",
    "DeadZoneGain",
    "DesignError",
    "FixedStep",
    "Gap",
    "HgoError",
    "InputGain",
    "Lee",
    "LowPowerObserver",
    "Model",
    "ModifiedObserver",
    "MultiOutputObserver",
    "Noise",
    "NormalNoise",
    "Observer",
    "PeakingFreeObserver",
    "Plant",
    "RecordedNoise",
    "ReducedOrderObserver",
    "RepelledCollection",
    "RunResult",
    "SampledDataObserver",
    "SanfelicePraly",
    "Ship",
    "SimulationResult",
    "Sines",
    "StandardObserver",
    "StochasticApproximation",
    "StudyError",
    "StudyInterrupted",
    "StudyProgress",
    "StudyResult",
    "System",
    "TradeOff",
    "Tuning",
    "TuningWarning",
    "UniformNoise",
    "Unknown",
    "VanDerPol",
    "__version__",
    "estimate",
    "export",
    "filtered_noise",
    "gap_bound",
    "load",
    "simulate",
    "study",
    "tune",
]

_MODULES = (
    "config",
    "errors",
    "estimation",
    "exports",
    "gains",
    "gaps",
    "models",
    "noise",
    "observers",
    "own",
    "results",
    "simulation",
    "studies",
    "tuning",
)


def __getattr__(name: str) -> Any:
    """A public name, or a module, on its first use (PEP 562)."""
    if name in (*_MODULES, "design", "expressions", "reference", "_core"):
        return import_module(f"hgo_rs.{name}")
    if name in __all__:
        for module in map(import_module, (f"hgo_rs.{name}" for name in _MODULES)):
            if name in module.__all__:
                globals()[name] = value = getattr(module, name)
                return value
    raise AttributeError(f"module 'hgo_rs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_MODULES})
