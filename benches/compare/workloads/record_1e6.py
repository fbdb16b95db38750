"""record-1e6: an observer over a record of a million samples, in one call.

Three cases: the standard observer, n = 2, and the low-power observer, n = 5, both by Euler, without
a model (an own one says phi = 0); and the standard observer of Lee's plant, n = 2, its injection
placed (zoh), over a record whose periods differ. All estimates of all samples are the result, and
all are compared. A step is a sample.

There is one run, so that no kernel has anything to share; the start is read all the same.
"""

from __future__ import annotations

import ctypes
import tempfile
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from compare import compiled
from compare.harness import (
    OURS,
    SEED,
    TWIN,
    Array,
    Call,
    Implementation,
    LeftOut,
    Size,
    Workload,
    need,
)
from hgo_rs import Lee, LowPowerObserver, Model, StandardObserver, reference
from hgo_rs.observers import Observer

T, ELL = 1e-3, 50.0


def unknown(n: int) -> Model:
    """A chain of integrators of which no more is known."""
    return Model(states=[f"x{i}" for i in range(1, n + 1)], phi="0")


def standard(model: Model | None = None) -> Observer:
    return StandardObserver(2, ELL, model=model, method="euler", timing="predictor")


def low_power(model: Model | None = None) -> Observer:
    return LowPowerObserver(5, ELL, model=model, method="euler", timing="predictor")


def placed(model: Model | Lee) -> Observer:
    return StandardObserver(2, ELL, model=model, method="zoh", motion="held")


LEE = Model(states=["x1", "x2"], phi="-x1/(1 + x1*x1) - x2")
STANDARD, LOW_POWER = standard(), low_power()
K1, K2 = (k * ELL**i for i, k in enumerate(STANDARD.spec["k"], 1))
A1, A2, A3, A4, A5 = (alpha * ELL for alpha in LOW_POWER.spec["alpha"])
B1, B2, B3, B4 = (beta * ELL * ELL for beta in LOW_POWER.spec["beta"])


@cache
def times(samples: int, jitter: bool) -> Array:
    """When the samples were taken [s]: every T, or after 0.5 to 1.5 T."""
    if not jitter:
        return np.asarray(T * np.arange(samples), dtype=np.float64)
    periods = T * np.random.default_rng(SEED + 1).uniform(0.5, 1.5, samples)
    return np.asarray(np.cumsum(periods), dtype=np.float64)


@cache
def record(samples: int, jitter: bool = False) -> Array:
    """A noisy position."""
    noise = np.random.default_rng(SEED).standard_normal(samples)
    y: Array = np.sin(2.0 * times(samples, jitter)) + 1e-3 * noise
    return y


def start(observer: Observer) -> Array:
    """The memory before the first sample: not 0."""
    return observer.initial_memory(0.1 * np.arange(1, observer.n + 1))


def ours(observer: Observer, jitter: bool, size: Size, threads: int) -> Call:
    y, begun = record(size.steps, jitter), start(observer)
    clock = times(size.steps, True) if jitter else T
    return lambda: observer.run(clock, y, memory0=begun).x_hat


def twin(observer: Observer, jitter: bool, size: Size, threads: int) -> Call:
    y, begun, n = record(size.steps, jitter), start(observer), observer.n
    t, law = times(size.steps, jitter), reference.Observer(observer.spec)
    return lambda: law.run(t, y, None, begun)["memory"][:, :n]


# --- standard, n = 2 --------------------------------------------------------------------------


def standard_lfilter(size: Size, threads: int) -> Call:
    """The linear observer as transfer functions from y to each estimate."""
    signal = need("scipy.signal")
    step = np.array([[1.0 - T * K1, T], [-T * K2, 1.0]])
    numerators, denominator = signal.ss2tf(step, [[T * K1], [T * K2]], np.eye(2), np.zeros((2, 1)))
    y, x0 = record(size.steps), start(STANDARD)
    # the delays of each filter with which its first two values are those that x0 gives for y = 0
    delays = [[a, b + denominator[1] * a] for a, b in zip(x0, step @ x0, strict=True)]
    return lambda: np.column_stack(
        [
            signal.lfilter(top, denominator, y, zi=delay)[0]
            for top, delay in zip(numerators, delays, strict=True)
        ]
    )


def standard_numba(size: Size, threads: int) -> Call:
    numba = need("numba")

    @numba.njit(fastmath=True, error_model="numpy")
    def run(y: Array, x0: Array) -> Array:
        x_hat = np.empty((len(y), 2))
        x1, x2 = x0
        for k in range(len(y)):
            x_hat[k, 0], x_hat[k, 1] = x1, x2
            e = y[k] - x1
            x1, x2 = x1 + T * (x2 + K1 * e), x2 + T * (K2 * e)
        return x_hat

    y, x0 = record(size.steps), start(STANDARD)
    return lambda: run(y, x0)


def standard_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    jax.config.update("jax_enable_x64", True)

    def step(x: Any, y: Any) -> Any:
        e = y - x[0]
        return (x[0] + T * (x[1] + K1 * e), x[1] + T * (K2 * e)), x

    run = jax.jit(lambda y, x: jax.numpy.stack(jax.lax.scan(step, tuple(x), y)[1], axis=1))
    y, x0 = jax.device_put(record(size.steps)), jax.device_put(start(STANDARD))
    return lambda: run(y, x0).block_until_ready()


# What the next sample waits for comes last in each sum.
STANDARD_C = """
/* All x_hat, (samples, 2), by Euler, from x0 on. */
void run(int64_t samples, const double *y, const double *x0, double *x_hat) {
  double x1 = x0[0], x2 = x0[1];
  for (int64_t k = 0; k < samples; k++) {
    x_hat[2 * k] = x1, x_hat[2 * k + 1] = x2;
    double e = y[k] - x1;
    x1 = (T * K1 * y[k] + T * x2) + (1.0 - T * K1) * x1, x2 += T * K2 * e;
  }
}
"""


# --- low-power, n = 5 -------------------------------------------------------------------------


def low_power_numba(size: Size, threads: int) -> Call:
    numba = need("numba")

    @numba.njit(fastmath=True, error_model="numpy")
    def run(y: Array, begun: Array) -> Array:
        x_hat = np.empty((len(y), 5))
        x1, x2, x3, x4, x5, n1, n2, n3, n4 = begun
        for k in range(len(y)):
            x_hat[k, 0], x_hat[k, 1], x_hat[k, 2], x_hat[k, 3], x_hat[k, 4] = x1, x2, x3, x4, x5
            e1, e2, e3, e4, e5 = y[k] - x1, n1 - x2, n2 - x3, n3 - x4, n4 - x5
            x1, x2, x3 = x1 + T * (n1 + A1 * e1), x2 + T * (n2 + A2 * e2), x3 + T * (n3 + A3 * e3)
            x4, x5 = x4 + T * (n4 + A4 * e4), x5 + T * (A5 * e5)
            n1, n2, n3 = n1 + T * (n2 + B1 * e1), n2 + T * (n3 + B2 * e2), n3 + T * (n4 + B3 * e3)
            n4 += T * (B4 * e4)
        return x_hat

    y, begun = record(size.steps), start(LOW_POWER)
    return lambda: run(y, begun)


def low_power_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    jax.config.update("jax_enable_x64", True)
    numpy, alpha, beta = jax.numpy, np.array([A1, A2, A3, A4, A5]), np.array([B1, B2, B3, B4])

    def step(memory: Any, y: Any) -> Any:
        x, eta = memory
        e = numpy.concatenate([y[None], eta]) - x
        x_new = x + T * (numpy.append(eta, 0.0) + alpha * e)
        return (x_new, eta + T * (numpy.append(eta[1:], 0.0) + beta * e[:4])), x

    run = jax.jit(lambda y, begun: jax.lax.scan(step, (begun[:5], begun[5:]), y)[1])
    y, begun = jax.device_put(record(size.steps)), jax.device_put(start(LOW_POWER))
    return lambda: run(y, begun).block_until_ready()


def low_power_lfilter(size: Size, threads: int) -> Call:
    raise LeftOut("as one transfer function of order 9 it is off by 3e-4")


LOW_POWER_C = """
#if defined __GNUC__ && !defined __clang__
#pragma GCC optimize("no-tree-slp-vectorize") /* pairs of these sums cost more than they save */
#endif
#if FORM == 0 /* the next sample waits for a product and a sum */
#define X(x, a, from, n) x = (T * a * (from) + T * (n)) + (1.0 - T * a) * x
#define ETA(n, b, e, next) n += T * b * (e) + T * (next)
#else /* it waits longer, there are fewer operations */
#define X(x, a, from, n) x = (x + T * (n)) + T * a * ((from) - x)
#define ETA(n, b, e, next) n = (n + T * (next)) + T * b * (e)
#endif
#define NOTHING -0.0 /* which changes no sum */
/* All x_hat, (samples, 5), by Euler, from x_hat, eta = z0 on. */
void run(int64_t samples, const double *y, const double *z0, double *x_hat) {
  double x1 = z0[0], x2 = z0[1], x3 = z0[2], x4 = z0[3], x5 = z0[4];
  double n1 = z0[5], n2 = z0[6], n3 = z0[7], n4 = z0[8];
  for (int64_t k = 0; k < samples; k++, x_hat += 5) {
    x_hat[0] = x1, x_hat[1] = x2, x_hat[2] = x3, x_hat[3] = x4, x_hat[4] = x5;
    double e1 = y[k] - x1, e2 = n1 - x2, e3 = n2 - x3, e4 = n3 - x4;
    X(x1, A1, y[k], n1), X(x2, A2, n1, n2), X(x3, A3, n2, n3), X(x4, A4, n3, n4);
    X(x5, A5, n4, NOTHING);
    ETA(n1, B1, e1, n2), ETA(n2, B2, e2, n3), ETA(n3, B3, e3, n4), ETA(n4, B4, e4, NOTHING);
  }
}
"""
LOW_POWER_GAINS = {f"A{i}": a for i, a in enumerate((A1, A2, A3, A4, A5), 1)}
LOW_POWER_GAINS |= {f"B{i}": b for i, b in enumerate((B1, B2, B3, B4), 1)}


def in_c(
    source: str, observer: Observer, constants: dict[str, float], size: Size, threads: int
) -> Call:
    """The faster form of the kernel."""
    y, begun = record(size.steps), start(observer)

    def run(kernel: Any) -> Array:
        x_hat = np.empty((len(y), observer.n))
        kernel(ctypes.c_int64(len(y)), *map(compiled.value, (y, begun, x_hat)))
        return x_hat

    forms = range(2 if "FORM" in source else 1)
    kernels = [compiled.library(source, 1, T=T, FORM=form, **constants).run for form in forms]
    return compiled.fastest([partial(run, kernel) for kernel in kernels])


# The memory is doubles alone, as it is handed over.
EXPORTED_C = """
#include <string.h>
void run(int64_t samples, const double *y, const double *z0, double *x_hat) {
  observer_state state;
  memcpy(&state, z0, sizeof state);
  for (int64_t k = 0; k < samples; k++, x_hat += N) {
    memcpy(x_hat, &state, N * sizeof *x_hat);
    observer_step(&state, y[k], 0.0, T);
  }
}
"""


def exported(observer: Observer, size: Size, threads: int) -> Call:
    """The source that `export` writes, its step called in a loop: the law's own sums, its bits."""
    with tempfile.TemporaryDirectory() as folder:
        observer.export(to="c", out=folder)
        header, body = (Path(folder, f"observer.{end}").read_text("utf-8") for end in "hc")
    source = header + body.replace('#include "observer.h"', "") + EXPORTED_C
    return in_c(source, observer, {"N": observer.n}, size, threads)


def case(
    name: str, observer: Observer, own: Observer, *others: Implementation, jitter: bool = False
) -> Workload:
    """The record through one observer."""
    return Workload(
        "record-1e6",
        "a record of 1e6 samples in one call",
        (
            Implementation(OURS, partial(ours, observer, jitter)),
            Implementation("ours, own model", partial(ours, own, jitter), bits=OURS),
            *others,
            Implementation(TWIN, partial(twin, observer, jitter), share=0.01),
        ),
        full=Size(1, 1_000_000),
        quick=Size(1, 20_000),
        check=Size(1, 2_000),
        case=name,
        parallel=False,
    )


def kernels(
    source: str, observer: Observer, constants: dict[str, float]
) -> tuple[Implementation, ...]:
    """The kernel in C as the processor computes it best, with every operation rounded, and as
    `export` writes it."""
    kernel = partial(in_c, source, observer, constants)
    return (
        Implementation("C", kernel),
        Implementation("C, rounded", compiled.rounded(kernel)),
        Implementation("C, exported", partial(exported, observer), bits=OURS),
    )


WORKLOADS = (
    case(
        "standard n = 2",
        STANDARD,
        standard(unknown(2)),
        *kernels(STANDARD_C, STANDARD, {"K1": K1, "K2": K2}),
        Implementation("Numba", standard_numba),
        Implementation("lfilter", standard_lfilter),
        Implementation("JAX", standard_jax, share=0.2),
    ),
    case(
        "low-power n = 5",
        LOW_POWER,
        low_power(unknown(5)),
        *kernels(LOW_POWER_C, LOW_POWER, LOW_POWER_GAINS),
        Implementation("Numba", low_power_numba),
        Implementation("lfilter", low_power_lfilter),
        Implementation("JAX", low_power_jax, share=0.1),
    ),
    case("zoh, periods that differ", placed(Lee()), placed(LEE), jitter=True),
)
