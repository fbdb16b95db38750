"""A real axis: velocity from a measured position, against the zero-phase reference.

The record (the EMPS benchmark of Janot, Gautier and Brunot) is not part of the project: the test
skips where it is absent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exported import in_c, lacking, on_the_chip, says_ok

import hgo_rs
from hgo_rs.cli import main

LOG = Path(__file__).parents[3] / "shared" / "data" / "DATA_EMPS.mat"
# Gain and bound [m/s]: lag falls with the gain, noise rises from here on. RMS velocity: 0.09 m/s.
LAWS = {
    "rk4-innovation-held --timing predictor": (550.0, 2.0e-4),
    "zoh": (1200.0, 1.0e-4),  # current timing, as for any log
}

pytestmark = pytest.mark.skipif(not LOG.exists(), reason="recorded data not present")


def reference_velocity(t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Fourth-order Butterworth at 100 Hz, forwards and backwards, before and after differences."""
    from scipy.signal import butter, filtfilt

    b, a = butter(4, 100.0, fs=1.0 / np.median(np.diff(t)))
    return np.asarray(filtfilt(b, a, np.gradient(filtfilt(b, a, q), t)))


@pytest.mark.parametrize("method", LAWS)
def test_velocity_of_a_real_axis(tmp_path: Path, method: str) -> None:
    from scipy.io import loadmat

    gain, bound = LAWS[method]
    out = tmp_path / "estimates.csv"
    words = f"estimate {LOG} --time t --output qm --observer low-power --order 3 --gain {gain}"
    with pytest.raises(SystemExit) as end:
        main([*words.split(), "--method", *method.split(), "--out", str(out)])
    assert end.value.code == 0
    assert out.with_suffix(".png").stat().st_size > 10_000

    record = loadmat(LOG)
    t, q = record["t"].ravel(), record["qm"].ravel()
    table = np.genfromtxt(out, delimiter=",", names=True)
    assert np.array_equal(table["t"], t)
    late = t - t[0] >= 1.0
    reference = reference_velocity(t, q)
    rms = np.sqrt(np.mean((table["x_hat2"] - reference)[late] ** 2))
    assert rms < bound


# Nothing is told twice: the order is the model's, and a log is run with current timing.
AXIS = """\
format = 1
observer = "standard"
gain = {ell}
poles = [[-0.5, 0.8660254037844386], [-0.5, -0.8660254037844386]]
method = "zoh"
log = {{ time = "t", output = "qm", input = "vir" }}
[model]
states = ["q", "v"]
inputs = ["V"]
parameters = {{ M = 95.1089, Fv = 203.5034, Fc = 20.3935, offset = -3.1648, gtau = 35.15 }}
phi = "(gtau*V - Fv*v - Fc*tanh(v/1e-3) - offset)/M"
"""
BEST_GAIN = 1000.0  # at 1 kHz as recorded


def test_velocity_from_one_file(tmp_path: Path) -> None:
    from scipy.io import loadmat

    config = tmp_path / "axis.toml"
    config.write_text(AXIS.format(ell=BEST_GAIN))
    result = hgo_rs.estimate(LOG, config)
    record = loadmat(LOG)
    t, q = record["t"].ravel(), record["qm"].ravel()
    error = (result.x_hat[:, 1] - reference_velocity(t, q))[t - t[0] >= 1.0]
    assert np.sqrt(np.mean(error**2)) < 3.4e-5  # m/s


@pytest.mark.parametrize("precision", ["double", "single"])
def test_one_file_on_host_and_chip(tmp_path: Path, precision: str) -> None:
    """The axis' own log, through its file's C: the bits of `run`, here and on a Cortex-M4F."""
    observer = hgo_rs.Config.from_toml(AXIS.format(ell=BEST_GAIN)).observer()
    log = hgo_rs.logs.read_log(LOG, time="t", output="qm", input="vir")
    some = slice(5000, 5500)
    vector = (log.t[some] - log.t[some][0], log.y[some], log.u[some])
    observer.export(to="c", out=tmp_path, name="axis", precision=precision, log=vector)
    assert says_ok(in_c(tmp_path, "axis"), 499)
    if lacking():
        pytest.skip(f"not installed: {lacking()}")
    assert says_ok(on_the_chip(tmp_path, "axis"), 499)
