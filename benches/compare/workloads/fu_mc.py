"""fu-mc: the Van der Pol oscillator (18) of Fu, Kang and Li and their sampled-data observer (5).

Mean of ||x_hat - x||^2 of each run, from where the paper takes it on. A step: a normal value, the
plant's Euler-Maruyama step, the observer's.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from compare import compiled, streams
from compare.harness import (
    OURS,
    SEED,
    TWIN,
    Array,
    Call,
    Implementation,
    Size,
    Workload,
    forced,
    in_seconds,
    need,
)
from hgo_rs import SampledDataObserver, VanDerPol, reference, simulate
from hgo_rs.reference.noise import PROCESS
from hgo_rs.scenarios import fu

T = min(fu.STATIONARY["derived"])
EPSILON, SIGMA = fu.EPSILON, fu.SIGMA
(X1, X2), (Z1, Z2) = fu.X0, fu.X_HAT0
BEGIN = fu.T_SETTLED / fu.T_END  # of the steps
DW = SIGMA * float(np.sqrt(T))


def window(size: Size) -> tuple[int, int]:
    """Steps over which the mean is taken."""
    return round(BEGIN * size.steps), size.steps


def ours(size: Size, threads: int) -> Call:
    plant = VanDerPol(EPSILON, SIGMA)
    observer = SampledDataObserver(plant, gain="derived")
    seconds = in_seconds(window(size), T)

    def call() -> Array:
        rms = simulate(
            plant,
            observer,
            x0=fu.X0,
            memory0=fu.X_HAT0,
            dt=T,
            steps=size.steps,
            plant_method="euler-maruyama",
            runs=size.runs,
            rng=SEED,
            windows=[seconds],
            metrics=["rms"],
        ).rms[:, 0]
        return np.asarray(np.sum(rms * rms, axis=1, keepdims=True))

    return call


def twin(size: Size, threads: int) -> Call:
    spec = fu.study("derived", T, T * size.steps, runs=size.runs, seed=SEED)
    spec |= {"plant_method": "euler-maruyama", "substeps": 1, "windows": [window(size)]}
    return lambda: np.sum(reference.simulate(spec)["rms"][:, 0] ** 2, axis=1, keepdims=True)


def in_numba(size: Size, threads: int, own: bool = False) -> Call:
    numba = need("numba")
    start, _, normal = streams.numba_draws(own)
    begin, end = window(size)

    @numba.njit(fastmath=True, error_model="numpy")
    def one(words: streams.Words, run: int) -> float:
        process = start(words, run)
        x1, x2, z1, z2, squares = X1, X2, Z1, Z2, 0.0
        for k in range(end):
            if k >= begin:
                squares += (z1 - x1) * (z1 - x1) + (z2 - x2) * (z2 - x2)
            process, xi = normal(process)
            mu = EPSILON * (1.0 - x1 * x1)
            l2 = 5.0 - EPSILON * (z1 + x1) * z2 + (5.0 + mu) * mu
            e = x1 - z1
            z2_rate = -z1 + EPSILON * (1.0 - z1 * z1) * z2 + l2 * e
            z1, z2 = z1 + T * (z2 + (5.0 + mu) * e), z2 + T * z2_rate  # (5)
            x1, x2 = x1 + T * x2, x2 + T * (mu * x2 - x1) + DW * xi  # (18), (4)
        return squares / (end - begin)

    return streams.numba_study(one, streams.states(size.runs, PROCESS), threads)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    _, normal = streams.jax_draws()
    begin, end = window(size)

    def run(words: Any) -> Any:
        def step(state: Any, k: Any) -> Any:
            process, x1, x2, z1, z2, squares = state
            square = (z1 - x1) * (z1 - x1) + (z2 - x2) * (z2 - x2)
            squares += jax.numpy.where(k >= begin, square, 0.0)
            process, xi = normal(process)
            mu = EPSILON * (1.0 - x1 * x1)
            l2 = 5.0 - EPSILON * (z1 + x1) * z2 + (5.0 + mu) * mu
            e = x1 - z1
            z2_rate = -z1 + EPSILON * (1.0 - z1 * z1) * z2 + l2 * e
            z1, z2 = z1 + T * (z2 + (5.0 + mu) * e), z2 + T * z2_rate  # (5)
            x1, x2 = x1 + T * x2, x2 + T * (mu * x2 - x1) + DW * xi  # (18), (4)
            return (process, x1, x2, z1, z2, squares), None

        initial = (tuple(words), X1, X2, Z1, Z2, 0.0)
        squares = jax.lax.scan(step, initial, jax.numpy.arange(end))[0][-1]
        return (squares / (end - begin))[None]

    return streams.jax_study(run, streams.states(size.runs, PROCESS), threads)


SOURCE = """
void fu(int64_t first, int64_t last, int64_t runs, const uint64_t *words, int64_t begin,
        int64_t end, double *mean_square) {
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    stream process[BLOCKS];
    real x1[BLOCKS], x2[BLOCKS], z1[BLOCKS], z2[BLOCKS], squares[BLOCKS], xi[BLOCKS];
    EACH process[q] = stream_of(words, runs, run + RUNS * q), squares[q] = all(0.0);
    EACH x1[q] = all(X1), x2[q] = all(X2), z1[q] = all(Z1), z2[q] = all(Z2);
    for (int64_t k = 0; k < end; k++) {
      normal(process, xi);
      EACH {
        real e = x1[q] - z1[q], e2 = x2[q] - z2[q];
        if (k >= begin) squares[q] += e * e + e2 * e2;
        real mu = EPSILON * (1.0 - x1[q] * x1[q]);
        real l2 = 5.0 - EPSILON * (z1[q] + x1[q]) * z2[q] + (5.0 + mu) * mu;
        real z2_rate = EPSILON * (1.0 - z1[q] * z1[q]) * z2[q] - z1[q] + l2 * e;
        z1[q] += T * (z2[q] + (5.0 + mu) * e), z2[q] += T * z2_rate; /* (5) */
        real x2_rate = mu * x2[q] - x1[q];
        x1[q] += T * x2[q], x2[q] += T * x2_rate + DW * xi[q]; /* (18), (4) */
      }
    }
    EACH STORE(mean_square + run + RUNS * q, squares[q] / (double)(end - begin));
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    start = {"X1": X1, "X2": X2, "Z1": Z1, "Z2": Z2}
    kernel = compiled.library(SOURCE, blocks=4, T=T, EPSILON=EPSILON, DW=DW, **start).fu
    words, mean_square = streams.states(size.runs, PROCESS), np.empty((size.runs, 1))
    return compiled.call(kernel, size.runs, threads, words, *window(size), result=mean_square)


WORKLOAD = Workload(
    "fu-mc",
    "mean ‖e‖², sampled-data observer, Euler-Maruyama, normal noise",
    (
        Implementation(OURS, ours),
        Implementation("ours, AVX2", forced(ours, "avx2"), parallel=False),
        Implementation("C", in_c),
        Implementation("C, rounded", compiled.rounded(in_c), parallel=False),
        Implementation("Numba", in_numba),
        Implementation("Numba, plain", partial(in_numba, own=True), independent=True),
        Implementation("JAX", in_jax, share=0.25),
        Implementation(TWIN, twin, share=0.1, parallel=False),
    ),
    full=Size(1024, 10_000),
    quick=Size(256, 1_000),
    check=Size(64, 1_000),
)
