"""Outputs that wrap: every law against the same law over the unwrapped record and against the twin;
a day of turning in single precision, here and on the chip; what is refused and warned of.
"""

import contextlib
import warnings

import exported
import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import HgoError, _core, cli, reference
from hgo_rs.logs import read_chunks, read_log
from hgo_rs.observers import TurnWarning
from hgo_rs.observers.turns import Jumps, nearest

TURN = 2.0 * np.pi
DT = 1e-3
T = np.arange(6000) * DT
ANGLE = 4.0 * T + 0.5 * np.sin(2.0 * T) + 40.0
"""An axis that turns nearly four times, from the seventh turn on."""
MISSING = np.zeros(len(T), bool)
MISSING[2000:2003] = MISSING[3111] = True


def chain(kind, **manner):
    sizes = {"filtered": {"filters": 2}, "peaking-free": {"saturation": 20.0}}
    return hgo.HighGainObserver(kind, 2, 40.0, **sizes.get(kind, {}), **manner)


def copies(kind, **manner):
    law = {"gain": hgo.AdaptiveGain(10.0, 1.0, 0.183), "k": [2.0, 2.0], "k_bar": [0.0558, 0.0317]}
    made = getattr(hgo, kind)(**law, copies=2, **manner)
    starts = [[0.1, 0.0], [-0.1, 0.5]]
    made.memory = made.spread(*([[0.0, 0.0]] * (kind == "ModifiedObserver")), starts)
    return made


def pendulum(**manner):
    """A model that sees the angle."""
    model = hgo.Model(states=["q", "v"], phi="-3*sin(q) - 0.5*v")
    return hgo.StandardObserver(2, 40.0, model=model, **manner)


def sampled(**manner):
    model = hgo.Model(states=["q", "v"], f=["v", "-sin(q)"], K_T=["0.2*(y - q)", "8*(y - q)"])
    return hgo.SampledDataObserver(model, **manner)


MANNERS = [
    {"method": method, "timing": timing}
    for method in ("zoh", "rk4", "euler")
    for timing in ("current", "predictor")
]
MAKERS = {
    f"{kind}, {manner['method']}, {manner['timing']}": (chain, (kind,), manner)
    for kind in ("standard", "low-power", "peaking-free", "filtered")
    for manner in MANNERS
    if kind != "filtered" or manner["method"] != "zoh"
}
MAKERS |= {
    f"{kind}, {manner['timing']}": (copies, (kind,), manner)
    for kind in ("RepelledCollection", "ModifiedObserver")
    for manner in MANNERS
    if manner["method"] == "rk4"
}
MAKERS |= {f"pendulum, {manner['timing']}": (pendulum, (), manner) for manner in MANNERS[:2]}
MAKERS["sampled-data"] = (sampled, (), {})


@pytest.mark.parametrize("law", MAKERS)
def test_a_wrapped_record_gives_what_the_unwrapped_one_gives(law):
    make, told, manner = MAKERS[law]
    wrapped, plain = make(*told, **manner, wrap=TURN), make(*told, **manner)
    y = np.where(MISSING, np.nan, ANGLE)
    start = plain.memory.copy()
    entries = [0]
    if make is copies:
        entries = list(range(0, plain._law_len, 3))
    start[entries] += 40.0  # near the first sample
    ours = wrapped.run(T, np.mod(y, TURN), memory0=start)
    whole = plain.run(T, y, memory0=start)
    apart = ours.memory - whole.memory
    # all that is of the angle's coordinate has moved by the same turns
    turns = np.rint(apart[:, entries] / TURN)
    assert np.array_equal(turns, np.repeat(turns[:, :1], len(entries), axis=1))
    assert len(np.unique(turns)) >= 4
    apart[:, entries] -= TURN * turns
    size = 1.0 + np.abs(whole.memory).max(axis=0)
    assert np.max(np.abs(apart) / size) < 1e-9
    assert np.abs(ours.x_hat[1:, 0]).max() <= TURN / 2.0 * (1.0 + 1e-12)
    told = whole.innovation[1:]
    np.testing.assert_allclose(
        ours.innovation[1:], told, rtol=0.0, atol=1e-9 * np.nanmax(abs(told))
    )


@pytest.mark.parametrize("law", MAKERS)
def test_the_twin_wraps_the_same(law):
    make, told, manner = MAKERS[law]
    observer = make(*told, **manner, wrap=TURN)
    y = np.where(MISSING, np.nan, np.mod(ANGLE, TURN))[:3200]
    start = observer.memory.copy()
    ours = observer.run(T[:3200], y, memory0=start)
    twin = reference.Observer(observer.spec).run(T[:3200], y, None, start)
    size = 1.0 + np.abs(ours.memory).max(axis=0)
    # within rounding of half a turn the two may stand on its two sides
    apart = ours.memory - twin["memory"]
    entries = list(range(0, observer._law_len, 3)) if make is copies else [0]
    apart[:, entries] -= TURN * np.rint(apart[:, entries] / TURN)
    assert np.max(np.abs(apart) / size) < 1e-9


def test_the_memory_stays_in_one_turn_on_line_too():
    observer, record = pendulum(wrap=TURN), pendulum(wrap=TURN).run(DT, np.mod(ANGLE, TURN))
    for k, y in enumerate(np.mod(ANGLE, TURN)):
        shown = observer.correct(y)
        assert np.array_equal(shown, record.x_hat[k])
        shown = observer.predict(dt=DT)
        assert abs(shown[0]) <= TURN / 2.0 * (1.0 + 1e-12)


def test_one_output_of_several_wraps():
    model = hgo.Model(
        states=["q", "w", "s", "v"], orders=[2, 2], phi=["-sin(q) + 0.1*v", "cos(q) - s"]
    )

    def made(turn):
        laws = [hgo.StandardObserver(2, 40.0, wrap=turn), hgo.LowPowerObserver(2, 30.0)]
        return hgo.MultiOutputObserver(laws, model=model)

    assert made(TURN).wrap == (TURN, None)
    y = np.column_stack([ANGLE, 20.0 * np.cos(T)])
    y[500:600, 0] = y[700, 1] = np.nan
    start = made(None).initial_memory([40.0, 4.0, 20.0, 0.0])
    wrapped = np.column_stack([np.mod(y[:, 0], TURN), y[:, 1]])
    ours = made(TURN).run(T, wrapped, memory0=start)
    whole = made(None).run(T, y, memory0=start)
    apart = ours.memory - whole.memory
    turns = np.rint(apart[:, 0] / TURN)
    assert len(np.unique(turns)) >= 4
    apart[:, 0] -= TURN * turns
    assert np.max(np.abs(apart)) < 1e-9
    twin = reference.Observer(made(TURN).spec).run(T, wrapped, None, start)
    apart = ours.memory - twin["memory"]
    assert np.max(np.abs(nearest(apart, [TURN] + [np.nan] * (len(start) - 1)))) < 1e-9
    assert np.allclose(ours.innovation, twin["innovation"], rtol=0.0, atol=1e-8, equal_nan=True)
    # what a gap costs does not jump by a turn
    assert np.allclose(ours.error_after(ours.gaps), whole.error_after(whole.gaps), rtol=1e-6)


def test_the_heading_of_a_ship_wraps():
    t = np.arange(4000) * 0.05
    heading = 0.11 * t + 3.0
    y = np.column_stack([3.0 * np.sin(0.1 * t), -2.0 * np.cos(0.1 * t), heading])
    u = np.column_stack([np.full(len(t), 0.3), 0.1 * np.sin(t)])
    x_hat0 = [0.3, 0.0, 0.1]
    whole = hgo.ReducedOrderObserver(1.0).run(t, y, u, x_hat0=x_hat0)
    wrapped = y.copy()
    wrapped[:, 2] = np.mod(heading + np.pi, TURN) - np.pi
    assert np.ptp(np.rint((wrapped[:, 2] - heading) / TURN)) == 4
    ship = hgo.ReducedOrderObserver(1.0, wrap=(None, None, TURN))
    ours = ship.run(t, wrapped, u, x_hat0=x_hat0)
    assert np.max(np.abs(ours.x_hat - whole.x_hat)) < 1e-9
    twin = reference.Observer(ship.spec).run(t, wrapped, u, ship.initial_memory(x_hat0))["memory"]
    assert np.max(np.abs(ours.x_hat - twin[:, :3])) < 1e-9
    spoilt = hgo.ReducedOrderObserver(1.0).run(t, wrapped, u, x_hat0=x_hat0)
    assert np.max(np.abs(spoilt.x_hat - whole.x_hat)) > 1.0


def test_a_counter_over_a_hundred_wraps():
    t = np.arange(200_000) * DT
    counts = np.round(3.4e4 * t + 2e3 * np.sin(3.0 * t))
    assert counts[-1] > 100 * 65536
    sixteen = np.mod(counts + 2.0**15, 2.0**16) - 2.0**15
    law = {"method": "zoh", "timing": "current"}
    ours = hgo.StandardObserver(2, 40.0, wrap=65536, **law).run(DT, sixteen).x_hat
    whole = hgo.StandardObserver(2, 40.0, **law).run(DT, counts).x_hat
    speed = 3.4e4 + 6e3 * np.cos(3.0 * t)
    assert np.abs(whole[500:, 1] - speed[500:]).max() < 2000.0
    rounding = 65536 * 100 * 2.0**-52 * 40.0 / 0.05  # of the unwrapped counts, over the time that
    assert np.abs(ours[:, 1] - whole[:, 1]).max() < 100.0 * rounding  # the law remembers
    # the whole number of turns is all that is not known of the position
    assert np.abs(nearest(ours[:, :1] - whole[:, :1], [65536.0])).max() < 1e-6


# --- a day in single precision ----------------------------------------------------------------


def day_of(errors_first, errors_last):
    """The error at the end of the day against that at its start: largest and root mean square."""
    rms = [np.sqrt(np.mean(np.square(e))) for e in (errors_first, errors_last)]
    most = [np.max(np.abs(e)) for e in (errors_first, errors_last)]
    return rms[1] / rms[0], most[1] / most[0]


def single_day(spec, dt, reduce):
    """Errors of the velocity in the first and the last quarter of an hour of a day, in float32."""
    observer, chunk = _core.Observer(spec), round(900.0 / dt)
    memory, kept = observer.initial(), {}
    pieces = 96
    for piece in range(pieces):
        k = piece * chunk + np.arange(chunk + 1)
        t = k * dt
        angle = 0.4 * t + 0.5 * np.sin(0.2 * t)
        y = (np.mod(angle, TURN) if reduce else angle).astype(np.float32).astype(float)
        rows = np.array(
            _core.run_single(
                spec, (t - t[0]).tolist(), y[:, None], np.empty((len(t), 0)), memory.tolist()
            )
        )
        # each piece begins with the last sample of the one before, for no time
        memory = rows[-1].astype(float)
        if piece in (0, pieces - 1):
            kept[piece] = rows[600:, 1] - (0.4 + 0.1 * np.cos(0.2 * t[600:]))
    return kept[0], kept[pieces - 1]


def test_a_day_of_turning_in_single_precision():
    law = {"method": "zoh", "timing": "current"}
    wrapped = hgo.StandardObserver(2, 4.0, wrap=TURN, **law).spec
    rms, most = day_of(*single_day(wrapped, 0.1, reduce=True))
    assert rms <= 1.1 and most <= 1.1
    plain = hgo.StandardObserver(2, 4.0, **law).spec
    rms, _ = day_of(*single_day(plain, 0.1, reduce=False))
    assert rms > 1.5  # digits that turns have used up


AXIS = """\
#include "axis.h"
#include <math.h>
#include <stdio.h>

/* A day of a turning axis: prints the largest and the mean square error of its velocity in the
   first and in the last LOOK samples. The angle is counted in whole steps: no float sums it up. */
enum {{ STEPS = {steps}, LOOK = {look}, SETTLED = 1000 }};

int main(void)
{{
    static const float speed = {speed}f;
    axis_state state;
    double most[2] = {{0.0, 0.0}}, square[2] = {{0.0, 0.0}};
    long k, position = 0;

    axis_init(&state);
    for (k = 0; k < STEPS; ++k) {{
        const float y = (float)position * {per_count}f;
        const int part = k >= STEPS - LOOK;

        axis_step(&state, y, 0.0, {dt}f);
        if (part || (k >= SETTLED && k < SETTLED + LOOK)) {{
            const double error = (double)(state.{velocity} - speed);
            most[part] = fabs(error) > most[part] ? fabs(error) : most[part];
            square[part] += error * error;
        }}
        position = (position + {counts}) % {turn};
    }}
    printf("%.9g %.9g %.9g %.9g\\n", most[0], most[1], square[0], square[1]);
    return 0;
}}
"""


def axis(folder, dt, gain):
    """An exported observer of an encoder of 4096 counts a turn, 13 counts a sample."""
    observer = hgo.StandardObserver(2, gain, wrap=TURN, method="zoh")
    observer.export(to="c", out=folder, name="axis", precision="single", dt=dt)
    velocity = "x_hat2" if "x_hat2" in (folder / "axis.h").read_text() else "x2"
    given = {
        "steps": round(86400 / dt),
        "look": 60_000,
        "speed": f"{13 / dt * TURN / 4096:.9g}",
        "per_count": f"{TURN / 4096:.9g}",
        "dt": f"{dt:g}",
        "counts": 13,
        "turn": 4096,
        "velocity": velocity,
    }
    (folder / "main.c").write_text(AXIS.format(**given))
    return folder


def ratios(printed):
    most, last_most, square, last_square = map(float, printed.split())
    assert most > 0.0 and square > 0.0
    return last_most / most, np.sqrt(last_square / square)


def test_a_day_of_turning_in_exported_c(tmp_path):
    folder = axis(tmp_path, 0.01, 40.0)
    assert max(ratios(exported.in_c(folder, "axis"))) <= 1.1


@pytest.mark.skipif(bool(exported.lacking()), reason=f"not installed: {exported.lacking()}")
def test_a_day_of_turning_on_the_chip(tmp_path):
    folder = axis(tmp_path, 0.1, 4.0)
    here = exported.in_c(folder, "axis")
    there = exported.on_the_chip(folder, "axis")
    assert max(ratios(there)) <= 1.1
    assert there.strip() == here.strip()


@pytest.mark.parametrize("precision", ["single", "double"])
def test_exported_c_and_rust_wrap_with_the_bits_of_step(tmp_path, precision):
    t, y = T[::10], np.where(MISSING, np.nan, np.mod(ANGLE, TURN))[::10]
    for name, observer in {
        "axis": pendulum(wrap=TURN),
        "late": chain("standard", wrap=TURN, timing="predictor"),
    }.items():
        folder = tmp_path / name
        observer.export(
            to="c", out=folder, name=name, precision=precision, log=(t, y, np.empty((len(t), 0)))
        )
        assert exported.says_ok(exported.in_c(folder, name), len(t) - 1)
        exported.checked_as_cpp(folder, name)
        observer.export(
            to="rust", out=folder, name=name, precision=precision, log=(t, y, np.empty((len(t), 0)))
        )
        assert "OK" in exported.in_rust(folder, name)


# --- files, refusals, warnings ----------------------------------------------------------------


def test_a_file_says_it(tmp_path):
    for observer in (
        pendulum(wrap=TURN),
        hgo.ReducedOrderObserver(1.0, wrap=[None, None, TURN]),
        copies("RepelledCollection", wrap=3.0),
    ):
        observer.save(tmp_path / "observer.toml")
        again = hgo.load(tmp_path / "observer.toml").observer()
        assert again.wrap == observer.wrap
        assert again.spec == observer.spec
    several = hgo.Config.from_toml(
        'format = 1\nobserver = "chains"\n'
        '[[observers]]\nobserver = "standard"\norder = 1\ngain = 9.0\nwrap = 360.0\n'
        '[[observers]]\nobserver = "standard"\norder = 1\ngain = 9.0\n'
        '[model]\nstates = ["a", "b"]\norders = [1, 1]\nphi = ["b", "-a"]\n'
    )
    assert several.observer().wrap == (360.0, None)


@pytest.mark.parametrize("wrap", [0.0, -1.0, np.inf, np.nan, "turn", 1e-320, [TURN]])
def test_no_turn(wrap):
    with pytest.raises(HgoError, match="wrap"):
        hgo.StandardObserver(2, 40.0, wrap=wrap)


def test_other_refusals():
    with pytest.raises(HgoError, match="wrap of 1 entries: must have 3"):
        hgo.ReducedOrderObserver(1.0, wrap=TURN)
    model = hgo.Model(states=["q", "v"], f=["v", "-q"], K_T=["y - 2*q", "0"], h="2*q")
    with pytest.raises(HgoError, match="wrap is not allowed for a model whose output h"):
        hgo.SampledDataObserver(model, wrap=TURN)
    with pytest.raises(HgoError, match="wrap is not allowed for the observer of a simulation"):
        hgo.simulate(hgo.VanDerPol(), chain("standard", wrap=TURN), x0=[1, 0], dt=DT, steps=10)


def test_samples_too_far_apart_are_told():
    slow = np.mod(ANGLE, TURN)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chain("standard", wrap=TURN).run(DT, slow)
    fast = 1000.0 * T + 900.0 * T**2  # more than half a turn a sample, from a third of it on
    with pytest.warns(TurnWarning, match=r"samples \d+ and \d+ lie .* of a turn"):
        chain("standard", wrap=TURN).run(DT, np.mod(fast * 3.0, TURN))
    noise = np.random.default_rng(1).normal(0.0, TURN, 500)
    with pytest.warns(TurnWarning, match="by motion or by noise"):
        chain("standard", wrap=TURN).run(DT, noise)


# --- logs -------------------------------------------------------------------------------------

COUNTS = np.round(3000.0 * (ANGLE - 40.0))
SIXTEEN = np.mod(COUNTS + 2.0**15, 2.0**16) - 2.0**15
SPEED = 3000.0 * (4.0 + np.cos(2.0 * T))
LAW = ["--observer", "standard", "--order", "2", "--gain", "40"]


def put(tmp_path, name="enc.csv", t=T, y=SIXTEEN, what="counts"):
    cells = ["" if np.isnan(value) else f"{value:.10g}" for value in y]
    rows = [f"{a:.3f},{cell}" for a, cell in zip(t, cells, strict=True)]
    (tmp_path / name).write_text(f"t,{what}\n" + "\n".join(rows) + "\n")
    return tmp_path / name


def command(log, *options, law=LAW, output="counts"):
    out = log.parent / "estimates.csv"
    told = ["--time", "t", "--output", output, *law, *options, "--out", str(out)]
    with pytest.raises(SystemExit) as end:
        cli.main(["estimate", str(log), *told])
    assert end.value.code == 0
    return np.genfromtxt(out, delimiter=",", names=True)


def test_the_command_wraps_where_it_is_told_or_sees_it(tmp_path, capsys):
    log = put(tmp_path)
    whole = hgo.StandardObserver(2, 40.0).run(T, COUNTS, start="first-sample").x_hat[:, 1]
    for options, says in {
        (): "enc.csv: 'counts' jumps by nearly 65536, as a counter of 16 bits that begins again: "
        "it is taken to wrap there; --wrap none if it does not",
        ("--wrap", "65536"): "wrap 65536",
        ("--unwrap", "counts=65536"): "6000 samples",
    }.items():
        estimates = command(log, *options)
        assert np.abs(estimates["x_hat2"] - whole).max() < 1e-6
        assert says in capsys.readouterr().out
    assert np.abs(command(log, "--wrap", "none")["x_hat2"]).max() > 1e6
    assert "jumps" not in capsys.readouterr().out
    config = tmp_path / "observer.toml"
    command(log, "--save-config", str(config))
    assert hgo.load(config).observer().wrap == (65536.0,)
    config.write_text(config.read_text().replace("wrap = 65536.0\n", ""))
    with pytest.warns(TurnWarning, match="'counts' jumps by nearly 65536.*say wrap = 65536 "):
        hgo.estimate(log, config)


def test_a_turn_is_seen_where_there_is_one():
    def seen(values, rows=512):
        looks = Jumps()
        found = [looks.add(np.array(values[k : k + rows])) for k in range(0, len(values), rows)]
        return next((turn for turn in found if turn), None)

    assert seen(SIXTEEN) == seen(np.mod(COUNTS, 65536)) == 65536.0
    assert seen(-SIXTEEN, rows=1) == 65536.0
    assert seen(np.mod(np.round(ANGLE * 20.0), 256)) == 256.0
    assert seen(np.mod(ANGLE, TURN)) == seen(np.mod(ANGLE + np.pi, TURN) - np.pi) == TURN
    assert seen(np.degrees(np.mod(ANGLE, TURN))) == 360.0
    # a spike, a step, a record of its own, noise, a limit cycle of whole numbers: none wraps
    spike = np.round(100.0 + 100.0 * np.sin(T))
    spike[3000] = 65000.0
    noise = np.random.default_rng(0).uniform(-np.pi, np.pi, 5000)
    step = np.where(T < 3.0, 0.0, 60000.0)
    for values in (COUNTS, spike, noise, step, np.sin(ANGLE), np.round(127 * np.sin(5.0 * ANGLE))):
        assert seen(values) is None
    with_gaps = SIXTEEN.copy()
    with_gaps[::3] = np.nan
    assert seen(with_gaps) == 65536.0


@pytest.mark.parametrize("rows", [1, 7, 100_000])
def test_columns_are_unwrapped_and_scaled_as_they_are_read(tmp_path, rows):
    y = np.where(MISSING, np.nan, SIXTEEN)
    log = put(tmp_path, y=y)
    told = {
        "unwrap": {"counts": 65536},
        "scale": {"counts": 1.0 / 3000.0},
        "offset": {"counts": 40.0},
    }
    parts = list(read_chunks(log, "t", "counts", rows=rows, **told))
    expected = np.where(MISSING, np.nan, COUNTS / 3000.0 + 40.0)
    got = np.concatenate([part.y for part in parts])
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-12)
    text = (
        'format = 1\nobserver = "standard"\norder = 2\ngain = 40.0\n[log]\ntime = "t"\n'
        'output = "counts"\nunwrap = { counts = 65536 }\nscale = { counts = 0.000333333333 }\n'
    )
    velocity = hgo.estimate(log, hgo.Config.from_toml(text)).x_hat[500:, 1]
    assert np.abs(velocity - SPEED[500:] / 3000.0).max() < 0.2


def test_signals_with_times_of_their_own_are_converted_too(tmp_path):
    np.savez(tmp_path / "two.npz", t=T, q=SIXTEEN, s=T[::2], v=np.arange(3000.0))
    told = {"unwrap": {"q": 65536}, "scale": {"v": -2.0}, "offset": {"v": 1.0}}
    log = read_log(tmp_path / "two.npz", ["t", "s"], ["q", "v"], **told)
    assert np.array_equal(log.y[:, 0], COUNTS)
    assert np.array_equal(log.y[::2, 1], 1.0 - 2.0 * np.arange(3000.0))


def test_each_piece_of_a_log_is_unwrapped_alone(tmp_path):
    y = np.concatenate([SIXTEEN[:3000], SIXTEEN[2000:5000]])
    log = put(tmp_path, t=np.concatenate([T[:3000], T[:3000]]), y=y)
    read = read_log(log, "t", "counts", resets="split", unwrap={"counts": 65536})
    assert read.starts == (0, 3000)
    assert np.array_equal(read.y[:3000], COUNTS[:3000])
    assert np.array_equal(np.diff(read.y[3000:]), np.diff(COUNTS[2000:5000]))
    assert read.y[3000] == SIXTEEN[2000]


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (
            {"unwrap": {"count": 65536}},
            "unwrap of 'count': no output or input of this name; nearest: counts",
        ),
        ({"unwrap": {"counts": 0}}, "unwrap of 'counts' = 0: must be finite and > 0"),
        ({"scale": {"counts": 0.0}}, "scale of 'counts' = 0: must not be 0"),
        ({"scale": 2.0}, "scale = 2.0: must name its columns"),
        ({"offset": {"counts": np.nan}}, "offset of 'counts' = nan: must be finite"),
    ],
)
def test_conversions_that_cannot_be(tmp_path, told, says):
    with pytest.raises(HgoError, match=says):
        read_log(put(tmp_path), "t", "counts", **told)


def test_what_is_unwrapped_must_move_slowly_enough(tmp_path):
    log = put(tmp_path, y=np.mod(COUNTS, 20))
    with pytest.warns(TurnWarning, match="of a turn"):
        read_log(log, "t", "counts", unwrap={"counts": 20})


# --- other engines, and a fixed period --------------------------------------------------------


@pytest.mark.parametrize("timing", ["current", "predictor"])
def test_a_compiled_record_has_the_same_bits(timing):
    pytest.importorskip("llvmlite")
    y = np.where(MISSING, np.nan, np.mod(ANGLE, TURN))
    observer = pendulum(wrap=TURN, timing=timing)
    plain, compiled = (
        observer.run(DT, y, start="first-sample", engine=engine)
        for engine in ("interpreter", "llvm")
    )
    assert np.array_equal(plain.memory, compiled.memory)
    assert np.array_equal(plain.innovation, compiled.innovation, equal_nan=True)


@pytest.mark.parametrize("kind", ["standard", "low-power"])
def test_a_fixed_period_wraps_and_starts_with_the_same_bits(tmp_path, kind):
    y = np.mod(ANGLE, TURN)[:400]
    observer = chain(kind, wrap=TURN)
    observer.export(to="c", out=tmp_path, name="axis", fixed_dt=DT)
    assert "OK" in exported.in_c(tmp_path, "axis")
    first = "x1"
    samples = ", ".join(f"{value!r}" for value in y.tolist())
    (tmp_path / "main.c").write_text(
        '#include "axis.h"\n#include <stdio.h>\n\nint main(void)\n{\n'
        f"    static const double y[] = {{{samples}}};\n    axis_state state;\n    int k;\n\n"
        "    axis_start(&state, y[0]);\n"
        "    for (k = 0; k < (int)(sizeof y / sizeof y[0]); ++k) {\n"
        "        axis_step(&state, y[k], 0.0);\n"
        f'        printf("%.17g %.17g\\n", state.{first}, state.x2);\n    }}\n    return 0;\n}}\n'
    )
    printed = [line.split() for line in exported.in_c(tmp_path, "axis").splitlines()]
    assert np.array_equal(np.array(printed, float), observer.run(DT, y, start="first-sample").x_hat)


def test_a_turn_that_noise_fills_is_not_tuned_for():
    def build(ell):
        return hgo.StandardObserver(2, ell, wrap=TURN)

    assert hgo.tune(build, 0.01, cutoff=20.0, dt=DT).ell > 1.0
    with pytest.raises(HgoError, match=r"wrap = 6\.28.*: must be > 12, six standard deviations"):
        hgo.tune(build, 2.0, cutoff=20.0, dt=DT)
    noisy = ANGLE + np.random.default_rng(0).normal(0.0, 1e-3, len(T))
    wrapped = np.mod(noisy, TURN)
    plain = hgo.tune(lambda ell: hgo.StandardObserver(2, ell), (T, noisy))
    assert hgo.tune(build, (T, wrapped)).ell == pytest.approx(plain.ell, rel=1e-6)


# --- whole records -----------------------------------------------------------------------------

Y = np.mod(ANGLE, TURN)[:3000] + 1e-3 * np.random.default_rng(3).standard_normal(3000)


@pytest.mark.parametrize(
    "call",
    [
        lambda: hgo.smooth(None, (DT, Y), order=2),
        lambda: hgo.fit(hgo.Model(states=["q", "v"], parameters={"b": 0.5}, phi="-b*v"), (DT, Y)),
        lambda: hgo.compare((DT, Y), {"own": hgo.StandardObserver(2, 40.0)}, baselines=()),
        lambda: hgo.tune(None, (DT, Y)),
        lambda: hgo.tune(lambda ell: hgo.StandardObserver(2, ell), (DT, Y)),
    ],
)
def test_turns_that_nobody_told_of_are_warned_of(call):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        with contextlib.suppress(HgoError):  # of what the jumps look like
            call()
    (turn,) = [w for w in seen if w.category is TurnWarning]
    assert turn.filename == __file__
    told = str(turn.message)
    assert "jumps by nearly 6.283185307179586, as an angle" in told
    assert "numpy.unwrap(y, period=6.283185307179586)" in told


def test_a_comparison_is_up_to_whole_turns():
    """Of an observer that wraps, over a wrapped record, with a wrapped truth: as without turns."""
    true = np.column_stack([ANGLE, np.gradient(ANGLE, DT)])[:3000]
    y = true[:, 0] + 1e-3 * np.random.default_rng(3).standard_normal(3000)
    wrapped, plain = hgo.StandardObserver(2, 40.0, wrap=TURN), hgo.StandardObserver(2, 40.0)
    model = hgo.Model(states=["q", "v"], phi="0")
    for truth in (None, true):
        turned = None if truth is None else np.column_stack([np.mod(true[:, 0], TURN), true[:, 1]])
        ours = hgo.compare((DT, np.mod(y, TURN)), {"own": wrapped}, model=model, truth=turned)
        whole = hgo.compare((DT, y), {"own": plain}, model=model, truth=truth)
        assert ours.methods == whole.methods
        np.testing.assert_allclose(ours.error, whole.error, rtol=1e-5)
    both = {"a": wrapped, "b": hgo.StandardObserver(2, 40.0, wrap=360.0)}
    with pytest.raises(HgoError, match=r"wrap of 'b' = 360.0: must be 6.28"):
        hgo.compare((DT, y), both)
