"""loop-mc: output feedback of x1' = x2, x2' = x2^3 + u on the standard observer's estimates, Euler,
uniform noise; starts and noise differ from run to run.

RMS of x1 of each run over the second half. A step: a draw, the saturated feedback, the
observer's Euler step under it, the plant's of RK4 with it held.
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
from hgo_rs import Model, Plant, StandardObserver, UniformNoise, simulate
from hgo_rs.reference.noise import MEASUREMENT

T, ELL = 1e-3, 50.0
K1, K2 = 2.0, 1.0
LOW, HIGH = -1e-3, 1e-3
SPREAD = (0.2, 0.1, 0.05, 0.0)  # of x1, x2 and their estimates
STATES, INPUTS = ["x1", "x2"], ["u"]
PLANT = Plant(states=STATES, inputs=INPUTS, drift=["x2", "x2*x2*x2 + u"])
MODEL = Model(states=STATES, inputs=INPUTS, phi="u")
FEEDBACK = {"u": "saturate(-x2_hat*x2_hat*x2_hat - x1_hat - x2_hat, -1, 1)"}


def window(size: Size) -> tuple[int, int]:
    """Steps over which the RMS is taken."""
    return size.steps // 2, size.steps


def starts(runs: int) -> Array:
    """x1, x2, x1_hat, x2_hat of each run, (runs, 4)."""
    return around((0.0,) * 4, SPREAD, runs)


def ours(size: Size, threads: int, own: bool = False, backend: str = "rust", **engine: Any) -> Call:
    form: dict[str, Any] = {"method": "euler", "timing": "predictor"}
    observer = StandardObserver(2, ELL, k=[K1, K2], model=MODEL, **form)
    seconds, begun = in_seconds(window(size), T), starts(size.runs)

    def call() -> Array:
        run = simulate(
            PLANT,
            observer,
            x0=begun[:, :2],
            memory0=begun[:, 2:],
            dt=T,
            steps=size.steps,
            plant_method="rk4",
            feedback=FEEDBACK,
            signals=["x1"],
            errors=False,
            noise=UniformNoise(LOW, HIGH),
            runs=size.runs,
            rng=SEED,
            windows=[seconds],
            metrics=["rms"],
            backend=backend,
            **engine,
        )
        return run.of("x1")["rms"]

    return call


def twin(size: Size, threads: int) -> Call:
    return ours(size, threads, backend="numpy")


def moved(x1: Any, x2: Any, u: Any) -> tuple[Any, Any]:
    """The plant after a step of RK4, for Numba and JAX."""
    a1, a2 = x2, x2 * x2 * x2 + u
    b1 = x2 + 0.5 * T * a2
    b2 = b1 * b1 * b1 + u
    c1 = x2 + 0.5 * T * b2
    c2 = c1 * c1 * c1 + u
    d1 = x2 + T * c2
    d2 = d1 * d1 * d1 + u
    x1 = x1 + T / 6.0 * (a1 + 2.0 * (b1 + c1) + d1)
    x2 = x2 + T / 6.0 * (a2 + 2.0 * (b2 + c2) + d2)
    return x1, x2


def in_numba(size: Size, threads: int, own: bool = False) -> Call:
    numba = need("numba")
    first, uniform, _ = streams.numba_draws(own)
    begin, end = window(size)
    move = numba.njit(fastmath=True, error_model="numpy")(moved)

    @numba.njit(fastmath=True, error_model="numpy")
    def one(words: streams.Words, run: int, start: Array) -> float:
        noise = first(words, run)
        x1, x2, z1, z2 = start[0], start[1], start[2], start[3]
        squares = 0.0
        for k in range(end):
            if k >= begin:
                squares += x1 * x1
            noise, v = uniform(noise)
            cube = z2 * z2 * z2
            u = min(max(-cube - z1 - z2, -1.0), 1.0)
            e = x1 + (LOW + (HIGH - LOW) * v) - z1
            z1, z2 = z1 + T * (z2 + K1 * ELL * e), z2 + T * (u + K2 * ELL * ELL * e)
            x1, x2 = move(x1, x2, u)
        return np.sqrt(squares / (end - begin))

    words = streams.states(size.runs, MEASUREMENT)
    return streams.numba_study(one, words, starts(size.runs), threads)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    uniform, _ = streams.jax_draws()
    numpy = jax.numpy
    begin, end = window(size)

    def run(words: Any, start: Any) -> Any:
        def step(state: Any, k: Any) -> Any:
            noise, x1, x2, z1, z2, squares = state
            squares += numpy.where(k >= begin, x1 * x1, 0.0)
            noise, v = uniform(noise)
            cube = z2 * z2 * z2
            u = numpy.clip(-cube - z1 - z2, -1.0, 1.0)
            e = x1 + (LOW + (HIGH - LOW) * v) - z1
            z1, z2 = z1 + T * (z2 + K1 * ELL * e), z2 + T * (u + K2 * ELL * ELL * e)
            x1, x2 = moved(x1, x2, u)
            return (noise, x1, x2, z1, z2, squares), None

        squares = jax.lax.scan(step, (tuple(words), *start, 0.0), numpy.arange(end))[0][-1]
        return numpy.sqrt(squares / (end - begin))[None]

    words = streams.states(size.runs, MEASUREMENT)
    return streams.jax_study(run, threads, words, starts(size.runs).T)


SOURCE = """
/* RMS of x1 over [begin, end) of loops that start at x1, x2, x1_hat, x2_hat,
   (4, runs). */
void loop(int64_t first, int64_t last, int64_t runs, const uint64_t *words, const double *starts,
          int64_t begin, int64_t end, double *rms) {
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    stream noise[BLOCKS];
    real x1[BLOCKS], x2[BLOCKS], z1[BLOCKS], z2[BLOCKS], squares[BLOCKS];
    EACH noise[q] = stream_of(AT(words, 0), runs), squares[q] = all(0.0);
    EACH x1[q] = LOAD(AT(starts, 0)), x2[q] = LOAD(AT(starts, 1));
    EACH z1[q] = LOAD(AT(starts, 2)), z2[q] = LOAD(AT(starts, 3));
    for (int64_t k = 0; k < end; k++) {
      if (k >= begin) EACH squares[q] += x1[q] * x1[q];
      EACH {
        real cube = z2[q] * z2[q] * z2[q];
        real u = smaller(larger(-cube - z1[q] - z2[q], all(-1.0)), all(1.0));
        real e = x1[q] + (LOW + (HIGH - LOW) * uniform(&noise[q])) - z1[q];
        z1[q] += T * (z2[q] + K1 * ELL * e), z2[q] += T * (u + K2 * ELL * ELL * e);
        real a1 = x2[q], a2 = a1 * a1 * a1 + u;
        real b1 = x2[q] + 0.5 * T * a2, b2 = b1 * b1 * b1 + u;
        real c1 = x2[q] + 0.5 * T * b2, c2 = c1 * c1 * c1 + u;
        real d1 = x2[q] + T * c2, d2 = d1 * d1 * d1 + u;
        x1[q] += T / 6.0 * (a1 + 2.0 * (b1 + c1) + d1);
        x2[q] += T / 6.0 * (a2 + 2.0 * (b2 + c2) + d2);
      }
    }
    EACH STORE(AT(rms, 0), root(squares[q] / (double)(end - begin)));
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    constants = {"T": T, "ELL": ELL, "K1": K1, "K2": K2, "LOW": LOW, "HIGH": HIGH}
    words, rms = streams.states(size.runs, MEASUREMENT), np.empty((size.runs, 1))
    given = words, np.ascontiguousarray(starts(size.runs).T), *window(size)
    return compiled.study(
        SOURCE, "loop", (2, 4), size.runs, threads, *given, result=rms, **constants
    )


WORKLOAD = Workload(
    "loop-mc",
    "RMS of x1, saturated feedback of estimates, uniform noise",
    (
        *(one for one in columns(ours, in_c) if "own model" not in one.name),  # all are own
        Implementation("Numba", in_numba),
        Implementation("Numba, plain", partial(in_numba, own=True), independent=True),
        Implementation("JAX", in_jax, share=0.25),
        Implementation(TWIN, twin, share=0.05, parallel=False),
    ),
    full=Size(1024, 20_000),
    quick=Size(256, 1_000),
    check=Size(64, 1_500),
)
