"""Studies: what they give, that nothing depends on how the work is cut, saving and Ctrl-C."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import sem

import hgo_rs
from hgo_rs import (
    AdaptiveGain,
    Crackle,
    HgoError,
    Lee,
    LowPowerObserver,
    ModifiedObserver,
    NormalNoise,
    PeakingFreeObserver,
    RecordedNoise,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    Ship,
    StandardObserver,
    StochasticApproximation,
    StudyError,
    StudyInterrupted,
    VanDerPol,
    simulate,
    study,
)
from hgo_rs.simulation.studies.pieces import Todo

GRID = {"ell": [20.0, 50.0], "std": [0.001, 0.01, 0.1]}
CASES = [(ell, std) for ell in GRID["ell"] for std in GRID["std"]]


EULER = {"method": "euler", "timing": "predictor"}
"""A law with a step limit, whose memory is its estimate."""


def lee(ell=20.0, std=0.01, **changes):
    """The arguments of an experiment of 200 steps."""
    return {
        "plant": Lee(),
        "observer": StandardObserver(2, ell, k=[2.0, 2.0], **EULER),
        "x0": [1.0, -0.5],
        "dt": 0.005,
        "steps": 200,
        "noise": NormalNoise(std=std),
        "windows": [(0.2, 0.5), (0.5, 1.0)],
        "settle": 0.3,
    } | changes


def same(one, other):
    """Equal bits in every number of two studies or of a study's case and a simulation."""
    if hasattr(one, "outputs"):
        assert len(one) == len(other)
        np.testing.assert_array_equal(one.finished, other.finished)
        return [same(one[i], other[i]) for i in range(len(one))]
    for key in ("mean", "rms", "max", "peak", "settling_time", "diverged_at", "undefined_at"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key), err_msg=key)
    for key in ("final_x", "final_memory", "time", "x", "memory", "y"):
        a, b = getattr(one, key), getattr(other, key)
        assert (a is None) == (b is None), key
        if a is not None:
            np.testing.assert_array_equal(a, b, err_msg=key)


# --- what a study is ----------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["rust", "numpy"])
def test_a_case_is_a_simulation(backend):
    result = study(lee, grid=GRID, runs=21, rng=5, backend=backend)
    assert result.complete
    assert result.parameters == [{"ell": ell, "std": std} for ell, std in CASES]
    for i, (ell, std) in enumerate(CASES):
        same(result[i], simulate(**lee(ell, std), runs=21, rng=5, backend=backend))


def test_a_sample_is_what_its_rows_say():
    pd = pytest.importorskip("pandas")
    columns = {"ell": [20.0, 30.0, 20.0], "std": [0.1, 0.0, 0.1]}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    one = study(lee, sample=columns, runs=3)
    for given_as in (rows, pd.DataFrame(columns), {k: np.array(v) for k, v in columns.items()}):
        other = study(lee, sample=given_as, runs=3)
        assert other.parameters == rows
        same(one, other)
    same(one[0], one[2])
    assert not np.array_equal(one[0].rms, one[1].rms)


def test_cases_share_their_noise():
    result = study(lambda ell: lee(ell, every=1), grid={"ell": [10.0, 30.0]}, runs=3, rng=8)
    noise = [result[i].y[..., 0] - result[i].x[..., 0] for i in range(2)]
    np.testing.assert_array_equal(noise[0], noise[1])
    assert len(np.unique(noise[0][:, 0])) == 3


def test_a_generator_gives_one_seed_for_all_cases():
    seed = int(np.random.default_rng(5).integers(2**63))
    result = study(lee, grid={"ell": [20.0, 30.0]}, rng=np.random.default_rng(5))
    assert result.seed == seed
    same(result, study(lee, grid={"ell": [20.0, 30.0]}, rng=seed))


# --- how the work is cut ------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(piece=st.integers(1, 60), runs=st.integers(1, 50))
def test_bits_do_not_depend_on_pieces(piece, runs):
    build = {"ell": [20.0, 40.0]}
    same(study(lee, grid=build, runs=runs, piece=piece), study(lee, grid=build, runs=runs))


@settings(max_examples=50, deadline=None)
@given(
    data=st.data(),
    cases=st.integers(1, 4),
    runs=st.integers(1, 40),
    piece=st.none() | st.integers(1, 12),
    block=st.sampled_from([1, 4, 16]),
    wanted=st.floats(1.0, 1e5),
)
def test_every_unfinished_run_is_handed_out_once(data, cases, runs, piece, block, wanted):
    result = study(lee, sample={"ell": [20.0] * cases}, runs=runs)
    mask = data.draw(st.lists(st.booleans(), min_size=cases * runs, max_size=cases * runs))
    result.finished[:] = np.reshape(mask, (cases, runs))
    todo, times = Todo(result, piece, block), np.zeros((cases, runs), dtype=int)
    while todo.gaps:
        pieces = todo.take(wanted).pieces
        assert pieces
        for case, first, count in pieces:
            assert 0 < count <= (piece or runs)
            times[case, first : first + count] += 1
    np.testing.assert_array_equal(times, ~result.finished)


def test_starts_and_noise_of_each_run_go_with_it():
    rng = np.random.default_rng(1)
    given_rows = {
        "x0": rng.normal(size=(11, 2)),
        "memory0": rng.normal(size=(11, 2)),
        "noise": RecordedNoise(values=rng.normal(size=(11, 201))),
        "every": 3,
    }
    result = study(lambda ell: lee(ell, **given_rows), grid={"ell": [20.0]}, runs=11, piece=4)
    whole = simulate(**lee(20.0, **given_rows), runs=11)
    same(result[0], whole)
    np.testing.assert_array_equal(result[0].x[:, 0], given_rows["x0"])


GAIN = AdaptiveGain(10.0, 0.0025, 0.183)
COPIES = {"k": (2.0, 2.0), "k_bar": (0.0558, 0.0317), "copies": 3}
CRACKLE = (Crackle(), [-0.8, 0.0, 0.0, 0.0, 0.0])
SPREAD = [[0.1, 0.0], [0.2, 0.1], [0.3, 0.3]]
STRUCTURES = {
    "standard": (Lee(), StandardObserver(2, 20.0), [1.0, 0.0], None),
    "adaptive": (Lee(), StandardObserver(2, GAIN, k=(2.0, 2.0)), [1.0, 0.0], None),
    "low-power": (CRACKLE[0], LowPowerObserver(5, 7.0), CRACKLE[1], None),
    "peaking-free": (
        CRACKLE[0],
        PeakingFreeObserver(5, 7.0, saturation=(3.0, 2.0, 2.0, 2.0)),
        CRACKLE[1],
        None,
    ),
    "sampled-data": (VanDerPol(), SampledDataObserver(), [1.0, 0.0], None),
    "reduced-order": (Ship(), ReducedOrderObserver(0.1), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0], None),
    "collection": (Lee(), RepelledCollection(GAIN, **COPIES), [1.0, 0.0], (SPREAD,)),
    "modified": (Lee(), ModifiedObserver(GAIN, **COPIES), [1.0, 0.0], ([0.0, 0.0], SPREAD)),
}


@pytest.mark.parametrize("every", [0, 4])
def test_every_structure_in_one_study(every):
    """Cases of other orders, memories and plants side by side, in tables too."""

    def build(structure):
        plant, observer, x0, spread = STRUCTURES[structure]
        memory0 = None if spread is None else observer.spread(*spread)
        common = {"dt": 0.01, "steps": 41, "windows": [(0.1, 0.3)], "allow_unstable": True}
        return {"plant": plant, "observer": observer, "x0": x0, "memory0": memory0, **common} | {
            "every": every
        }

    result = study(build, grid={"structure": list(STRUCTURES)}, runs=5, piece=2, rng=3)
    for i, name in enumerate(STRUCTURES):
        whole = simulate(**build(name), runs=5, rng=3)
        same(result[i], whole)
        np.testing.assert_allclose(result.table["rms_e2"][i], whole.rms[:, 0, 1].mean())
        assert result.table["structure"][i] == name
    # the ship's observer has signals of order 3, the low-power one of order 5 and four more
    assert np.isnan(result.table["rms_memory9"]).sum() == 8 - 4
    data = pytest.importorskip("xarray") and result.to_xarray()
    low = data.sel(structure="low-power")
    np.testing.assert_array_equal(low.rms[:, 0, :9], result[2].rms[:, 0])
    np.testing.assert_array_equal(
        data.sel(structure="reduced-order").final_memory[:, :10], result[5].final_memory
    )
    assert ("x" in data) == (every > 0)
    if every:
        np.testing.assert_array_equal(low.x[..., :5], result[2].x)
        assert np.isnan(low.x[..., 5]).all()  # the ship has six states
        np.testing.assert_array_equal(low.time, result[2].time)


def test_frames_may_differ_in_number_and_runs_may_stop_early():
    """With dt = 0.2 this observer leaves at once: fewer frames come back than were asked for."""

    def build(dt):
        changes = {"dt": dt, "steps": None, "t_end": 20.0, "every": 5, "allow_unstable": True}
        return lee(60.0, **changes, windows=[], settle=None)

    result = study(build, grid={"dt": [0.01, 0.2]}, runs=3, piece=2)
    same(result[0], simulate(**build(0.01), runs=3))
    stopped = simulate(**build(0.2), runs=3)
    assert (stopped.diverged_at > 0).all()
    frames = stopped.x.shape[1]
    assert frames < 21
    np.testing.assert_array_equal(result[1].x[:, :frames], stopped.x)
    assert np.isnan(result[1].x[:, frames:]).all()
    assert result[1].x.shape == (3, 21, 2)


# --- the tables ---------------------------------------------------------------------------------


def test_the_table_holds_mean_and_standard_error():
    result = study(lee, grid=GRID, runs=30, rng=2)
    table = result.table
    assert list(table)[:4] == ["ell", "std", "runs", "diverged"]
    np.testing.assert_array_equal(table["ell"], [ell for ell, _ in CASES])
    for i, (ell, std) in enumerate(CASES):
        whole = simulate(**lee(ell, std), runs=30, rng=2)
        for name, values in {
            "mean_e1_w0": whole.mean[:, 0, 0],
            "rms_e2_w1": whole.rms[:, 1, 1],
            "max_e1_w1": whole.max[:, 1, 0],
            "peak_x_hat2": whole.peak[:, 1],
            "settling_time": whole.settling_time,
        }.items():
            np.testing.assert_allclose(table[name][i], np.mean(values), rtol=1e-13)
            np.testing.assert_allclose(table[f"{name}_se"][i], sem(values), rtol=1e-9, atol=1e-17)
    assert table["runs"].tolist() == [30] * 6
    # one run has no error; without settle there is no settling time
    single = study(lambda ell: lee(ell, settle=None), grid={"ell": [20.0]}).table
    assert np.isnan(single["rms_e1_w0_se"][0])
    assert np.isfinite(single["rms_e1_w0"][0])
    assert "settling_time" not in single


def test_a_run_that_diverges_is_counted_named_and_left_out():
    def build(ell):
        x0 = np.tile([1.0, 0.0], (6, 1))
        x0[[1, 4]] = [1e13, 0.0] if ell == 30.0 else [1.0, 0.0]  # beyond 1e12 at once
        return lee(ell, x0=x0)

    result = study(build, grid={"ell": [20.0, 30.0]}, runs=6, piece=2)
    assert result.diverged.tolist() == [[1, 1], [1, 4]]
    assert result.table["diverged"].tolist() == [0, 2]
    others = [0, 2, 3, 5]
    for name, values in {
        "rms_e2_w1": result[1].rms[others, 1, 1],
        "peak_x_hat1": result[1].peak[others, 0],
    }.items():
        np.testing.assert_allclose(result.table[name][1], values.mean(), rtol=1e-13)
    assert result.table["peak_x_hat1"][1] < 10.0
    for told in ("2 runs diverged", "(1, 1), (1, 4)", "case 1 (ell = 30.0)", "left out"):
        assert told in repr(result)
    assert "diverged" not in repr(study(build, grid={"ell": [20.0]}, runs=6))


def test_all_runs_may_diverge():
    result = study(
        lambda dt: lee(60.0, dt=dt, allow_unstable=True, steps=400, windows=[(0.0, 50.0)]),
        grid={"dt": [0.005, 0.2]},
        runs=4,
    )
    assert result.table["diverged"].tolist() == [0, 4]
    assert np.isnan(result.table["rms_e1"][1])
    assert np.isfinite(result.table["rms_e1"][0])


def test_dataframes_and_datasets():
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    result = study(lee, grid=GRID, runs=4, rng=2)
    cases, runs = result.to_dataframe(), result.to_dataframe(runs=True)
    assert cases.shape[0] == 6
    assert runs.shape[0] == 24
    np.testing.assert_allclose(
        runs.groupby(["ell", "std"])["rms_e2_w1"].mean().to_numpy(), cases["rms_e2_w1"].to_numpy()
    )
    data = result.to_xarray()
    sizes = {"ell": 2, "std": 3, "run": 4, "window": 2, "signal": 2, "entry": 2, "state": 2}
    assert dict(data.sizes) == sizes
    one = data.sel(ell=50.0, std=0.1, run=3)
    whole = simulate(**lee(50.0, 0.1), runs=4, rng=2)
    np.testing.assert_array_equal(one.rms, whole.rms[3])
    np.testing.assert_array_equal(one.peak.sel(entry="x_hat2"), whole.peak[3, 1])
    sample = study(lee, sample={"ell": [20.0, 30.0], "std": [0.1, 0.2]}, runs=2).to_xarray()
    assert sample.rms.dims[0] == "case"
    np.testing.assert_array_equal(sample.ell, [20.0, 30.0])


def test_parameters_that_are_no_numbers_are_labels():
    observers = {"fast": [-2.0, -3.0], "slow": [-1.0, -1.5]}

    def build(poles, observer):
        return lee() | {"observer": observer(2, 20.0, poles=poles)}

    result = study(build, grid={"poles": [*observers.values()], "observer": [StandardObserver]})
    assert result.table["poles"].tolist() == ["[-2.0, -3.0]", "[-1.0, -1.5]"]
    assert result.table["observer"].tolist() == ["StandardObserver"] * 2
    assert result.parameters[1]["poles"] == [-1.0, -1.5]


def test_one_run_again_with_its_frames():
    result = study(lee, grid=GRID, runs=5, rng=2)
    again = result.rerun(4, 3)
    whole = simulate(**lee(*CASES[4], every=1), runs=5, rng=2)
    np.testing.assert_array_equal(again.x[0], whole.x[3])
    np.testing.assert_array_equal(again.final_memory[0], result[4].final_memory[3])
    with pytest.raises(HgoError, match="run = 5"):
        result.rerun(0, 5)


def test_the_plot_shows_the_table():
    pytest.importorskip("matplotlib")
    result = study(lee, grid=GRID, runs=3)
    (ax,) = result.plot("rms_e2_w1", "std").get_axes()
    lines = [container.lines[0] for container in ax.containers]
    assert len(lines) == 2
    np.testing.assert_array_equal(lines[1].get_xdata(), GRID["std"])
    np.testing.assert_array_equal(lines[1].get_ydata(), result.table["rms_e2_w1"][3:])
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["ell = 20.0", "ell = 50.0"]
    with pytest.raises(HgoError, match="metric = 'rms'"):
        result.plot("rms")


# --- progress -----------------------------------------------------------------------------------


def test_progress_is_told():
    seen = []
    result = study(lee, grid=GRID, runs=40, piece=8, progress=seen.append)
    assert result.complete
    done = [p.done for p in seen]
    assert done == sorted(done)
    assert done[-1] == seen[-1].total == 6 * 40 * 200
    assert seen[-1].time_left == 0.0
    assert all(p.rate > 0.0 for p in seen)


def test_a_bar_on_standard_error(capsys):
    study(lee, grid=GRID, runs=2)
    assert capsys.readouterr().err == ""  # no terminal
    study(lee, grid=GRID, runs=2, progress=True)
    said = capsys.readouterr()
    assert "run-steps/s" in said.err
    assert "100%" in said.err
    assert said.out == ""


# --- saving -------------------------------------------------------------------------------------


class Stop:
    """Interrupts after so many pieces, as Ctrl-C would."""

    def __init__(self, after, error=KeyboardInterrupt):
        self.left, self.error = after, error

    def __call__(self, progress):
        self.left -= 1
        if not self.left:
            raise self.error


def small_tasks(monkeypatch):
    """A piece a task, so that a short study has many."""
    monkeypatch.setattr("hgo_rs.simulation.studies.pieces._FIRST", 1)
    monkeypatch.setattr("hgo_rs.simulation.studies.pieces._HERE", 0.0)


@pytest.mark.parametrize("every", [0, 50])
def test_a_saved_study_continues_with_the_same_bits(tmp_path, monkeypatch, every):
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    small_tasks(monkeypatch)
    path = tmp_path / "study.parquet"
    arguments = {"grid": {"ell": [20.0, 50.0]}, "runs": 20, "rng": 4, "piece": 6, "save": path}

    def build(ell):
        return lee(ell, every=every)

    whole = study(build, grid=arguments["grid"], runs=20, rng=4)
    with pytest.raises(StudyInterrupted) as stopped:
        study(build, **arguments, progress=Stop(2))
    kept = stopped.value.result
    assert kept.finished.sum() == 12
    assert not kept.complete
    assert "NOT COMPLETE: 12 of 40" in repr(kept)
    np.testing.assert_array_equal(kept[0].rms[:12], whole[0].rms[:12])
    assert np.isnan(kept[0].rms[12:]).all()
    assert kept.table["runs"].tolist() == [12, 0]
    np.testing.assert_allclose(kept.table["rms_e2_w0"][0], whole[0].rms[:12, 0, 1].mean())
    assert len(pd.read_parquet(path)) == 12

    seen = []
    same(study(build, **arguments, progress=seen.append), whole)
    assert seen[0].done == (12 + 6) * 200
    frame = pd.read_parquet(path)
    np.testing.assert_array_equal(frame.rms_e2_w1[frame.ell == 50.0], whole[1].rms[:, 1, 1])
    # there is nothing left to do, and more runs continue
    same(study(build, **arguments, progress=Stop(1)), whole)
    more = study(build, **arguments | {"runs": 26})
    same(more, study(build, grid=arguments["grid"], runs=26, rng=4))
    assert list(tmp_path.iterdir()) == [path]


def test_frames_of_some_cases_only_are_saved(tmp_path):
    pytest.importorskip("pyarrow")
    arguments = {"grid": {"every": [0, 50]}, "runs": 3, "save": tmp_path / "study.parquet"}
    first = study(lambda every: lee(every=every), **arguments)
    same(study(lambda every: lee(every=every), **arguments, progress=Stop(1)), first)
    assert first[0].x is None
    assert first[1].x.shape == (3, 5, 2)


SAVED = {"grid": {"ell": [20.0, 50.0]}, "runs": 4, "rng": 4}
OTHERS = {
    "seed is 4 there and 5 here": {"rng": 5},
    "runs is 4 there and 3 here": {"runs": 3},
    "parameter ell of case 1 is 50.0 there and 60.0 here": {"grid": {"ell": [20.0, 60.0]}},
    "it has 2 cases there and 1 here": {"grid": {"ell": [20.0]}},
    "parameter gain of case 0 is 'nothing' there and 20.0 here": {
        "build": lambda gain: lee(gain),
        "grid": {"gain": [20.0, 50.0]},
    },
    "steps of case 0 is 200 there and 201 here": {"build": lambda ell: lee(ell, steps=201)},
    "noise.std of case 0 is 0.01 there and 0.02 here": {"build": lambda ell: lee(ell, 0.02)},
    "x0 of case 0 is [1.0, -0.5] there and [1.0, 0.0] here": {
        "build": lambda ell: lee(ell, x0=[1.0, 0.0])
    },
    "backend is 'rust' there and 'numpy' here": {"backend": "numpy"},
}


@pytest.mark.parametrize("told", OTHERS)
def test_another_study_is_refused_and_the_difference_named(tmp_path, told):
    pytest.importorskip("pyarrow")
    path = tmp_path / "study.parquet"
    study(lee, **SAVED, save=path)
    before = path.read_bytes()
    with pytest.raises(HgoError) as refused:
        study(**{"build": lee, **SAVED, "save": path} | OTHERS[told])
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)
    assert path.read_bytes() == before


def test_another_version_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("pyarrow")
    path = tmp_path / "study.parquet"
    study(lee, **SAVED, save=path)
    monkeypatch.setattr("hgo_rs.simulation.studies.saved.__version__", "9.9.9")
    with pytest.raises(HgoError, match=r"hgo_rs is '.*' there and '9.9.9' here"):
        study(lee, **SAVED, save=path)


def damage(path, how):
    data = bytearray(path.read_bytes())
    if how == "truncated":
        path.write_bytes(data[: len(data) // 2])
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "text":
        path.write_text("not a study")
    elif how == "a flipped bit":
        data[len(data) // 8] ^= 4  # within the first columns
        path.write_bytes(data)
    else:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pq.read_table(path)
        if how == "no study":
            table = pa.table({"a": [1.0]})
        elif how == "rows twice":
            table = pa.concat_tables([table, table])
        elif how == "a column less":
            table = table.drop_columns(["rms_e1_w0"])
        elif how == "a run too far":
            run = pa.array([0, 1, 2, 99] * 2)
            table = table.set_column(table.column_names.index("run"), "run", run)
        elif how == "a run that is no number":
            run = pa.array([0, 1, 2, None] * 2)
            table = table.set_column(table.column_names.index("run"), "run", run)
        elif how == "a run of floats":
            run = table["run"].cast(pa.float64())
            table = table.set_column(table.column_names.index("run"), "run", run)
        elif how == "cases for one another":
            case = pa.array([1] * 4 + [0] * 4)
            table = table.set_column(table.column_names.index("case"), "case", case)
        elif how == "columns for one another":
            swap = {"rms_e1_w0": "rms_e2_w0", "rms_e2_w0": "rms_e1_w0"}
            table = table.rename_columns([swap.get(name, name) for name in table.column_names])
        elif how == "another number":
            peak = table["peak_x_hat1"].to_numpy().copy()
            peak[5] = np.nextafter(peak[5], 9.0)
            where = table.column_names.index("peak_x_hat1")
            table = table.set_column(where, "peak_x_hat1", pa.array(peak))
        elif how == "rows of another study":
            other = path.with_name("other.parquet")
            study(lee, **SAVED | {"rng": 5}, save=other)
            rows = [table.slice(0, 7), pq.read_table(other).slice(7)]
            table = pa.concat_tables(rows).replace_schema_metadata(table.schema.metadata)
        elif how == "metadata":
            table = table.replace_schema_metadata({b"hgo_rs.study": b'{"study": '})
        pq.write_table(table, path)


@pytest.mark.parametrize(
    "how",
    [
        *("truncated", "empty", "text", "a flipped bit", "no study", "rows twice"),
        *("a column less", "a run too far", "a run that is no number", "a run of floats"),
        *("cases for one another", "columns for one another", "another number"),
        *("rows of another study", "metadata"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, how):
    pytest.importorskip("pyarrow")
    path = tmp_path / "study.parquet"
    study(lee, **SAVED, save=path)
    damage(path, how)
    before = path.read_bytes()
    with pytest.raises(HgoError, match="must be a study saved by hgo_rs, and whole") as refused:
        study(lee, **SAVED, save=path)
    assert "\n" not in str(refused.value)
    assert path.read_bytes() == before


@pytest.mark.parametrize("every", [0, 50])
def test_rows_are_placed_by_case_and_run(tmp_path, every):
    """Rows in any order give the runs they are of; those that were left out are computed again."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path, seen = tmp_path / "study.parquet", []

    def build(ell):
        return lee(ell, every=every)

    whole = study(build, **SAVED)
    study(build, **SAVED, save=path)
    table = pq.read_table(path)
    pq.write_table(table.sort_by("rms_e2_w1"), path)
    again = study(build, **SAVED, save=path, progress=seen.append)
    same(again, whole)
    assert not seen
    np.testing.assert_array_equal(again.table["rms_e2_w1"], whole.table["rms_e2_w1"])
    for name, column in again.run_table().items():
        np.testing.assert_array_equal(column, whole.run_table()[name])
    order = np.random.default_rng(0).permutation(8)[:5]
    pq.write_table(table.take(pa.array(order)), path)
    same(study(build, **SAVED, save=path, progress=seen.append), whole)
    assert seen[-1].done - seen[0].done < 8 * 200
    assert len(pq.read_table(path)) == 8


def test_a_write_that_fails_leaves_the_earlier_file(tmp_path, monkeypatch):
    pq = pytest.importorskip("pyarrow.parquet")
    small_tasks(monkeypatch)
    path = tmp_path / "study.parquet"
    with pytest.raises(StudyInterrupted):
        study(lee, **SAVED, save=path, piece=1, progress=Stop(3))
    before = path.read_bytes()

    def full(table, file, **options):
        file.write(b"PAR1")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pq, "write_table", full)
    with pytest.raises(StudyError, match="No space left") as stopped:
        study(lee, **SAVED, save=path, piece=1)
    same(stopped.value.result, study(lee, **SAVED))
    told = str(stopped.value)
    assert "8 of 8 runs are finished" in told
    assert f"3 of them saved; the next call with save={str(path)!r} continues from these" in told
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
@pytest.mark.parametrize("gone", ["full disk", "no folder", "no folder any more"])
def test_what_is_not_on_the_disk_is_not_called_saved(tmp_path, monkeypatch, error, gone):
    pq = pytest.importorskip("pyarrow.parquet")
    small_tasks(monkeypatch)
    folder = tmp_path / "folder"
    folder.mkdir()
    path = folder / "study.parquet"
    if gone == "no folder any more":
        with pytest.raises(StudyInterrupted, match="all of them saved"):
            study(lee, **SAVED, save=path, piece=1, progress=Stop(3))

    def full(table, file, **options):
        raise OSError(28, "No space left on device")

    def stop(progress):
        if gone == "full disk":
            monkeypatch.setattr(pq, "write_table", full)
        else:
            shutil.rmtree(folder)
        raise error

    with pytest.raises((StudyInterrupted, StudyError)) as stopped:
        study(lee, **SAVED, save=path, piece=1, progress=stop)
    assert isinstance(stopped.value, KeyboardInterrupt) == (error is KeyboardInterrupt)
    told = str(stopped.value)
    assert "none is saved" in told
    assert "could not be written (" in told
    assert stopped.value.result.finished.sum() == (4 if "any more" in gone else 1)
    assert not path.exists()


def test_metadata_is_plain_json(tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "study.parquet"
    study(lee, **SAVED, save=path)
    saved = json.loads(pq.read_schema(path).metadata[b"hgo_rs.study"])["study"]
    assert saved["hgo_rs"] == hgo_rs.__version__
    assert saved["shared"]["noise.std"] == 0.01
    assert [case["parameter ell"] for case in saved["cases"]] == [20.0, 50.0]


# --- Ctrl-C -------------------------------------------------------------------------------------

CHILD = """
import sys
import pandas, pyarrow.parquet  # what the study loads, before the clock runs
import hgo_rs as hgo
from hgo_rs.simulation.studies import pieces

def build(ell):
    return dict(plant=hgo.Lee(), observer=hgo.StandardObserver(2, ell, k=[2.0, 2.0]),
                x0=[1.0, 0.0], dt=1e-3, steps={steps}, noise=hgo.NormalNoise(std=0.01))

def told(progress):
    print("piece", flush=True)

def execute(spec, *by, plain=pieces.execute):
    if {steps} > 10**6:
        print("piece", flush=True)  # begins; it would take hours
    return plain(spec, *by)

pieces.execute = execute

print("ready", flush=True)
try:
    hgo.study(build, grid=dict(ell=[20.0, 50.0]), runs={runs}, rng=3, save={path!r}, progress=told)
except KeyboardInterrupt as stop:
    print("interrupted", int(stop.result.finished.sum()), flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="SIGINT cannot be sent to a child on Windows")
@pytest.mark.parametrize(("steps", "pieces"), [(2_000, 3), (10**10, 0)])
def test_ctrl_c_ends_soon_and_keeps_what_is_finished(tmp_path, steps, pieces):
    pd = pytest.importorskip("pandas")
    path = tmp_path / "study.parquet"
    code = CHILD.format(steps=steps, runs=10**6, path=str(path))
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        for _ in range(pieces or 1):
            assert process.stdout.readline() == "piece\n"
        if not pieces:
            time.sleep(0.5)  # in the middle of the first piece
        begin = time.monotonic()
        process.send_signal(signal.SIGINT)
        said = process.stdout.read().split()
        elapsed = time.monotonic() - begin
        assert process.wait(30) == 0
    finally:
        process.kill()
    print(f"ended {elapsed:.2f} s after Ctrl-C")
    assert elapsed < 3.0
    assert said[-2] == "interrupted"
    kept = int(said[-1])
    assert (kept > 0) == (pieces > 0)
    if pieces:
        frame = pd.read_parquet(path)
        assert len(frame) == kept
        first = frame[(frame.case == 0) & (frame.run < 20)]
        again = simulate(
            Lee(),
            StandardObserver(2, 20.0, k=[2.0, 2.0]),
            x0=[1.0, 0.0],
            dt=1e-3,
            steps=steps,
            noise=NormalNoise(std=0.01),
            runs=20,
            rng=3,
        )
        np.testing.assert_array_equal(first.peak_x_hat2, again.peak[:, 1])


def test_an_error_in_the_users_function_loses_nothing(monkeypatch):
    small_tasks(monkeypatch)
    with pytest.raises(StudyError, match="ZeroDivisionError") as stopped:
        study(lee, **SAVED, piece=1, progress=Stop(3, ZeroDivisionError))
    assert stopped.value.result.finished.sum() == 3


# --- bad input ----------------------------------------------------------------------------------

BAD = {
    "grid: give either": {"grid": None},
    "grid: give either grid": {"sample": {"ell": [1.0]}},
    "grid = {}: must be at least one parameter": {"grid": {}},
    "grid = [1, 2]: must be a dict": {"grid": [1, 2]},
    "grid['ell'] = []: must be at least one value": {"grid": {"ell": []}},
    "grid['ell'] = 20.0: must be a list of values": {"grid": {"ell": 20.0}},
    "grid['ell'] = 'abc': must be a list of values": {"grid": {"ell": "abc"}},
    "name in grid = 'a b': must be a name": {"grid": {"a b": [1]}},
    "name in grid = 1: must be a name": {"grid": {1: [1]}},
    "name in grid = 'run': must be none of case": {"grid": {"run": [1]}},
    "lengths of sample = {'ell': 2, 'std': 1}: must be equal": {
        "grid": None,
        "sample": {"ell": [20.0, 30.0], "std": [0.1]},
    },
    "sample[1] = {'std': 0.1}: must be with the keys ['ell']": {
        "grid": None,
        "sample": [{"ell": 20.0}, {"std": 0.1}],
    },
    "sample = []: must be a dict of columns": {"grid": None, "sample": []},
    "sample = 3: must be a dict of columns": {"grid": None, "sample": 3},
    "parameters = ['el']: must be those of build: ": {"grid": {"el": [20.0]}},
    "runs = 0: must be an integer >= 1": {"runs": 0},
    "runs = -3: must be an integer >= 1": {"runs": -3},
    "runs = 2.5: must be an integer >= 1": {"runs": 2.5},
    "rng = 1.5: must be an integer >= 0": {"rng": 1.5},
    "rng = None: must be an integer >= 0": {"rng": None},
    "rng = -1: must be an integer >= 0": {"rng": -1},
    "piece = 0: must be an integer >= 1": {"piece": 0},
    "backend = 'cuda': must be one of rust, numpy": {"backend": "cuda"},
    "executor = 4: must be an executor": {"executor": 4},
    "progress = 3: must be True, False or a function": {"progress": 3},
    "max_memory = 'much': must be a number": {"max_memory": "much"},
    "max_memory = -1: must be finite and > 0": {"max_memory": -1},
    "build = 3: must be a function": {"build": 3},
    "case 1 (ell = 1000.0): dt = 0.005: must be < ": {"grid": {"ell": [20.0, 1000.0]}},
    "case 0 (ell = 20.0): steps = 0: must be": {"build": lambda ell: lee(ell, steps=0)},
    "case 0 (ell = 20.0): steps = -5: must be": {"build": lambda ell: lee(ell, steps=-5)},
    "case 0 (ell = 20.0): build = None: must be the arguments of simulate": {
        "build": lambda ell: None
    },
    "case 0 (ell = 20.0): runs = 3: must be given to study": {"build": lambda ell: lee(runs=3)},
    "case 0 (ell = 20.0): histogram = '...': must be left out": {
        "build": lambda ell: lee(ell, histogram=(0.1, 0.2))
    },
    "case 0 (ell = 20.0): build: TypeError: got an unexpected keyword argument 'dtt'": {
        "build": lambda ell: lee(ell, dtt=0.1)
    },
    "case 0 (ell = 20.0): build: TypeError: missing a required argument: 'observer'": {
        "build": lambda ell: {"plant": Lee()}
    },
    "case 0 (ell = 20.0): build: ZeroDivisionError: ": {"build": lambda ell: lee(1 / 0)},
    # what only the core refuses: a plant with process noise by a method without
    "case 0 (ell = 20.0): ": {
        "build": lambda ell: {
            **lee() | {"plant": VanDerPol(), "plant_method": "rk4"},
        }
    },
    "in an existing folder": {"save": "/nowhere/at/all/study.parquet"},
    "save = 3: must be a path": {"save": 3},
}


@pytest.mark.parametrize("told", BAD)
def test_bad_input_is_one_clear_line(told):
    with pytest.raises(HgoError) as refused:
        study(**{"build": lambda ell: lee(ell), "grid": {"ell": [20.0]}} | BAD[told])
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_is_no_file(tmp_path):
    pytest.importorskip("pyarrow")
    with pytest.raises(HgoError, match="must be a file"):
        study(lee, **SAVED, save=tmp_path)


def test_a_result_beyond_the_memory_is_refused():
    arguments = {"grid": {"ell": [20.0]}, "runs": 1000}
    with pytest.raises(HgoError, match=r"it would take 0.000168 GB of 1e-05 GB; fewer runs"):
        study(lee, **arguments, max_memory=1e4)
    assert study(lee, **arguments, max_memory=1e6).complete
    # of this machine's memory
    with pytest.raises(HgoError, match=r"it would take 9.02e\+03 GB of"):
        study(lee, grid={"ell": np.linspace(20.0, 30.0, 50)}, runs=2**30)


def test_no_metric_need_be_there():
    """A study of a stochastic-approximation clock without windows has peaks only."""
    clock = {"dt": None, "schedule": StochasticApproximation(0.2, 0.05, 100.0)}
    result = study(lambda ell: lee(ell, **clock, windows=[], settle=None), grid={"ell": [5.0]})
    names = [name for name in result.table if not name.endswith("_se")]
    assert names == ["ell", "runs", "diverged", "peak_x_hat1", "peak_x_hat2"]


@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(stop=st.integers(1, 9), piece=st.integers(1, 5), second=st.integers(1, 9))
def test_any_two_interrupts_change_no_bit(tmp_path_factory, stop, piece, second):
    pytest.importorskip("pyarrow")
    path = tmp_path_factory.mktemp("saved") / "s.parquet"
    with pytest.MonkeyPatch.context() as patch:
        small_tasks(patch)
        for after in (stop, second):
            with contextlib.suppress(StudyInterrupted):
                study(lee, **SAVED, piece=piece, save=path, progress=Stop(after))
        result = study(lee, **SAVED, save=path)
    same(result, study(lee, **SAVED))
