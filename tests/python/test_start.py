"""The start from a first sample: in runs, logs, files and exported source."""

import exported
import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import HgoError, cli
from hgo_rs.logs import read_chunks, read_log, run_chunks

DT = 0.002
T = np.arange(2000) * DT
FAR = 5.4e6 + np.sin(2.0 * T)
"""An easting, in m: its velocity is at most 2 m/s."""


def laws():
    return {
        "standard": hgo.StandardObserver(2, 25.0),
        "predictor": hgo.StandardObserver(2, 25.0, timing="predictor"),
        "low-power": hgo.LowPowerObserver(3, 25.0),
        "filtered": hgo.HighGainObserver("filtered", 2, 25.0),
        "adaptive": hgo.StandardObserver(2, hgo.AdaptiveGain(10.0, 1.0, 0.183)),
        "sampled": hgo.SampledDataObserver(
            hgo.Model(states=["q", "v"], f=["v", "0"], K_T=["0.1*(y - q)", "0.8*(y - q)"])
        ),
    }


@pytest.mark.parametrize("law", laws())
def test_a_start_at_the_first_sample_has_no_peak(law):
    observer = laws()[law]
    begun = observer.run(T, FAR, start="first-sample")
    assert np.abs(begun.x_hat[:, 1]).max() < 10.0
    # as a start that is given, and as the same record moved to its first sample: to rounding
    x_hat0 = [FAR[0], *np.zeros(observer.n - 1)]
    same = observer.run(T, FAR, x_hat0=x_hat0)
    assert np.array_equal(begun.memory, same.memory)
    near = observer.run(T, FAR - FAR[0])
    assert np.abs(begun.x_hat[:, 1] - near.x_hat[:, 1]).max() < 1e-4
    if law != "adaptive":
        zero = observer.run(T, FAR)
        assert np.array_equal(zero.memory, observer.run(T, FAR, start="zero").memory)
        assert np.abs(zero.x_hat[:, 1]).max() > 1e6


def test_the_first_sample_that_is_there():
    y = FAR.copy()
    y[:7] = np.nan
    observer = laws()["standard"]
    begun = observer.run(T, y, start="first-sample")
    assert begun.x_hat[0, 0] == FAR[7]
    assert np.abs(begun.x_hat[:, 1]).max() < 10.0
    nothing = observer.run(T[:5], y[:5], start="first-sample")
    assert not np.any(nothing.x_hat)
    assert np.array_equal(observer.initial_memory(y0=np.nan), observer.initial_memory())
    observer.reset(y0=3.0)
    assert np.array_equal(observer.x_hat, [3.0, 0.0])


def test_of_each_output_its_own():
    model = hgo.Model(states=["q", "w", "s"], orders=[2, 1], phi=["0", "0"])
    laws = [hgo.StandardObserver(2, 25.0, wrap=360.0), hgo.StandardObserver(1, 9.0)]
    several = hgo.MultiOutputObserver(laws, model=model)
    y = np.column_stack([700.0 + T, FAR])
    y[:3, 1] = np.nan
    begun = several.run(T, y, start="first-sample")
    assert np.allclose(begun.x_hat[0], [-20.0, 0.0, FAR[3]], atol=1e-9)
    assert np.array_equal(several.initial_memory(y0=[700.0, np.nan])[:3], [-20.0, 0.0, 0.0])


def test_a_reduced_order_observer_begins_there_anyway():
    t = np.arange(200) * 0.05
    y = np.column_stack([1e4 + np.sin(t), -np.cos(t), 0.1 * t])
    u = np.zeros((200, 2))
    ship = hgo.ReducedOrderObserver(1.0)
    begun = ship.run(t, y, u, x_hat0=[1.0, 0.0, 0.1])
    assert np.abs(begun.x_hat).max() < 10.0
    ship.reset(x_hat0=[1.0, 0.0, 0.1])
    ((_, again),) = run_chunks(ship, [log_of(t, y, u)])
    assert np.array_equal(again.memory, begun.memory)
    with pytest.raises(HgoError, match=r"y0 = .*: must be left out; this law begins"):
        ship.initial_memory(y0=[0.0, 0.0, 0.0])


def log_of(t, y, u=None, starts=(0,)):
    names = {"time": "t", "output": "y", "input": None if u is None else "u"}
    return hgo.logs.Log(t, y, u, names, "a log", np.isnan(y), starts)


def test_refusals():
    observer = laws()["standard"]
    for given in ({"x_hat0": [0.0, 0.0]}, {"memory0": [0.0, 0.0, 0.0]}):
        with pytest.raises(HgoError, match='left out with start="first-sample"'):
            observer.run(T, FAR, start="first-sample", **given)
    with pytest.raises(HgoError, match=r"start = 'one': must be one of zero, first-sample"):
        observer.run(T, FAR, start="one")
    with pytest.raises(HgoError, match=r"y0 = 1\.0: must be given without x_hat0"):
        observer.initial_memory([0.0, 0.0], y0=1.0)
    with pytest.raises(HgoError, match="y has 2 entries: must have 1"):
        observer.initial_memory(y0=[1.0, 2.0])
    model = hgo.Model(states=["q", "v"], f=["v", "-q"], K_T=["y - 2*q", "0"], h="2*q")
    with pytest.raises(HgoError, match="whose output h is not its first state"):
        hgo.SampledDataObserver(model).run(T, FAR, start="first-sample")


def test_a_log_of_another_output_begins_where_the_observer_stands(tmp_path):
    log = read_log(put(tmp_path, 0.5 * np.sin(T)), "t", "easting")
    model = hgo.Model(states=["q", "v"], f=["v", "-q"], K_T=["y - 2*q", "0"], h="2*q")
    observer = hgo.SampledDataObserver(model)
    ((_, result),) = run_chunks(observer, [log])
    assert np.array_equal(result.memory, observer.run(log.t, log.y).memory)
    with pytest.raises(HgoError, match="whose output h is not its first state"):
        list(run_chunks(observer, [log], start="first-sample"))


# --- logs and files ---------------------------------------------------------------------------


def put(tmp_path, y=FAR, name="utm.csv"):
    cells = ["" if np.isnan(value) else f"{value:.4f}" for value in y]
    rows = [f"{t:.3f},{cell}" for t, cell in zip(T, cells, strict=True)]
    path = tmp_path / name
    path.write_text("t,easting\n" + "\n".join(rows) + "\n")
    return path


COMMAND = ["--time", "t", "--output", "easting", "--observer", "standard", "--order", "2"]
COMMAND += ["--gain", "25"]


def estimated(tmp_path, log, *options):
    out = tmp_path / "estimates.csv"
    with pytest.raises(SystemExit) as end:
        cli.main(["estimate", str(log), *COMMAND, *options, "--out", str(out)])
    assert end.value.code == 0
    return np.genfromtxt(out, delimiter=",", names=True)["x_hat2"]


def test_the_command_starts_at_the_first_sample(tmp_path):
    log = put(tmp_path)
    assert np.abs(estimated(tmp_path, log)).max() < 10.0
    assert np.abs(estimated(tmp_path, log, "--start", "zero")).max() > 1e6
    config = tmp_path / "observer.toml"
    velocity = estimated(tmp_path, log, "--save-config", str(config))
    assert np.array_equal(hgo.estimate(log, config).x_hat[:, 1], velocity)
    config.write_text(config.read_text() + '\n[start]\nfrom = "zero"\n')
    assert np.abs(hgo.estimate(log, config).x_hat[:, 1]).max() > 1e6
    config.write_text(config.read_text().replace('from = "zero"', "x_hat = [5.4e6, 1.0]"))
    assert hgo.estimate(log, config).x_hat[0].tolist() == [5.4e6, 1.0]
    for wrong, told in {
        'from = "one"': "start.from = 'one' is not known",
        'from = "zero"\nx_hat = [0.0, 0.0]': "start.from is given beside x_hat",
    }.items():
        text = config.read_text().replace("x_hat = [5.4e6, 1.0]", wrong)
        with pytest.raises(HgoError, match=told):
            hgo.Config.from_toml(text)


@pytest.mark.parametrize("rows", [1, 3, 512, 10_000])
def test_chunks_start_as_the_whole_log_does(tmp_path, rows):
    y = FAR.copy()
    y[:10] = np.nan
    log = put(tmp_path, y)
    observer = laws()["standard"]
    whole = read_log(log, "t", "easting")
    expected = observer.run(whole.t, whole.y, start="first-sample").memory
    parts = run_chunks(observer, read_chunks(log, "t", "easting", rows=rows))
    assert np.array_equal(np.concatenate([r.memory for _, r in parts]), expected)
    zero = run_chunks(observer, read_chunks(log, "t", "easting", rows=rows), start="zero")
    assert np.array_equal(
        np.concatenate([r.memory for _, r in zero]), observer.run(whole.t, whole.y).memory
    )


def test_each_piece_starts_at_its_own_first_sample():
    t = np.concatenate([T[:900], T[:900]])
    y = np.concatenate([FAR[:900], -FAR[:900]])
    y[900:903] = np.nan
    parts = list(run_chunks(laws()["standard"], [log_of(t, y, starts=(0, 900))]))
    assert [len(log.t) for log, _ in parts] == [900, 900]
    for (_, result), first in zip(parts, (y[0], y[903]), strict=True):
        assert result.x_hat[0, 0] == first
        assert np.abs(result.x_hat[:, 1]).max() < 10.0


def test_an_observer_that_stands_elsewhere_begins_there():
    observer = laws()["standard"]
    observer.reset(x_hat0=[5.0e6, 0.0])
    ((_, result),) = run_chunks(observer, [log_of(T, FAR)])
    assert result.x_hat[0, 0] == 5.0e6


# --- exported source --------------------------------------------------------------------------

MAIN = """\
#include "far.h"
#include <math.h>
#include <stdio.h>

int main(void)
{{
    static const {real} y[] = {{{samples}}};
    far_state state;
    int k;

    printf("%d ", far_start(&state, ({real})NAN));
    printf("%.17g ", (double)state.{first});
    printf("%d\\n", far_start(&state, y[0]));
    for (k = 0; k < (int)(sizeof y / sizeof y[0]); ++k) {{
        far_step(&state, y[k], 0.0, ({real}){dt:.17g});
        printf("%.17g %.17g\\n", (double)state.{first}, (double)state.{second});
    }}
    return 0;
}}
"""


@pytest.mark.parametrize("timing", ["current", "predictor"])
@pytest.mark.parametrize("wrap", [None, 6.28125])
def test_exported_source_starts_with_the_bits_of_a_run(tmp_path, timing, wrap):
    observer = hgo.StandardObserver(2, 25.0, timing=timing, wrap=wrap)
    observer.export(to="c", out=tmp_path, name="far", dt=DT)
    y = 40.0 + np.sin(2.0 * T[:50])
    header = (tmp_path / "far.h").read_text()
    first, second = [
        line.split()[1].rstrip(";") for line in header.splitlines() if "    double" in line
    ][:2]
    samples = ", ".join(f"{value!r}" for value in y.tolist())
    main = MAIN.format(real="double", samples=samples, first=first, second=second, dt=DT)
    (tmp_path / "main.c").write_text(main)
    printed = exported.in_c(tmp_path, "far").splitlines()
    assert printed[0].split() == ["1", "0", "0"]
    ours = np.array([line.split() for line in printed[1:]], float)
    run = observer.run(DT, y, start="first-sample").x_hat
    # with predictor timing a step shows the estimate for the next sample
    expected, ours = (run, ours) if timing == "current" else (run[1:], ours[:-1])
    assert np.array_equal(ours, expected)
    observer.export(to="rust", out=tmp_path / "rust", name="far", precision="single", dt=DT)
    assert "OK" in exported.in_rust(tmp_path / "rust", "far")
    assert (
        "pub fn start(&mut self, y: f32) -> Status {" in (tmp_path / "rust/src/lib.rs").read_text()
    )


def test_no_start_where_there_is_none(tmp_path):
    hgo.ReducedOrderObserver(1.0).export(to="c", out=tmp_path, name="ship", dt=0.05)
    assert "ship_start" not in (tmp_path / "ship.h").read_text()
