"""sanfelice-praly-mc: the observer (20) of Sanfelice and Praly with the adaptive gain (6); the
plant (19) is held at its equilibrium, normal noise over `HOLD` steps.

Standard deviation of e2 of each run over the second half. A step: one of RK4, with y held, of three
states; every stage takes a power of r.

The kernels read where each plant rests and where its observer starts. As constants of the source
they let no compiler share more than the first stage, from which on noise sets the observers apart;
but x2, which rests at 0, was left out of the error.
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
from hgo_rs import (
    AdaptiveGain,
    Model,
    NormalNoise,
    Plant,
    SanfelicePraly,
    StandardObserver,
    reference,
    simulate,
)
from hgo_rs.reference.noise import MEASUREMENT
from hgo_rs.scenarios import sanfelice_praly as paper

HOLD = 2
H = paper.HOLD / HOLD
NU1, P1, P2, B = paper.NU1_STABLE, paper.P1, paper.P2, paper.B
K1, K2, POWER = paper.K1, paper.K2, 1.0 - 2.0 * paper.B
MEAN, STD = paper.NOISE_MEAN, paper.NOISE_STD
START = (paper.equilibrium(NU1), 0.0, *paper.printed_start())
SPREAD = (1e-3, 1e-3, 0.01, 0.01, 0.0)  # of x1, x2, x1_hat, x2_hat, r

STATES, PARAMETERS = ["x1", "x2"], {"nu1": NU1, "nu2": paper.NU2}
PLANT = Plant(states=STATES, parameters=PARAMETERS, drift=["x2 + nu1*x1 + nu2", "0"])  # (19)
MODEL = Model(states=STATES, parameters={"nu1": NU1}, f=["nu1*x1", "0"])


def window(size: Size) -> tuple[int, int]:
    """Steps over which the standard deviation is taken."""
    return size.steps // 2, size.steps


def starts(runs: int) -> Array:
    """x1, x2, x1_hat, x2_hat, r of each run, (runs, 5)."""
    return around(START, SPREAD, runs)


def ours(size: Size, threads: int, own: bool = False, **engine: Any) -> Call:
    built_in = SanfelicePraly(NU1, paper.NU2)
    plant, model = (PLANT, MODEL) if own else (built_in, built_in)
    observer = StandardObserver(
        2, AdaptiveGain(P1, P2, B), k=(K1, K2), model=model, method="rk4", timing="predictor"
    )
    seconds, begun = in_seconds(window(size), H), starts(size.runs)

    def call() -> Array:
        e2 = simulate(
            plant,
            observer,
            x0=begun[:, :2],
            memory0=begun[:, 2:],
            dt=H,
            steps=size.steps,
            plant_method="held",
            noise=NormalNoise(MEAN, STD, hold=paper.HOLD),
            runs=size.runs,
            rng=SEED,
            windows=[seconds],
            metrics=["mean", "rms"],
            errors=False,
            signals={"e_2": "x2_hat - x2"},
            **engine,
        ).of("e_2")
        return np.asarray(np.sqrt(np.maximum(e2["rms"] ** 2 - e2["mean"] ** 2, 0.0)))

    return call


def twin(size: Size, threads: int) -> Call:
    begun = starts(size.runs)
    observer, t_end = paper.observer(NU1), H * size.steps
    spec = paper.study(observer, [], H, t_end, runs=size.runs, seed=SEED)
    spec |= {"x0": begun[:, :2], "memory0": begun[:, 2:]}
    spec |= {"noise": paper.noise(MEAN, HOLD), "windows": [window(size)]}

    def call() -> Array:
        result = reference.simulate(spec)
        mean, rms = result["mean"][:, 0, 1:2], result["rms"][:, 0, 1:2]
        return np.asarray(np.sqrt(rms * rms - mean * mean))

    return call


def in_numba(size: Size, threads: int, own: bool = False) -> Call:
    numba = need("numba")
    first, _, normal = streams.numba_draws(own)
    begin, end = window(size)

    @numba.njit(fastmath=True, error_model="numpy")
    def rate(y: float, z1: float, z2: float, r: float) -> tuple[float, float, float]:
        e, r2 = y - z1, r * r
        r_rate = P1 * ((e * e - P2) * r**POWER + P2 / (r2 * r2))  # (6)
        return z2 + NU1 * z1 + K1 * r * e, K2 * r2 * e, r_rate  # (20)

    @numba.njit(fastmath=True, error_model="numpy")
    def one(words: streams.Words, run: int, start: Array) -> float:
        noise = first(words, run)
        x1, x2, z1, z2, r = start[0], start[1], start[2], start[3], start[4]
        y, total, squares = 0.0, 0.0, 0.0
        for k in range(end):
            if k >= begin:
                total += z2 - x2
                squares += (z2 - x2) * (z2 - x2)
            if k % HOLD == 0:
                noise, xi = normal(noise)
                y = x1 + (MEAN + STD * xi)
            a1, a2, ar = rate(y, z1, z2, r)
            b1, b2, br = rate(y, z1 + 0.5 * H * a1, z2 + 0.5 * H * a2, r + 0.5 * H * ar)
            c1, c2, cr = rate(y, z1 + 0.5 * H * b1, z2 + 0.5 * H * b2, r + 0.5 * H * br)
            d1, d2, dr = rate(y, z1 + H * c1, z2 + H * c2, r + H * cr)
            z1 += H / 6.0 * (a1 + 2.0 * (b1 + c1) + d1)
            z2 += H / 6.0 * (a2 + 2.0 * (b2 + c2) + d2)
            r = max(1.0, r + H / 6.0 * (ar + 2.0 * (br + cr) + dr))
        mean = total / (end - begin)
        return np.sqrt(squares / (end - begin) - mean * mean)

    words = streams.states(size.runs, MEASUREMENT)
    return streams.numba_study(one, words, starts(size.runs), threads)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    _, normal = streams.jax_draws()
    numpy = jax.numpy
    begin, end = window(size)

    def rate(y: Any, s: Any) -> Any:
        z1, z2, r = s
        e = y - z1
        r_rate = P1 * ((e * e - P2) * r**POWER + P2 / r**4)  # (6)
        return z2 + NU1 * z1 + K1 * r * e, K2 * r * r * e, r_rate  # (20)

    def plus(s: Any, h: float, d: Any) -> Any:
        return tuple(a + h * b for a, b in zip(s, d, strict=True))

    def run(words: Any, start: Any) -> Any:
        x1, x2, *begun = start

        def draw(carry: Any, k: Any) -> Any:
            noise, s, total, squares = carry
            noise, xi = normal(noise)
            y = x1 + (MEAN + STD * xi)
            for held in range(HOLD):
                late = k * HOLD + held >= begin
                e2 = s[1] - x2
                total += numpy.where(late, e2, 0.0)
                squares += numpy.where(late, e2 * e2, 0.0)
                a = rate(y, s)
                b = rate(y, plus(s, 0.5 * H, a))
                c = rate(y, plus(s, 0.5 * H, b))
                d = rate(y, plus(s, H, c))
                s = plus(plus(s, H / 6.0, plus(a, 1.0, d)), H / 3.0, plus(b, 1.0, c))
                s = (s[0], s[1], numpy.maximum(1.0, s[2]))
            return (noise, s, total, squares), None

        initial = (tuple(words), tuple(begun), 0.0, 0.0)
        _, _, total, squares = jax.lax.scan(draw, initial, numpy.arange(end // HOLD))[0]
        mean = total / (end - begin)
        return numpy.sqrt(squares / (end - begin) - mean * mean)[None]

    words = streams.states(size.runs, MEASUREMENT)
    return streams.jax_study(run, threads, words, starts(size.runs).T)


SOURCE = """
typedef struct { real z1, z2, r; } state;

/* The rate d of the observer, (20), and of its gain, (6), at s under y. */
INLINE void rate(const real y[BLOCKS], const state s[BLOCKS], state d[BLOCKS]) {
  real power[BLOCKS];
  EACH power[q] = s[q].r;
  ln(power, power);
  EACH power[q] *= POWER;
  exponential(power, power);
  EACH {
    real e = y[q] - s[q].z1, r = s[q].r, r2 = r * r;
    real r_rate = P1 * ((e * e - P2) * power[q] + P2 / (r2 * r2)); /* (6) */
    d[q] = (state){s[q].z2 + NU1 * s[q].z1 + K1 * r * e, K2 * r2 * e, r_rate}; /* (20) */
  }
}
INLINE state plus(state s, double h, state d) {
  return (state){s.z1 + h * d.z1, s.z2 + h * d.z2, s.r + h * d.r};
}

/* Standard deviation of e2 over [begin, end) of runs with plants at x1, x2 whose observers start at
   x1_hat, x2_hat, r: (5, runs). */
void sanfelice(int64_t first, int64_t last, int64_t runs, const uint64_t *words,
               const double *starts, int64_t begin, int64_t end, double *std) {
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    stream noise[BLOCKS];
    state s[BLOCKS], next[BLOCKS], trial[BLOCKS], d[BLOCKS];
    real x1[BLOCKS], x2[BLOCKS], y[BLOCKS], total[BLOCKS], squares[BLOCKS];
    EACH noise[q] = stream_of(AT(words, 0), runs), total[q] = squares[q] = all(0.0);
    EACH x1[q] = LOAD(AT(starts, 0)), x2[q] = LOAD(AT(starts, 1));
    EACH s[q] = (state){LOAD(AT(starts, 2)), LOAD(AT(starts, 3)), LOAD(AT(starts, 4))};
    for (int64_t k = 0; k < end; k++) {
      if (k >= begin) EACH {
        real e2 = s[q].z2 - x2[q];
        total[q] += e2, squares[q] += e2 * e2;
      }
      if (k % HOLD == 0) {
        normal(noise, y);
        EACH y[q] = x1[q] + (MEAN + STD * y[q]);
      }
      rate(y, s, d);
      EACH next[q] = plus(s[q], H / 6.0, d[q]), trial[q] = plus(s[q], 0.5 * H, d[q]);
      rate(y, trial, d);
      EACH next[q] = plus(next[q], H / 3.0, d[q]), trial[q] = plus(s[q], 0.5 * H, d[q]);
      rate(y, trial, d);
      EACH next[q] = plus(next[q], H / 3.0, d[q]), trial[q] = plus(s[q], H, d[q]);
      rate(y, trial, d);
      EACH s[q] = plus(next[q], H / 6.0, d[q]), s[q].r = larger(s[q].r, all(1.0));
    }
    EACH total[q] /= (double)(end - begin), squares[q] /= (double)(end - begin);
    EACH STORE(AT(std, 0), root(squares[q] - total[q] * total[q]));
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    observer = {"NU1": NU1, "P1": P1, "P2": P2, "K1": K1, "K2": K2, "POWER": POWER}
    noise = {"MEAN": MEAN, "STD": STD, "HOLD": HOLD}
    constants = {"H": H, **observer, **noise}
    words, std = streams.states(size.runs, MEASUREMENT), np.empty((size.runs, 1))
    given = words, np.ascontiguousarray(starts(size.runs).T), *window(size)
    return compiled.study(
        SOURCE, "sanfelice", (4, 8), size.runs, threads, *given, result=std, **constants
    )


WORKLOAD = Workload(
    "sanfelice-praly-mc",
    "std of e2, adaptive gain, RK4, normal noise held",
    (
        *columns(ours, in_c),
        Implementation("Numba", in_numba),
        Implementation("Numba, plain", partial(in_numba, own=True), independent=True),
        Implementation("JAX", in_jax, share=0.25),
        Implementation(TWIN, twin, share=0.05, parallel=False),
    ),
    full=Size(512, 4_000),
    quick=Size(128, 500),
    check=Size(64, 2_000),
)
