"""online-step: one step of the standard observer, n = 2, from a Python loop.

The last estimate is compared. filterpy's Kalman filter is given the covariances under which its
steady gain is the observer's, so that it gives the same estimates.
"""

from __future__ import annotations

import ctypes
from functools import partial

import numpy as np

from compare import compiled
from compare.harness import (
    OURS,
    SEED,
    TWIN,
    Array,
    Call,
    Implementation,
    Size,
    Workload,
    need,
)
from hgo_rs import Model, StandardObserver, reference

T, ELL = 1e-3, 50.0
OBSERVER = StandardObserver(2, ELL, method="euler", timing="predictor")
K1, K2 = (k * ELL**i for i, k in enumerate(OBSERVER.spec["k"], 1))
F = np.array([[1.0, T], [0.0, 1.0]])


def samples(size: Size) -> list[float]:
    """A noisy position."""
    noise = np.random.default_rng(SEED).standard_normal(size.steps)
    values: list[float] = (np.sin(2.0 * T * np.arange(size.steps)) + 1e-3 * noise).tolist()
    return values


def ours(size: Size, threads: int, own: bool = False) -> Call:
    model = Model(states=["x1", "x2"], phi="0") if own else None
    ys = samples(size)
    observer = StandardObserver(2, ELL, model=model, method="euler", timing="predictor")

    def call() -> Array:
        observer.reset()
        for y in ys:
            x_hat = observer.step(y, dt=T)
        return x_hat

    return call


def ours_in_place(size: Size, threads: int) -> Call:
    """The same, written into a given array."""
    ys, observer, x_hat = (
        samples(size),
        StandardObserver(2, ELL, method="euler", timing="predictor"),
        np.empty(2),
    )

    def call() -> Array:
        observer.reset()
        for y in ys:
            observer.step(y, dt=T, out=x_hat)
        return x_hat

    return call


def in_c(size: Size, threads: int) -> Call:
    """Called through ctypes."""
    source = """
    /* One step by Euler. */
    void step(double *x, double y) {
      double e = y - x[0];
      x[0] += T * (x[1] + K1 * e), x[1] += T * K2 * e;
    }
    """
    step, ys, x_hat = compiled.library(source, T=T, K1=K1, K2=K2).step, samples(size), np.empty(2)
    step.argtypes, step.restype = [ctypes.c_void_p, ctypes.c_double], None
    place = x_hat.ctypes.data

    def call() -> Array:
        x_hat[:] = 0.0
        for y in ys:
            step(place, y)
        return x_hat

    return call


def in_numba(size: Size, threads: int) -> Call:
    numba, ys, x_hat = need("numba"), samples(size), np.empty(2)

    @numba.njit
    def step(x: Array, y: float) -> None:
        e = y - x[0]
        x[0] += T * (x[1] + K1 * e)
        x[1] += T * K2 * e

    def call() -> Array:
        x_hat[:] = 0.0
        for y in ys:
            step(x_hat, y)
        return x_hat

    return call


def in_python(size: Size, threads: int) -> Call:
    """Plain floats, the law written out in the loop."""
    ys = samples(size)

    def call() -> Array:
        x1, x2 = 0.0, 0.0
        for y in ys:
            e = y - x1
            x1, x2 = x1 + T * (x2 + K1 * e), x2 + T * K2 * e
        return np.array([x1, x2])

    return call


def in_plain_numpy(size: Size, threads: int) -> Call:
    """Two matrices."""
    ys, injection = samples(size), T * np.array([K1, K2])
    step = F - np.outer(injection, [1.0, 0.0])

    def call() -> Array:
        x = np.zeros(2)
        for y in ys:
            x = step @ x + injection * y
        return x

    return call


def twin(size: Size, threads: int) -> Call:
    ys, law = samples(size), reference.Observer(OBSERVER.spec)

    def call() -> Array:
        memory, t = law.initial(), 0.0
        for y in ys:
            memory, _ = law.step(memory, y, None, t, T)
            t += T
        return memory

    return call


def in_filterpy(size: Size, threads: int) -> Call:
    """Update and predict.

    With R = 1 the gain K = P C'/(P11 + 1) is F^-1 T (K1, K2) for the P below, which Riccati's
    equation keeps for Q = P - F (I - K C) P F'; P22 is such that Q is diagonal, and positive.
    """
    kalman = need("filterpy.kalman")
    k2 = T * K2
    k1 = T * K1 - T * k2
    p11 = k1 / (1.0 - k1)
    p12 = k2 * (1.0 + p11)
    p22 = k2 * p12 + k1 * p12 / T
    p = np.array([[p11, p12], [p12, p22]])
    q = p - F @ (p - np.outer([k1, k2], p[0])) @ F.T
    ys = samples(size)
    filter_ = kalman.KalmanFilter(dim_x=2, dim_z=1)
    filter_.F, filter_.H, filter_.Q, filter_.R = F, np.array([[1.0, 0.0]]), q, np.eye(1)

    def call() -> Array:
        filter_.x, filter_.P = np.zeros((2, 1)), p
        for y in ys:
            filter_.update(y)
            filter_.predict()
        return np.asarray(filter_.x)[:, 0]

    return call


WORKLOAD = Workload(
    "online-step",
    "one step from Python, standard n = 2",
    (
        Implementation(OURS, ours),
        Implementation("ours, own model", partial(ours, own=True), bits=OURS),
        Implementation("ours, out=", ours_in_place, bits=OURS),
        Implementation("C, ctypes", in_c),
        Implementation("Numba", in_numba),
        Implementation("Python, floats", in_python),
        Implementation("NumPy, plain", in_plain_numpy),
        Implementation("filterpy", in_filterpy, share=0.05),
        Implementation(TWIN, twin, share=0.05),
    ),
    full=Size(1, 20_000),
    quick=Size(1, 2_000),
    check=Size(1, 500),
    parallel=False,
    statistics=lambda x_hat: np.array(x_hat)[None, :],
)
