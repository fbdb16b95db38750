"""katayama-ship: Katayama's ship (20) under its controller (21), the reduced-order observer (22).

RMS of z - z_hat, three velocities, of runs that start around the paper's state, from `BEGIN` on.
A step: the controller, one RK4 step of the ship's six states, the observer's step.

The ships' starts were read all along; the observers', 0 in the paper, are read too now. Constant
ones let no compiler share more than a difference in the first step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from compare import compiled, streams
from compare.harness import (
    TWIN,
    Array,
    Call,
    Implementation,
    LeftOut,
    Size,
    Workload,
    around,
    in_seconds,
    need,
)
from compare.studies import columns
from hgo_rs import HgoError, Model, ReducedOrderObserver, Ship, reference, simulate
from hgo_rs.reference.models import Ship as Constants
from hgo_rs.scenarios import katayama as paper

H, EPSILON = paper.PLANT_STEP, 0.1
H1, H2, H3 = (h / EPSILON for h in paper.H_BAR)
MATRICES: dict[str, float] = {
    name: value for name, value in vars(Constants).items() if name[0] in "MD" and name[1:].isdigit()
}
M11, M22, M23, M33, D11, D22, D23, D32, D33 = MATRICES.values()
DET = M22 * M33 - M23 * M23
BEGIN = paper.RMS_FROM / paper.T_END  # of the steps
K = 0.3 / (H + 0.3)


SPREAD = (0.5, 0.5, 0.5, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05)  # [m, rad; m/s, rad/s] of x, z, z_hat


def own_model() -> Model:
    """What the observer knows of the ship, as a user writes it."""
    s, c1, c2 = "(z2 - 1.18*z3)", "(M22*z2 + M23*z3)", "(-M11*z1)"
    f1 = f"(-{c1}*z3 + D11*z1)"
    f2 = f"(-{c2}*z3 + D22*z2 + D23*z3)"
    f3 = f"({c1}*z1 + {c2}*z2 + D32*z2 + D33*z3)"
    l21 = f"(0.102*z1*z1 - 0.0232*{s}*{s})"
    l22 = f"(-0.0232*(z1*z1 + {s}*{s})*atan({s}/z1))"
    l31 = f"(0.287*z1*z1 + 0.307*{s}*{s})"
    return Model(
        states=["x1", "x2", "x3", "z1", "z2", "z3"],
        inputs=["u1", "u2"],
        parameters={**MATRICES, "DET": DET},
        f1=["0", "0", "0"],
        g=[["cos(x3)", "-sin(x3)", "0"], ["sin(x3)", "cos(x3)", "0"], ["0", "0", "1"]],
        f2=[
            f"-1/M11*{f1} + u1",
            f"M23/DET*{f3} - M33/DET*{f2} + {l21}*u2 + {l22}",
            f"M23/DET*{f2} - M22/DET*{f3} + {l31}*u2 - 13.23*{l22}",
        ],
    )


def starts(runs: int) -> Array:
    """x, z, z_hat of each run, (runs, 9), around the paper's."""
    return around((*paper.POSITION, *paper.VELOCITY, 0.0, 0.0, 0.0), SPREAD, runs)


def window(size: Size) -> tuple[int, int]:
    """Steps over which the RMS is taken."""
    return round(BEGIN * size.steps), size.steps


def ours(size: Size, threads: int, own: bool = False, **engine: Any) -> Call:
    """With ``own`` the observer's model alone: no plant of a user's has the controller."""
    model = own_model() if own else None
    observer = ReducedOrderObserver(h_bar=paper.H_BAR, epsilon=EPSILON, model=model)
    begun, seconds = starts(size.runs), in_seconds(window(size), H)
    memory = np.tile(observer.initial_memory(), (size.runs, 1))
    memory[:, :3] = begun[:, 6:]

    def study(steps: int) -> Array:
        return simulate(
            Ship(),
            observer,
            x0=begun[:, :6],
            memory0=memory,
            dt=H,
            steps=steps,
            plant_method="rk4",
            runs=size.runs,
            windows=[seconds],
            metrics=["rms"],
            **engine,
        ).rms[:, 0]

    if own:
        try:
            study(size.steps)
        except HgoError as error:
            raise LeftOut(f"`simulate` refuses it: {error}") from None
    return lambda: study(size.steps)


def twin(size: Size, threads: int) -> Call:
    seconds = in_seconds(window(size), H)
    spec = paper.spec(H, EPSILON, t_end=H * size.steps, every=0, windows=[seconds])
    begun = starts(size.runs)
    memory = np.tile(np.asarray(spec["memory0"]), (size.runs, 1))
    memory[:, :3] = begun[:, 6:]
    spec |= {"x0": begun[:, :6], "memory0": memory, "runs": size.runs}
    return lambda: reference.simulate(spec)["rms"][:, 0]


def in_numba(size: Size, threads: int) -> Call:
    numba = need("numba")
    jit = numba.njit(fastmath=True, error_model="numpy")
    (begin, end), runs = window(size), size.runs

    @jit
    def damping(z1: float, z2: float, z3: float) -> tuple[float, float, float]:
        c1, c2 = M22 * z2 + M23 * z3, -M11 * z1
        f1 = D11 * z1 - c1 * z3
        f2 = D22 * z2 + D23 * z3 - c2 * z3
        f3 = c1 * z1 + c2 * z2 + D32 * z2 + D33 * z3
        return -f1 / M11, (M23 * f3 - M33 * f2) / DET, (M23 * f2 - M22 * f3) / DET

    @jit
    def rudder(z1: float, z2: float, z3: float) -> tuple[float, float, float]:
        s = z2 - 1.18 * z3
        z1_2, s_2 = z1 * z1, s * s
        l22 = -0.0232 * (z1_2 + s_2) * math.atan(s / z1)
        return 0.102 * z1_2 - 0.0232 * s_2, l22, 0.287 * z1_2 + 0.307 * s_2

    @jit
    def known(z1: float, z2: float, z3: float, u1: float, u2: float) -> tuple[float, float, float]:
        d1, d2, d3 = damping(z1, z2, z3)
        l21, l22, l31 = rudder(z1, z2, z3)
        return d1 + u1, d2 + l21 * u2 + l22, d3 + l31 * u2 - 13.23 * l22

    @jit
    def drift(x3: float, z: Any, u1: float, u2: float) -> Any:
        sine, cosine = math.sin(x3), math.cos(x3)
        x_rate = (cosine * z[0] - sine * z[1], sine * z[0] + cosine * z[1], z[2])
        return x_rate, known(z[0], z[1], z[2], u1, u2)  # (20)

    @jit
    def control(x2: float, x3: float, z: Any) -> tuple[float, float]:
        z1, z2, z3 = z
        d1, d2, d3 = damping(z1, z2, z3)
        l21, l22, l31 = rudder(z1, z2, z3)
        sine, cosine = math.sin(x3), math.cos(x3)
        gamma = 6.0 / (36.0 + x2 * x2)
        v = z1 * sine + z2 * cosine
        z3_tilde = z3 + K * (x3 - math.atan(-x2 / 6.0)) + gamma * v
        kappa = gamma * gamma * x2 * v * v / 3.0 - K * (z3 + gamma * v)
        kappa -= gamma * (d1 * sine + (d2 + l22) * cosine + (z1 * cosine - z2 * sine) * z3)
        u1 = -(z1 - 0.8) / (H + 0.3) - d1
        u2 = -d3 + 13.23 * l22 + kappa - K * z3_tilde - gamma * u1 * sine
        return u1, u2 / (l31 + l21 * gamma * cosine)  # (21)

    @jit
    def plus(a: Any, h: float, b: Any) -> Any:
        return a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2]

    @jit
    def one(start: Array, rms: Array) -> None:
        x, z = (start[0], start[1], start[2]), (start[3], start[4], start[5])
        z_hat = (start[6], start[7], start[8])
        last, v1, v2, squares = x, 0.0, 0.0, (0.0, 0.0, 0.0)
        for k in range(end):
            if k > 0:
                sine, cosine = math.sin(last[2]), math.cos(last[2])
                s1, s2, s3 = (x[0] - last[0]) / H, (x[1] - last[1]) / H, (x[2] - last[2]) / H
                p1, p2, p3 = cosine * s1 + sine * s2, cosine * s2 - sine * s1, s3
                f = known(p1, p2, p3, v1, v2)
                h = (H1 * (p1 - z_hat[0]), H2 * (p2 - z_hat[1]), H3 * (p3 - z_hat[2]))
                z_hat = plus(z_hat, H, plus(f, 1.0, h))  # (22)
            if k >= begin:
                e = plus(z, -1.0, z_hat)
                squares = plus(squares, 1.0, (e[0] * e[0], e[1] * e[1], e[2] * e[2]))
            u1, u2 = control(x[1], x[2], z)
            last, v1, v2 = x, u1, u2
            ax, az = drift(x[2], z, u1, u2)
            bx, bz = drift(x[2] + 0.5 * H * ax[2], plus(z, 0.5 * H, az), u1, u2)
            cx, cz = drift(x[2] + 0.5 * H * bx[2], plus(z, 0.5 * H, bz), u1, u2)
            dx, dz = drift(x[2] + H * cx[2], plus(z, H, cz), u1, u2)
            x = plus(plus(x, H / 6.0, plus(ax, 1.0, dx)), H / 3.0, plus(bx, 1.0, cx))
            z = plus(plus(z, H / 6.0, plus(az, 1.0, dz)), H / 3.0, plus(bz, 1.0, cz))
        for i in range(3):
            rms[i] = np.sqrt(squares[i] / (end - begin))

    @numba.njit(parallel=threads > 1)
    def study(start: Array) -> Array:
        rms = np.empty((runs, 3))
        for run in numba.prange(runs):
            one(start[run], rms[run])
        return rms

    begun = starts(runs)
    return lambda: study(begun)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    jax.config.update("jax_enable_x64", True)
    numpy = jax.numpy
    begin, end = window(size)

    def damping(z: Any) -> Any:
        c1, c2 = M22 * z[1] + M23 * z[2], -M11 * z[0]
        f1 = D11 * z[0] - c1 * z[2]
        f2 = D22 * z[1] + D23 * z[2] - c2 * z[2]
        f3 = c1 * z[0] + c2 * z[1] + D32 * z[1] + D33 * z[2]
        return -f1 / M11, (M23 * f3 - M33 * f2) / DET, (M23 * f2 - M22 * f3) / DET

    def rudder(z: Any) -> Any:
        s = z[1] - 1.18 * z[2]
        z1_2, s_2 = z[0] * z[0], s * s
        l22 = -0.0232 * (z1_2 + s_2) * numpy.arctan(s / z[0])
        return 0.102 * z1_2 - 0.0232 * s_2, l22, 0.287 * z1_2 + 0.307 * s_2

    def known(z: Any, u: Any) -> Any:
        (d1, d2, d3), (l21, l22, l31) = damping(z), rudder(z)
        return d1 + u[0], d2 + l21 * u[1] + l22, d3 + l31 * u[1] - 13.23 * l22

    def drift(s: Any, u: Any) -> Any:
        sine, cosine, z = numpy.sin(s[2]), numpy.cos(s[2]), s[3:]
        x_rate = (cosine * z[0] - sine * z[1], sine * z[0] + cosine * z[1], z[2])
        return x_rate + known(z, u)  # (20)

    def control(s: Any) -> Any:
        x2, x3, z1, z2, z3 = s[1:]
        (d1, d2, d3), (l21, l22, l31) = damping(s[3:]), rudder(s[3:])
        sine, cosine = numpy.sin(x3), numpy.cos(x3)
        gamma = 6.0 / (36.0 + x2 * x2)
        v = z1 * sine + z2 * cosine
        z3_tilde = z3 + K * (x3 - numpy.arctan(-x2 / 6.0)) + gamma * v
        kappa = gamma * gamma * x2 * v * v / 3.0 - K * (z3 + gamma * v)
        kappa -= gamma * (d1 * sine + (d2 + l22) * cosine + (z1 * cosine - z2 * sine) * z3)
        u1 = -(z1 - 0.8) / (H + 0.3) - d1
        u2 = -d3 + 13.23 * l22 + kappa - K * z3_tilde - gamma * u1 * sine
        return u1, u2 / (l31 + l21 * gamma * cosine)  # (21)

    def plus(a: Any, h: float, b: Any) -> Any:
        return tuple(p + h * q for p, q in zip(a, b, strict=True))

    def run(start: Any) -> Any:
        def step(carry: Any, k: Any) -> Any:
            s, last, held, z_hat, squares = carry
            sine, cosine = numpy.sin(last[2]), numpy.cos(last[2])
            s1, s2, s3 = ((a - b) / H for a, b in zip(s[:3], last, strict=True))
            psi = (cosine * s1 + sine * s2, cosine * s2 - sine * s1, s3)
            rates = zip((H1, H2, H3), psi, z_hat, known(psi, held), strict=True)
            moved = [z + H * (h * (p - z) + f) for h, p, z, f in rates]  # (22)
            z_hat = tuple(numpy.where(k > 0, m, z) for m, z in zip(moved, z_hat, strict=True))
            late = numpy.where(k >= begin, 1.0, 0.0)
            errors = zip(squares, s[3:], z_hat, strict=True)
            squares = tuple(total + late * (z - e) * (z - e) for total, z, e in errors)
            u = control(s)
            a = drift(s, u)
            b = drift(plus(s, 0.5 * H, a), u)
            c = drift(plus(s, 0.5 * H, b), u)
            d = drift(plus(s, H, c), u)
            moved = plus(plus(s, H / 6.0, plus(a, 1.0, d)), H / 3.0, plus(b, 1.0, c))
            return (moved, s[:3], u, z_hat, squares), None

        s = tuple(start)
        initial = (s[:6], s[:3], (0.0, 0.0), s[6:], (0.0, 0.0, 0.0))
        squares = jax.lax.scan(step, initial, numpy.arange(end))[0][-1]
        return numpy.sqrt(numpy.stack(squares) / (end - begin))

    return streams.jax_study(run, threads, starts(size.runs).T)


SOURCE = """
typedef real block[BLOCKS];
typedef struct { block x[3], z[3]; } ship;
typedef struct { block u1, u2; } input;

/* d(z), lambda21, lambda22, lambda31 of the appendix. */
INLINE void coefficients(const block z[3], block d[3], block lambda[3]) {
  block s, angle;
  EACH s[q] = z[1][q] - 1.18 * z[2][q];
  arctangent(s, z[0], angle);
  EACH {
    real z1 = z[0][q], z2 = z[1][q], z3 = z[2][q], c1 = M22 * z2 + M23 * z3, c2 = -M11 * z1;
    real f1 = D11 * z1 - c1 * z3;
    real f2 = D22 * z2 + D23 * z3 - c2 * z3;
    real f3 = c1 * z1 + c2 * z2 + D32 * z2 + D33 * z3;
    d[0][q] = f1 * (-1.0 / M11);
    d[1][q] = (M23 * f3 - M33 * f2) * (1.0 / DET);
    d[2][q] = (M23 * f2 - M22 * f3) * (1.0 / DET);
    real zz = z1 * z1, ss = s[q] * s[q];
    lambda[0][q] = 0.102 * zz - 0.0232 * ss;
    lambda[1][q] = -0.0232 * (zz + ss) * angle[q];
    lambda[2][q] = 0.287 * zz + 0.307 * ss;
  }
}
/* f2 = d + q(z, u): what the observer knows. */
INLINE void known(const block z[3], const input *u, block f[3]) {
  block lambda[3];
  coefficients(z, f, lambda);
  EACH {
    f[0][q] += u->u1[q];
    f[1][q] += lambda[0][q] * u->u2[q] + lambda[1][q];
    f[2][q] += lambda[2][q] * u->u2[q] - 13.23 * lambda[1][q];
  }
}
INLINE void drift(const ship *s, const input *u, ship *rate) { /* (20) */
  block sine, cosine;
  known(s->z, u, rate->z);
  turn(s->x[2], sine, cosine);
  EACH {
    rate->x[0][q] = cosine[q] * s->z[0][q] - sine[q] * s->z[1][q];
    rate->x[1][q] = sine[q] * s->z[0][q] + cosine[q] * s->z[1][q];
    rate->x[2][q] = s->z[2][q];
  }
}
INLINE void control(const ship *s, input *u) { /* (21) */
  block d[3], lambda[3], sines, cosines, down, six, angle;
  EACH down[q] = -s->x[1][q], six[q] = all(6.0);
  arctangent(down, six, angle);
  coefficients(s->z, d, lambda);
  turn(s->x[2], sines, cosines);
  EACH {
    real z1 = s->z[0][q], z2 = s->z[1][q], z3 = s->z[2][q], sine = sines[q], cosine = cosines[q];
    real x2 = s->x[1][q], gamma = 6.0 / (36.0 + x2 * x2), v = z1 * sine + z2 * cosine;
    real z3_tilde = z3 + K * (s->x[2][q] - angle[q]) + gamma * v;
    real kappa = gamma * gamma * x2 * v * v * (1.0 / 3.0) - K * (z3 + gamma * v) - gamma *
        (d[0][q] * sine + (d[1][q] + lambda[1][q]) * cosine + (z1 * cosine - z2 * sine) * z3);
    u->u1[q] = (0.8 - z1) * (1.0 / (H + 0.3)) - d[0][q];
    real u2 = kappa - d[2][q] + 13.23 * lambda[1][q] - K * z3_tilde - gamma * u->u1[q] * sine;
    u->u2[q] = u2 / (lambda[2][q] + lambda[0][q] * gamma * cosine);
  }
}
INLINE void plus(const ship *a, double h, const ship *b, ship *sum) {
  for (int i = 0; i < 3; i++)
    EACH sum->x[i][q] = a->x[i][q] + h * b->x[i][q], sum->z[i][q] = a->z[i][q] + h * b->z[i][q];
}

/* RMS of z - z_hat over [begin, end), (3, runs), of runs that start at x, z, z_hat, (9, runs). */
void katayama(int64_t first, int64_t last, int64_t runs, const double *starts, int64_t begin,
              int64_t end, double *rms) {
  static const double h[3] = {H1, H2, H3};
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    ship s, k, sum, trial;
    block before[3], z_hat[3], squares[3];
    input u;
    for (int i = 0; i < 3; i++) EACH {
      s.x[i][q] = LOAD(AT(starts, i)), s.z[i][q] = LOAD(AT(starts, 3 + i));
      z_hat[i][q] = LOAD(AT(starts, 6 + i)), squares[i][q] = all(0.0);
    }
    for (int64_t n = 0; n < end; n++) {
      if (n > 0) {
        block sine, cosine, psi[3], f[3];
        turn(before[2], sine, cosine);
        EACH {
          real slope[3];
          for (int i = 0; i < 3; i++) slope[i] = (s.x[i][q] - before[i][q]) * (1.0 / H);
          psi[0][q] = cosine[q] * slope[0] + sine[q] * slope[1];
          psi[1][q] = cosine[q] * slope[1] - sine[q] * slope[0];
          psi[2][q] = slope[2];
        }
        known(psi, &u, f);
        for (int i = 0; i < 3; i++) /* (22) */
          EACH z_hat[i][q] += H * (h[i] * (psi[i][q] - z_hat[i][q]) + f[i][q]);
      }
      for (int i = 0; i < 3; i++) EACH {
        real e = s.z[i][q] - z_hat[i][q];
        if (n >= begin) squares[i][q] += e * e;
        before[i][q] = s.x[i][q];
      }
      control(&s, &u);
      drift(&s, &u, &k), plus(&s, H / 6.0, &k, &sum), plus(&s, 0.5 * H, &k, &trial);
      drift(&trial, &u, &k), plus(&sum, H / 3.0, &k, &sum), plus(&s, 0.5 * H, &k, &trial);
      drift(&trial, &u, &k), plus(&sum, H / 3.0, &k, &sum), plus(&s, H, &k, &trial);
      drift(&trial, &u, &k), plus(&sum, H / 6.0, &k, &s);
    }
    for (int i = 0; i < 3; i++)
      EACH STORE(AT(rms, i), root(squares[i][q] / (double)(end - begin)));
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    constants = {"H": H, "K": K, "H1": H1, "H2": H2, "H3": H3, "DET": DET, **MATRICES}
    begun, rms = np.ascontiguousarray(starts(size.runs).T), np.empty((3, size.runs))
    given = begun, *window(size)
    call = compiled.study(
        SOURCE, "katayama", (2, 4), size.runs, threads, *given, result=rms, **constants
    )
    return lambda: call().T


WORKLOAD = Workload(
    "katayama-ship",
    "RMS of z - ẑ, ship by RK4, reduced-order observer",
    (
        *columns(ours, in_c, own_bits=False),
        Implementation("Numba", in_numba),
        Implementation("JAX", in_jax, share=0.25),
        Implementation(TWIN, twin, share=0.05, parallel=False),
    ),
    full=Size(512, 2_000),
    quick=Size(128, 200),
    check=Size(64, 400),
)
