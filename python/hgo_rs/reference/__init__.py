"""The NumPy twin of the core: every law, plant and scheme, written to be read beside the papers."""

from .observers import Observer
from .simulate import coupled_paths, mean_covariance, simulate

__all__ = ["Observer", "coupled_paths", "mean_covariance", "simulate"]
