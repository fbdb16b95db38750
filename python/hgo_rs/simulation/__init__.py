"""Simulation: a plant, noise and an observer, over one run or many; `studies` over many cases."""

from __future__ import annotations

from hgo_rs.simulation.experiment import simulate
from hgo_rs.simulation.feedback import Controller
from hgo_rs.simulation.noise import (
    ColouredNoise,
    ImpulsiveNoise,
    LaplaceNoise,
    Noise,
    NormalNoise,
    RecordedNoise,
    Sines,
    StudentTNoise,
    UniformNoise,
    filtered_noise,
)
from hgo_rs.simulation.result import SimulationResult

__all__ = [
    "ColouredNoise",
    "Controller",
    "ImpulsiveNoise",
    "LaplaceNoise",
    "Noise",
    "NormalNoise",
    "RecordedNoise",
    "SimulationResult",
    "Sines",
    "StudentTNoise",
    "UniformNoise",
    "filtered_noise",
    "simulate",
]
