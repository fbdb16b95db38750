"""A control loop around an exported observer: correct, compute the input, apply it, predict."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import STRICT, put, run

from hgo_rs import Model, StandardObserver
from hgo_rs.exports import sources
from hgo_rs.observers import Observer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")

DT, STEPS, ELL = 0.01, 1000, 40.0

# a pendulum that a stiff law drives between two ends; both programs print w and its estimate
C_LOOP = """\
#include "axis.h"
#include <math.h>
#include <stdio.h>

static void plant(double *q, double *w, double u)
{
    for (int i = 0; i < 100; ++i) {
        const double rate = u - 0.5 * *w - 9.81 * sin(*q);
        *q += 1e-4 * (*w + 0.5e-4 * rate);
        *w += 1e-4 * rate;
    }
}

static double law(double q, double w, int k)
{
    const double end = sin(0.01 * k) >= 0.0 ? 1.5 : -1.5;
    const double u = 9.81 * sin(q) - 40.0 * (q - end) - 12.0 * w;
    return u > 60.0 ? 60.0 : u < -60.0 ? -60.0 : u;
}

int main(void)
{
    axis_state state;
    double q = 0.3, w = 0.0, u = 0.0;
    axis_init(&state);
    for (int k = 0; k < STEPS; ++k) {
        CORRECT;
        printf("%.17g %.17g\\n", w, state.w);
        u = law(state.q, state.w, k);
        PREDICT;
        plant(&q, &w, u);
    }
    return 0;
}
"""

RUST_LOOP = """\
use axis::Axis;

fn plant(q: &mut f64, w: &mut f64, u: f64) {
    for _ in 0..100 {
        let rate = u - 0.5 * *w - 9.81 * q.sin();
        *q += 1e-4 * (*w + 0.5e-4 * rate);
        *w += 1e-4 * rate;
    }
}

fn law(q: f64, w: f64, k: i32) -> f64 {
    let end = if (0.01 * f64::from(k)).sin() >= 0.0 { 1.5 } else { -1.5 };
    (9.81 * q.sin() - 40.0 * (q - end) - 12.0 * w).clamp(-60.0, 60.0)
}

fn main() {
    let mut state = Axis::new();
    let (mut q, mut w) = (0.3, 0.0);
    for k in 0..STEPS {
        state.correct(q);
        println!("{w:e} {:e}", state.w);
        let u = law(state.q, state.w, k);
        state.predict(u, 0.01);
        plant(&mut q, &mut w, u);
    }
}
"""


def observer() -> Observer:
    model = Model(states=["q", "w"], inputs=["u"], phi="u - 0.5*w - 9.81*sin(q)")
    law: dict[str, Any] = {"method": "zoh", "motion": "held", "timing": "current"}  # as by_hand
    made = StandardObserver(2, ELL, model=model, **law)
    made.reset([0.3, 0.0])
    return made


def plant(x: Any, u: float) -> Any:
    q, w = x
    for _ in range(100):
        rate = u - 0.5 * w - 9.81 * np.sin(q)
        q, w = q + 1e-4 * (w + 0.5e-4 * rate), w + 1e-4 * rate
    return np.array([q, w])


def law(x: Any, k: int) -> float:
    end = 1.5 if np.sin(0.01 * k) >= 0.0 else -1.5
    return float(np.clip(9.81 * np.sin(x[0]) - 40.0 * (x[0] - end) - 12.0 * x[1], -60.0, 60.0))


def by_hand() -> Any:
    """The loop with the law written down here: poles exp(-ell T) and exp(-2 ell T) of the error."""
    z = np.exp(-ELL * DT * np.array([1.0, 2.0]))
    k1 = 1.0 - z.prod()
    gain = np.array([k1, (2.0 - k1 - z.sum()) / DT])
    x, x_hat, rows = np.array([0.3, 0.0]), np.array([0.3, 0.0]), []
    for k in range(STEPS):
        if k:
            x_hat = x_hat + gain * (x[0] - x_hat[0])
        rows.append([x[1], x_hat[1]])
        u = law(x_hat, k)
        rate = u - 0.5 * x_hat[1] - 9.81 * np.sin(x_hat[0])
        x_hat = x_hat + DT * np.array([x_hat[1] + DT / 2.0 * rate, rate])
        x = plant(x, u)
    return np.array(rows)


def in_python(online: Any) -> Any:
    x, rows = np.array([0.3, 0.0]), []
    for k in range(STEPS):
        x_hat = online.correct(x[0]).copy()
        rows.append([x[1], x_hat[1]])
        u = law(x_hat, k)
        online.predict(u, DT)
        x = plant(x, u)
    return np.array(rows)


def rms(rows: Any) -> float:
    return float(np.sqrt(np.mean((rows[:, 1] - rows[:, 0]) ** 2)))


def printed(text: str) -> Any:
    return np.array([line.split() for line in text.splitlines()], dtype=float)


@pytest.fixture(scope="module")
def expected() -> Any:
    rows = by_hand()
    assert 0.0 < rms(rows) < 0.01
    return rows


def test_the_loop_in_python(expected: Any) -> None:
    np.testing.assert_allclose(in_python(observer()), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("verbs", ["correct and predict", "step"])
def test_the_loop_in_c(tmp_path: Path, expected: Any, verbs: str) -> None:
    put(tmp_path, sources(observer(), to="c", name="axis", dt=DT))
    halves = ("axis_correct(&state, q)", "axis_predict(&state, u, 0.01)")
    whole = ("axis_step(&state, q, u, 0.0, 0.01)", "")
    correct, predict = whole if verbs == "step" else halves
    loop = C_LOOP.replace("CORRECT", correct).replace("PREDICT", predict)
    put(tmp_path, {"loop.c": loop.replace("STEPS", str(STEPS))})
    flags = (*STRICT, "-O2")
    run("cc", *flags, tmp_path / "loop.c", tmp_path / "axis.c", "-lm", "-o", tmp_path / "loop")
    np.testing.assert_allclose(printed(run(tmp_path / "loop")), expected, rtol=0, atol=1e-9)


def test_the_loop_in_c_in_single_precision(tmp_path: Path, expected: Any) -> None:
    put(tmp_path, sources(observer(), to="c", name="axis", dt=DT, precision="single"))
    loop = C_LOOP.replace("CORRECT", "axis_correct(&state, (float)q)")
    loop = loop.replace("PREDICT", "axis_predict(&state, (float)u, 0.01f)")
    loop = loop.replace("w, state.w)", "w, (double)state.w)")
    loop = loop.replace("law(state.q, state.w", "law((double)state.q, (double)state.w")
    put(tmp_path, {"loop.c": loop.replace("STEPS", str(STEPS))})
    flags = (*STRICT, "-O2")
    run("cc", *flags, tmp_path / "loop.c", tmp_path / "axis.c", "-lm", "-o", tmp_path / "loop")
    assert rms(printed(run(tmp_path / "loop"))) < 1.1 * rms(expected)


def test_the_loop_in_rust(tmp_path: Path, expected: Any) -> None:
    put(tmp_path, sources(observer(), to="rust", name="axis", dt=DT))
    put(tmp_path, {"src/main.rs": RUST_LOOP.replace("STEPS", str(STEPS))})
    flags = ("--edition=2024", "-Copt-level=1", "-Dwarnings", "--out-dir", tmp_path)
    run("rustc", *flags, "--crate-type=rlib", "--crate-name=axis", tmp_path / "src" / "lib.rs")
    extern = f"--extern=axis={tmp_path / 'libaxis.rlib'}"
    run("rustc", *flags, "--crate-name=closed", extern, tmp_path / "src" / "main.rs")
    np.testing.assert_allclose(printed(run(tmp_path / "closed")), expected, rtol=0, atol=1e-9)
