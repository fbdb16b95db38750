"""A real axis: velocity from a measured position, against the zero-phase reference.

The record (the EMPS benchmark of Janot, Gautier and Brunot) is not part of the project: the test
skips where it is absent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hgo_rs.cli import main

LOG = Path(__file__).parents[3] / "shared" / "data" / "DATA_EMPS.mat"
GAIN = 550.0  # lag falls with the gain, noise rises from here on

pytestmark = pytest.mark.skipif(not LOG.exists(), reason="recorded data not present")


def reference_velocity(t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Fourth-order Butterworth at 100 Hz, forwards and backwards, before and after differences."""
    from scipy.signal import butter, filtfilt

    b, a = butter(4, 100.0, fs=1.0 / np.median(np.diff(t)))
    return np.asarray(filtfilt(b, a, np.gradient(filtfilt(b, a, q), t)))


def test_velocity_of_a_real_axis(tmp_path: Path) -> None:
    from scipy.io import loadmat

    out = tmp_path / "estimates.csv"
    words = f"estimate {LOG} --time t --output qm --observer low-power --order 3 --gain {GAIN}"
    with pytest.raises(SystemExit) as end:
        main([*words.split(), "--method", "rk4-innovation-held", "--out", str(out)])
    assert end.value.code == 0
    assert out.with_suffix(".png").stat().st_size > 10_000

    record = loadmat(LOG)
    t, q = record["t"].ravel(), record["qm"].ravel()
    table = np.genfromtxt(out, delimiter=",", names=True)
    assert np.array_equal(table["t"], t)
    late = t - t[0] >= 1.0
    reference = reference_velocity(t, q)
    rms = np.sqrt(np.mean((table["x_hat2"] - reference)[late] ** 2))
    assert rms < 2.0e-4  # m/s, beside an RMS velocity of 0.09 m/s
