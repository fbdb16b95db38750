"""High-gain observers of the literature: one definition each, from notebook to microcontroller."""

from __future__ import annotations

from hgo_rs.errors import DesignError, HgoError
from hgo_rs.gains import (
    AdaptiveGain,
    ConstantGain,
    DeadZoneGain,
    FixedStep,
    StochasticApproximation,
)
from hgo_rs.models import Crackle, InputGain, Lee, Model, SanfelicePraly, Ship, Unknown, VanDerPol
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
    Observer,
    PeakingFreeObserver,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    StandardObserver,
)
from hgo_rs.results import Gap, RunResult, SimulationResult
from hgo_rs.simulate import simulate
from hgo_rs.studies import StudyError, StudyInterrupted, StudyProgress, StudyResult, study

__version__ = "0.1.0"

__all__ = [
    "AdaptiveGain",
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
    "Noise",
    "NormalNoise",
    "Observer",
    "PeakingFreeObserver",
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
    "UniformNoise",
    "Unknown",
    "VanDerPol",
    "__version__",
    "filtered_noise",
    "simulate",
    "study",
]
