"""The observers: one class a law, over the compiled core; gain laws and schedules."""

from __future__ import annotations

from hgo_rs.design.discrete import METHODS, TIMINGS
from hgo_rs.observers.arguments import MotionWarning
from hgo_rs.observers.base import Observer
from hgo_rs.observers.collection import CopiesMetWarning, ModifiedObserver, RepelledCollection
from hgo_rs.observers.gains import (
    AdaptiveGain,
    ConstantGain,
    DeadZoneGain,
    FixedStep,
    HomogeneousGain,
    InnovationGain,
    PrescribedTimeGain,
    StochasticApproximation,
    SwitchedGain,
)
from hgo_rs.observers.gaps import gap_bound
from hgo_rs.observers.high_gain_ekf import HighGainEKF
from hgo_rs.observers.listed import HighGainObserver
from hgo_rs.observers.low_power import LowPowerObserver, PeakingFreeObserver
from hgo_rs.observers.reduced_order import ReducedOrderObserver
from hgo_rs.observers.result import Gap, RunResult
from hgo_rs.observers.sampled_data import SampledDataObserver
from hgo_rs.observers.several_outputs import MultiOutputObserver
from hgo_rs.observers.shapes import BiHomogeneous, DeadZone, Fal, PiecewiseLinear, Shape, Stubborn
from hgo_rs.observers.standard import StandardObserver
from hgo_rs.observers.turns import TurnWarning
from hgo_rs.observers.window import WindowObserver

__all__ = [
    "METHODS",
    "TIMINGS",
    "AdaptiveGain",
    "BiHomogeneous",
    "ConstantGain",
    "CopiesMetWarning",
    "DeadZone",
    "DeadZoneGain",
    "Fal",
    "FixedStep",
    "Gap",
    "HighGainEKF",
    "HighGainObserver",
    "HomogeneousGain",
    "InnovationGain",
    "LowPowerObserver",
    "ModifiedObserver",
    "MotionWarning",
    "MultiOutputObserver",
    "Observer",
    "PeakingFreeObserver",
    "PiecewiseLinear",
    "PrescribedTimeGain",
    "ReducedOrderObserver",
    "RepelledCollection",
    "RunResult",
    "SampledDataObserver",
    "Shape",
    "StandardObserver",
    "StochasticApproximation",
    "Stubborn",
    "SwitchedGain",
    "TurnWarning",
    "WindowObserver",
    "gap_bound",
]
