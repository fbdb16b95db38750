"""fu-mc: the Van der Pol oscillator (18) of Fu, Kang and Li and their sampled-data observer (5).

Mean of ||x_hat - x||^2 of each run, from where the paper takes it on. A step: a normal value, the
plant's Euler-Maruyama step, the observer's.

The kernels read their starts. Constants of the source did not matter much: process noise sets the
plants apart in the first step, so that neither GCC nor JAX's `vmap` had more than it to share.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from compare import compiled, streams
from compare.harness import (
    SEED,
    TWIN,
    Array,
    Call,
    Implementation,
    Size,
    Workload,
    around,
    in_seconds,
    need,
)
from compare.studies import columns
from hgo_rs import Model, Plant, SampledDataObserver, VanDerPol, reference, simulate
from hgo_rs.reference.noise import PROCESS
from hgo_rs.scenarios import fu

T = min(fu.STATIONARY["derived"])
EPSILON, SIGMA = fu.EPSILON, fu.SIGMA
BEGIN = fu.T_SETTLED / fu.T_END  # of the steps
SPREAD = (0.2, 0.2, 0.2, 0.2)  # of x1, x2 and their estimates
DW = SIGMA * float(np.sqrt(T))

STATES, PARAMETERS = ["x1", "x2"], {"epsilon": EPSILON, "sigma": SIGMA}
DRIFT = ["x2", "-x1 + epsilon*(1 - x1*x1)*x2"]
MU = "epsilon*(1 - y*y)"
PLANT = Plant(states=STATES, parameters=PARAMETERS, drift=DRIFT, diffusion=["0", "sigma"])  # (18)
MODEL = Model(
    states=STATES,
    parameters=PARAMETERS,
    f=DRIFT,
    K_T=[  # (5)
        f"(5 + {MU})*T*(y - x1)",
        f"(5 - epsilon*(x1 + y)*x2 + (5 + {MU})*({MU}))*T*(y - x1)",
    ],
)


def window(size: Size) -> tuple[int, int]:
    """Steps over which the mean is taken."""
    return round(BEGIN * size.steps), size.steps


def starts(runs: int) -> Array:
    """x1, x2, x1_hat, x2_hat of each run, (runs, 4)."""
    return around((*fu.X0, *fu.X_HAT0), SPREAD, runs)


def ours(size: Size, threads: int, own: bool = False, **engine: Any) -> Call:
    built_in = VanDerPol(EPSILON, SIGMA)
    plant = PLANT if own else built_in
    observer = SampledDataObserver(MODEL) if own else SampledDataObserver(built_in, gain="derived")
    seconds, begun = in_seconds(window(size), T), starts(size.runs)

    def call() -> Array:
        rms = simulate(
            plant,
            observer,
            x0=begun[:, :2],
            memory0=begun[:, 2:],
            dt=T,
            steps=size.steps,
            plant_method="euler-maruyama",
            runs=size.runs,
            rng=SEED,
            windows=[seconds],
            metrics=["rms"],
            **engine,
        ).rms[:, 0]
        return np.asarray(np.sum(rms * rms, axis=1, keepdims=True))

    return call


def twin(size: Size, threads: int) -> Call:
    spec = fu.study("derived", T, T * size.steps, runs=size.runs, seed=SEED)
    spec |= {"plant_method": "euler-maruyama", "substeps": 1, "windows": [window(size)]}
    begun = starts(size.runs)
    spec |= {"x0": begun[:, :2], "memory0": begun[:, 2:]}
    return lambda: np.sum(reference.simulate(spec)["rms"][:, 0] ** 2, axis=1, keepdims=True)


def in_numba(size: Size, threads: int, own: bool = False) -> Call:
    numba = need("numba")
    first, _, normal = streams.numba_draws(own)
    begin, end = window(size)

    @numba.njit(fastmath=True, error_model="numpy")
    def one(words: streams.Words, run: int, start: Array) -> float:
        process = first(words, run)
        x1, x2, z1, z2, squares = start[0], start[1], start[2], start[3], 0.0
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

    words = streams.states(size.runs, PROCESS)
    return streams.numba_study(one, words, starts(size.runs), threads)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    _, normal = streams.jax_draws()
    begin, end = window(size)

    def run(words: Any, start: Any) -> Any:
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

        squares = jax.lax.scan(step, (tuple(words), *start, 0.0), jax.numpy.arange(end))[0][-1]
        return (squares / (end - begin))[None]

    words = streams.states(size.runs, PROCESS)
    return streams.jax_study(run, threads, words, starts(size.runs).T)


SOURCE = """
/* Mean of |x_hat - x|^2 over [begin, end), of runs from x1, x2, x1_hat, x2_hat, (4, runs). */
void fu(int64_t first, int64_t last, int64_t runs, const uint64_t *words, const double *starts,
        int64_t begin, int64_t end, double *mean_square) {
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    stream process[BLOCKS];
    real x1[BLOCKS], x2[BLOCKS], z1[BLOCKS], z2[BLOCKS], squares[BLOCKS], xi[BLOCKS];
    EACH process[q] = stream_of(AT(words, 0), runs), squares[q] = all(0.0);
    EACH x1[q] = LOAD(AT(starts, 0)), x2[q] = LOAD(AT(starts, 1));
    EACH z1[q] = LOAD(AT(starts, 2)), z2[q] = LOAD(AT(starts, 3));
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
    EACH STORE(AT(mean_square, 0), squares[q] / (double)(end - begin));
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    constants = {"T": T, "EPSILON": EPSILON, "DW": DW}
    words, mean_square = streams.states(size.runs, PROCESS), np.empty((size.runs, 1))
    given = words, np.ascontiguousarray(starts(size.runs).T), *window(size)
    return compiled.study(
        SOURCE, "fu", (4, 8), size.runs, threads, *given, result=mean_square, **constants
    )


WORKLOAD = Workload(
    "fu-mc",
    "mean ‖e‖², sampled-data observer, Euler-Maruyama, normal noise",
    (
        *columns(ours, in_c),
        Implementation("Numba", in_numba),
        Implementation("Numba, plain", partial(in_numba, own=True), independent=True),
        Implementation("JAX", in_jax, share=0.25),
        Implementation(TWIN, twin, share=0.1, parallel=False),
    ),
    full=Size(1024, 10_000),
    quick=Size(256, 1_000),
    check=Size(64, 1_000),
)
