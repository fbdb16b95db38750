"""astolfi-vertices: the crackle system (20) of Astolfi, Marconi, Praly and Teel under the
peaking-free observer (11), n = 5, as one differential equation of 14 states.

The largest magnitude of each of the observer's nine states, for each of the 512 vertices of +-3
where it starts; the system starts around the paper's state. A step: one of Bogacki and Shampine's,
1 ms.

No run's observer acts on its system, so that systems that start alike move alike: with the paper's
one state for all as a constant, JAX's `vmap` moved one for all runs. The kernel in C has one block
and shared nothing; it too reads all starts now.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from compare import compiled, streams
from compare.harness import TWIN, Array, Call, Implementation, Size, Workload, around, need
from compare.studies import columns
from hgo_rs import Crackle, Model, PeakingFreeObserver, Plant, reference, simulate
from hgo_rs.scenarios import astolfi

ELL, H, R = astolfi.ELL["peaking-free"], astolfi.STEP, astolfi.R
A1, A2, A3, A4, A5 = (alpha * ELL for alpha in astolfi.ALPHA)
B1, B2, B3, B4 = (beta * ELL * ELL for beta in astolfi.BETA)
VERTICES = astolfi.vertices(9)
RUNS = len(VERTICES)
STARTS = np.hstack([around(astolfi.X0, [0.01] * 5, RUNS), VERTICES])
"""x (5), x_hat (5), eta (4) of each run, (RUNS, 14)."""

STATES = ["x1", "x2", "x3", "x4", "x5"]
PHI = "0.2*(x1*x1 - 1) - x2 - x3 - 4*x4 - x5"
PLANT = Plant(states=STATES, drift=[*STATES[1:], PHI])  # (20)
MODEL = Model(states=STATES, parameters={"r": R}, phi=f"saturate({PHI}, -r, r)")


def ours(size: Size, threads: int, own: bool = False, **engine: Any) -> Call:
    plant = PLANT if own else Crackle(R)
    observer = PeakingFreeObserver(
        5,
        ELL,
        saturation=R,
        alpha=astolfi.ALPHA,
        beta=astolfi.BETA,
        model=MODEL if own else Crackle(R),
        method="bogacki-shampine",
        timing="predictor",
    )

    def call() -> Array:
        return simulate(
            plant,
            observer,
            x0=STARTS[:, :5],
            memory0=STARTS[:, 5:],
            mode="joint",
            dt=H,
            steps=size.steps,
            runs=RUNS,
            **engine,
        ).peak

    return call


def twin(size: Size, threads: int) -> Call:
    observer = astolfi.observer("peaking-free", ELL)
    spec = astolfi.joint(observer, VERTICES, H, H * size.steps) | {"x0": STARTS[:, :5]}
    return lambda: reference.simulate(spec)["peak"]


def in_numba(size: Size, threads: int) -> Call:
    """A state is a tuple of 14, whose entries Numba keeps in registers."""
    numba, steps = need("numba"), size.steps
    jit = numba.njit(fastmath=True, error_model="numpy")

    @jit
    def clip(s: Any) -> Any:
        return min(max(s, -R), R)

    @jit
    def rate(s: Any) -> Any:
        x1, x2, x3, x4, x5, z1, z2, z3, z4, z5, n1, n2, n3, n4 = s
        s1, s2, s3, s4 = clip(n1), clip(n2), clip(n3), clip(n4)
        e1, e2, e3, e4, e5 = x1 - z1, s1 - z2, s2 - z3, s3 - z4, s4 - z5
        phi = 0.2 * (x1 * x1 - 1.0) - x2 - x3 - 4.0 * x4 - x5  # (20)
        phi_s = clip(0.2 * (z1 * z1 - 1.0) - z2 - z3 - 4.0 * z4 - z5)
        dz1, dz2, dz3 = n1 + A1 * e1, n2 + A2 * e2, n3 + A3 * e3  # (11)
        dz4, dz5 = n4 + A4 * e4, phi_s + A5 * e5
        dn1, dn2, dn3, dn4 = s2 + B1 * e1, s3 + B2 * e2, s4 + B3 * e3, phi_s + B4 * e4
        return x2, x3, x4, x5, phi, dz1, dz2, dz3, dz4, dz5, dn1, dn2, dn3, dn4

    @jit
    def plus(a: Any, h: Any, b: Any) -> Any:
        a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13, a14 = a
        b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, b12, b13, b14 = b
        a1, a2, a3, a4, a5 = a1 + h * b1, a2 + h * b2, a3 + h * b3, a4 + h * b4, a5 + h * b5
        a6, a7, a8, a9, a10 = a6 + h * b6, a7 + h * b7, a8 + h * b8, a9 + h * b9, a10 + h * b10
        a11, a12, a13, a14 = a11 + h * b11, a12 + h * b12, a13 + h * b13, a14 + h * b14
        return a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13, a14

    @jit
    def one(x: Array, z: Array, peak: Array) -> None:
        s = (x[0], x[1], x[2], x[3], x[4], z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7], z[8])
        for _ in range(steps):
            k1 = rate(s)
            k2 = rate(plus(s, 0.5 * H, k1))
            k3 = rate(plus(s, 0.75 * H, k2))
            s = plus(plus(plus(s, 2.0 * H / 9.0, k1), 3.0 * H / 9.0, k2), 4.0 * H / 9.0, k3)
            for i in range(9):
                peak[i] = max(peak[i], abs(s[5 + i]))

    @numba.njit(parallel=threads > 1)
    def study(starts: Array) -> Array:
        peaks = np.abs(starts[:, 5:])
        for run in numba.prange(RUNS):
            one(starts[run, :5], starts[run, 5:], peaks[run])
        return peaks

    return lambda: study(STARTS)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    jax.config.update("jax_enable_x64", True)
    numpy = jax.numpy
    alpha = np.array([A1, A2, A3, A4, A5])
    beta = np.array([B1, B2, B3, B4])

    def chain(s: Any, end: Any) -> Any:
        return numpy.concatenate([s, end[None]])

    def phi(x: Any) -> Any:
        return 0.2 * (x[0] * x[0] - 1.0) - x[1] - x[2] - 4.0 * x[3] - x[4]  # (20)

    def rate(state: Any) -> Any:
        x, z, eta = state
        passed = numpy.clip(eta, -R, R)
        e = numpy.concatenate([(x[0] - z[0])[None], passed - z[1:]])
        phi_s = numpy.clip(phi(z), -R, R)
        z_rate = chain(eta, phi_s) + alpha * e  # (11)
        return chain(x[1:], phi(x)), z_rate, chain(passed[1:], phi_s) + beta * e[:4]

    def plus(s: Any, *terms: Any) -> Any:
        return tuple(a + sum(h * d[i] for h, d in terms) for i, a in enumerate(s))

    def run(start: Any) -> Any:
        def step(carry: Any, _: Any) -> Any:
            s, peak = carry
            k1 = rate(s)
            k2 = rate(plus(s, (0.5 * H, k1)))
            k3 = rate(plus(s, (0.75 * H, k2)))
            s = plus(s, (2.0 * H / 9.0, k1), (3.0 * H / 9.0, k2), (4.0 * H / 9.0, k3))
            return (s, numpy.maximum(peak, numpy.abs(numpy.concatenate(s[1:])))), None

        initial = ((start[:5], start[5:10], start[10:]), numpy.abs(start[5:]))
        return jax.lax.scan(step, initial, None, length=size.steps)[0][1]

    return streams.jax_study(run, threads, STARTS.T)


SOURCE = """
static const double a[5] = ALPHA, b[4] = BETA;

INLINE real clip(real s) { return larger(smaller(s, all(R)), all(-R)); }
INLINE real phi(const real x[5]) { /* (20), in a short chain of operations */
  return (0.2 * x[0] * x[0] - 0.2) - ((x[1] + x[2]) + (4.0 * x[3] + x[4]));
}

/* The rate d of x[5], x_hat[5], eta[4] at `at`, (20) and (11), used at once: next = from + w d, and
   trial = s + h d. */
INLINE void stage(const real at[14], const real s[14], const real from[14], double w, double h,
                  real next[14], real trial[14]) {
  const real *x = at, *z = at + 5, *eta = at + 10;
  real phi_s = clip(phi(z)), passed[5] = {x[0]};
#pragma GCC unroll 8
  for (int i = 0; i < 4; i++) passed[i + 1] = clip(eta[i]);
#pragma GCC unroll 8
  for (int i = 0; i < 5; i++) {
    real e = passed[i] - z[i], d[3];
    d[0] = i < 4 ? x[i + 1] : phi(x);
    d[1] = (i < 4 ? eta[i] : phi_s) + a[i] * e;
    d[2] = i < 4 ? (i < 3 ? passed[i + 2] : phi_s) + b[i] * e : all(0.0);
#pragma GCC unroll 8
    for (int j = 0, n = i; j < 3; j++, n += 5)
      if (n < 14) next[n] = from[n] + w * d[j], trial[n] = s[n] + h * d[j];
  }
}

/* Largest magnitudes of x_hat, eta, (9, runs), of runs that start at x, x_hat, eta, (14, runs). */
void astolfi(int64_t first, int64_t last, int64_t runs, const double *starts, int64_t steps,
             double *peaks) {
  for (int64_t run = first; run < last; run += RUNS) {
    real s[14], next[14], second[14], third[14], peak[9];
    for (int i = 0; i < 14; i++) s[i] = LOAD(starts + i * runs + run);
    for (int i = 0; i < 9; i++) peak[i] = magnitude(s[5 + i]);
    for (int64_t n = 0; n < steps; n++) {
      stage(s, s, s, 2.0 * H / 9.0, 0.5 * H, next, second);
      stage(second, s, next, 3.0 * H / 9.0, 0.75 * H, next, third);
      stage(third, s, next, 4.0 * H / 9.0, 0.0, s, second);
      for (int i = 0; i < 9; i++) peak[i] = larger(peak[i], magnitude(s[5 + i]));
    }
    for (int i = 0; i < 9; i++) STORE(peaks + i * runs + run, peak[i]);
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    alpha, beta = (A1, A2, A3, A4, A5), (B1, B2, B3, B4)
    kernel = compiled.library(SOURCE, H=H, R=R, ALPHA=alpha, BETA=beta).astolfi
    starts, peaks = np.ascontiguousarray(STARTS.T), np.empty((9, RUNS))
    call = compiled.call(kernel, RUNS, threads, starts, size.steps, result=peaks)
    return lambda: call().T


WORKLOAD = Workload(
    "astolfi-vertices",
    "peaks, peaking-free n = 5, 512 vertices, Bogacki-Shampine",
    (
        *columns(ours, in_c),
        Implementation("Numba", in_numba),
        Implementation("JAX", in_jax, share=0.1),
        Implementation(TWIN, twin, share=0.05, parallel=False),
    ),
    full=Size(RUNS, round(astolfi.T_END / H)),
    quick=Size(RUNS, 300),
    check=Size(RUNS, 500),
)
