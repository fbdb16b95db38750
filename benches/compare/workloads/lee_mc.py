"""lee-mc: plant (38) of Lee, Choi and Khalil, the fixed-step observer (42), uniform noise.

RMS of e2 of each run from `BEGIN` on. A step: a draw, the plant's Euler step, the observer's.

Two cases: every run starts elsewhere; and all start alike, where the plant, which no noise reaches,
moves the same way in all runs and may be moved once. The kernels do not know it: they read their
starts in both cases. (While the starts were constants of the source, GCC moved one plant for the
four blocks, a division in place of four, and JAX's `vmap` one for all runs.)
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
from hgo_rs import Lee, Model, Plant, StandardObserver, UniformNoise, reference, simulate
from hgo_rs.reference.noise import MEASUREMENT
from hgo_rs.scenarios import lee

T, ELL = lee.T, 1.0 / lee.EPSILON
K1, K2 = lee.H
NOISE: dict[str, Any] = lee.NOISE
LOW, HIGH = NOISE["low"], NOISE["high"]
BEGIN = 0.2  # of the steps
SPREAD = (1.0, 1.0, 0.5, 0.5)  # of x1, x2 and their estimates
STATES = ["x1", "x2"]
E2 = {"e_2": "x2_hat - x2"}
"""The only number of which the kernels take the RMS."""
PLANT = Plant(states=STATES, drift=["x2", "-x1/(1 + x1*x1) - x2"])  # (38)
MODEL = Model(states=STATES, phi="0")


def window(size: Size) -> tuple[int, int]:
    """Steps over which the RMS is taken."""
    return round(BEGIN * size.steps), size.steps


def starts(runs: int, alike: bool = False) -> Array:
    """x1, x2, x1_hat, x2_hat of each run, (runs, 4)."""
    return around((*lee.X0, 0.0, 0.0), (0.0,) * 4 if alike else SPREAD, runs)


def begun(runs: int, alike: bool) -> dict[str, Any]:
    """The starts as `simulate` takes them; one for all runs where they are alike."""
    rows = starts(runs, alike)
    rows = rows[0] if alike else rows
    return {"x0": rows[..., :2], "memory0": rows[..., 2:]}


def ours(size: Size, threads: int, own: bool = False, alike: bool = False, **engine: Any) -> Call:
    observer, noise = (
        StandardObserver(
            2,
            epsilon=lee.EPSILON,
            k=lee.H,
            model=MODEL if own else None,
            method="euler",
            timing="predictor",
        ),
        UniformNoise(LOW, HIGH),
    )
    plant, seconds = PLANT if own else Lee(), in_seconds(window(size), T)
    given = begun(size.runs, alike)

    def call() -> Array:
        return simulate(
            plant,
            observer,
            **given,
            dt=T,
            steps=size.steps,
            plant_method="euler",
            noise=noise,
            runs=size.runs,
            rng=SEED,
            windows=[seconds],
            metrics=["rms"],
            errors=False,
            signals=E2,
            **engine,
        ).of("e_2")["rms"]

    return call


def twin(size: Size, threads: int, alike: bool = False) -> Call:
    spec = lee.study("fixed", size.steps, noise=NOISE, runs=size.runs, seed=SEED)
    spec |= {"windows": [window(size)], **begun(size.runs, alike)}
    return lambda: reference.simulate(spec)["rms"][:, 0, 1:2]


def in_numba(size: Size, threads: int, own: bool = False) -> Call:
    numba = need("numba")
    first, uniform, _ = streams.numba_draws(own)
    begin, end = window(size)

    @numba.njit(fastmath=True, error_model="numpy")
    def one(words: streams.Words, run: int, start: Array) -> float:
        noise = first(words, run)
        x1, x2, q1, q2, squares = start[0], start[1], start[2], start[3], 0.0
        for k in range(end):
            if k >= begin:
                squares += (q2 - x2) * (q2 - x2)
            noise, u = uniform(noise)
            e = x1 + (LOW + (HIGH - LOW) * u) - q1
            q1, q2 = q1 + T * (q2 + K1 * ELL * e), q2 + T * (K2 * ELL * ELL * e)  # (42)
            x1, x2 = x1 + T * x2, x2 + T * (-x1 / (1.0 + x1 * x1) - x2)  # (38)
        return np.sqrt(squares / (end - begin))

    words = streams.states(size.runs, MEASUREMENT)
    return streams.numba_study(one, words, starts(size.runs), threads)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    uniform, _ = streams.jax_draws()
    begin, end = window(size)

    def run(words: Any, start: Any) -> Any:
        def step(state: Any, k: Any) -> Any:
            noise, x1, x2, q1, q2, squares = state
            squares += jax.numpy.where(k >= begin, (q2 - x2) * (q2 - x2), 0.0)
            noise, u = uniform(noise)
            e = x1 + (LOW + (HIGH - LOW) * u) - q1
            q1, q2 = q1 + T * (q2 + K1 * ELL * e), q2 + T * (K2 * ELL * ELL * e)  # (42)
            x1, x2 = x1 + T * x2, x2 + T * (-x1 / (1.0 + x1 * x1) - x2)  # (38)
            return (noise, x1, x2, q1, q2, squares), None

        squares = jax.lax.scan(step, (tuple(words), *start, 0.0), jax.numpy.arange(end))[0][-1]
        return jax.numpy.sqrt(squares / (end - begin))[None]

    words = streams.states(size.runs, MEASUREMENT)
    return streams.jax_study(run, threads, words, starts(size.runs).T)


SOURCE = """
/* RMS of e2 over [begin, end) of runs that start at x1, x2, x1_hat, x2_hat, (4, runs). */
void lee(int64_t first, int64_t last, int64_t runs, const uint64_t *words, const double *starts,
         int64_t begin, int64_t end, double *rms) {
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    stream noise[BLOCKS];
    real x1[BLOCKS], x2[BLOCKS], q1[BLOCKS], q2[BLOCKS], squares[BLOCKS];
    EACH noise[q] = stream_of(AT(words, 0), runs), squares[q] = all(0.0);
    EACH x1[q] = LOAD(AT(starts, 0)), x2[q] = LOAD(AT(starts, 1));
    EACH q1[q] = LOAD(AT(starts, 2)), q2[q] = LOAD(AT(starts, 3));
    for (int64_t k = 0; k < end; k++) {
      if (k >= begin) EACH squares[q] += (q2[q] - x2[q]) * (q2[q] - x2[q]);
      EACH {
        real e = x1[q] + (LOW + (HIGH - LOW) * uniform(&noise[q])) - q1[q];
        real x2_rate = -x1[q] / (1.0 + x1[q] * x1[q]) - x2[q]; /* (38) */
        x1[q] += T * x2[q], x2[q] += T * x2_rate;
        q1[q] += T * (q2[q] + K1 * ELL * e), q2[q] += T * (K2 * ELL * ELL) * e; /* (42) */
      }
    }
    EACH STORE(AT(rms, 0), root(squares[q] / (double)(end - begin)));
  }
}
"""


def in_c(size: Size, threads: int, alike: bool = False) -> Call:
    constants = {"T": T, "ELL": ELL, "K1": K1, "K2": K2, "LOW": LOW, "HIGH": HIGH}
    words, rms = streams.states(size.runs, MEASUREMENT), np.empty((size.runs, 1))
    given = words, np.ascontiguousarray(starts(size.runs, alike).T), *window(size)
    return compiled.study(
        SOURCE, "lee", (2, 4), size.runs, threads, *given, result=rms, **constants
    )


def case(name: str, alike: bool, *others: Implementation) -> Workload:
    """All runs from elsewhere, or all alike."""
    return Workload(
        "lee-mc",
        "RMS of e2, fixed-step observer, uniform noise",
        (
            *columns(partial(ours, alike=alike), partial(in_c, alike=alike)),
            *others,
            Implementation(TWIN, partial(twin, alike=alike), share=0.1, parallel=False),
        ),
        full=Size(1024, 40_000),
        quick=Size(256, 2_000),
        check=Size(64, 1_500),
        case=name,
    )


WORKLOADS = (
    case(
        "",
        False,
        Implementation("Numba", in_numba),
        Implementation("Numba, plain", partial(in_numba, own=True), independent=True),
        Implementation("JAX", in_jax, share=0.25),
    ),
    case("one start", True),
)
