"""Observers as FMUs: FMPy validates them, and runs them with the bits of Python's `run`."""

from __future__ import annotations

import os
import sys
import warnings
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from exported import WARNINGS, put, run
from test_export_every import CASES, DT, U, Y

import hgo_rs as hgo
from hgo_rs.cli import main
from hgo_rs.errors import HgoError
from hgo_rs.exports import export, sources
from hgo_rs.exports.fmu.units import dimension
from hgo_rs.exports.program import program
from hgo_rs.observers import Observer

fmpy = pytest.importorskip("fmpy")
from fmpy import fmi2, fmi3  # noqa: E402
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")

VERSIONS = ("2.0", "3.0")
NAMES = {"q": "rad", "w": "rad/s", "y": "rad", "u": "N*m", "J": "kg*m^2"}


def axis(**manner: Any) -> Observer:
    """A pendulum with a torque."""
    model = hgo.Model(
        states=["q", "w"],
        inputs=["u"],
        parameters={"J": 0.5, "c": 0.2},
        phi="(u - c*w)/J - 9.81*sin(q) + 0.1*cos(3*t)",
    )
    return hgo.StandardObserver(2, 15.0, model=model, **manner)


class Unit:
    """An instance of an FMU in FMPy, its variables by name."""

    def __init__(self, file: Path, folder: Path) -> None:
        self.described = fmpy.read_model_description(str(file))
        self.variables = {v.name: v for v in self.described.modelVariables}
        where = fmpy.extract(str(file), unzipdir=str(folder))
        self.second = self.described.fmiVersion == "2.0"
        made = fmi2.FMU2Slave if self.second else fmi3.FMU3Slave
        self.fmu = made(
            guid=self.described.guid or self.described.instantiationToken,
            unzipDirectory=where,
            modelIdentifier=self.described.coSimulation.modelIdentifier,
        )
        self.said: list[str] = []
        if self.second:
            self.fmu.instantiate()
        else:
            self.fmu.instantiate(logMessage=self._heard)
        self.time = 0.0

    def _heard(self, *told: Any) -> None:
        self.said.append(told[-1].decode())

    def start(self, **values: Any) -> Unit:
        if self.second:
            self.fmu.setupExperiment(startTime=0.0)
        self.set(**values)
        self.fmu.enterInitializationMode(**({} if self.second else {"startTime": 0.0}))
        self.fmu.exitInitializationMode()
        return self

    def _of(self, verb: str, kind: str) -> Any:
        kinds = {"Float64": "Real", "Int32": "Integer"} if self.second else {}
        return getattr(self.fmu, verb + kinds.get(kind, kind))

    def set(self, **values: Any) -> None:
        for name, value in values.items():
            kind = "Boolean" if isinstance(value, bool) else "Float64"
            self._of("set", kind)([self.variables[name].valueReference], [value])

    def get(self, *names: str, kind: str = "Float64") -> list[Any]:
        found = self._of("get", kind)([self.variables[name].valueReference for name in names])
        return list(found)

    @property
    def status(self) -> int:
        return int(self.get("sample_status", kind="Int32")[0])

    def step(self, dt: float, **values: Any) -> None:
        self.set(**values)
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=dt)
        self.time += dt

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


def unit(tmp_path: Path, observer: Observer, version: str, **options: Any) -> Unit:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (file,) = export(observer, to="fmu", out=tmp_path, name="axis", version=version, **options)
    assert file == tmp_path / "axis.fmu" and validate_fmu(str(file)) == []
    return Unit(file, tmp_path / f"unit_{version}")


def names_of(of: Unit, causality: str, end: str = "") -> list[str]:
    """Names of variables, in order."""
    return [
        v.name
        for v in of.described.modelVariables
        if v.causality == causality and v.name.endswith(end)
    ]


# --- whole records --------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("timing", ["current", "predictor"])
def test_fmpy_runs_a_record_with_gaps(tmp_path: Path, timing: str, version: str) -> None:
    observer = axis(timing=timing)
    (file,) = export(observer, to="fmu", out=tmp_path, name="axis", version=version, units=NAMES)
    assert validate_fmu(str(file)) == []
    rng = np.random.default_rng(3)
    t = 0.01 * np.arange(400)
    y, u = np.sin(2.0 * t) + 0.01 * rng.normal(size=400), rng.normal(size=400)
    y[[40, 41, 42, 100, 250]] = np.nan
    record = np.array(
        list(zip(t, y, u, strict=True)), dtype=[("time", float), ("y", float), ("u", float)]
    )
    shown = ["q_hat", "w_hat", "sample_status"]
    shown += ["q_corrected", "w_corrected"] if timing == "current" else []
    told = fmpy.simulate_fmu(
        str(file), stop_time=4.0, output_interval=0.01, input=record, output=shown
    )
    found = observer.run(t, y, u)
    assert found.missing.sum() == 5
    np.testing.assert_array_equal(told["sample_status"][1:] == 1, found.missing)
    if timing == "current":  # at the instant of the sample
        np.testing.assert_array_equal(told["q_corrected"][1:], found.x_hat[:, 0])
        np.testing.assert_array_equal(told["w_corrected"][1:], found.x_hat[:, 1])
    else:
        np.testing.assert_array_equal(told["q_hat"][:-1], found.x_hat[:, 0])
        np.testing.assert_array_equal(told["w_hat"][:-1], found.x_hat[:, 1])
    # what a loop sees: the estimate for the instant that the step has reached
    error = np.abs(told["q_hat"] - np.sin(2.0 * told["time"]))[100:]
    assert error.max() < 0.1


SAMPLE = (
    "standard, zoh, current",
    "standard, rk4, predictor",
    "low-power, zoh, current",
    "low-power, bilinear, predictor",
    "peaking-free, smooth, staggered-euler, current",
    "adaptive, bogacki-shampine, current",
    "chains, zoh, current",
    "chains, rk4, predictor",
    "collection, rk4, current",
    "modified, euler, predictor",
    "sampled-data",
    "strict-feedback",
    "ship",
)


@pytest.mark.parametrize("case", SAMPLE)
def test_laws_have_the_bits_of_run(tmp_path: Path, case: str) -> None:
    """Over gaps; where gains are not for whole periods, at uneven times too."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        observer = CASES[case]()
        held = ("zoh" in case or "bilinear" in case) and "standard" not in case
        count = len(Y)
        lengths = np.full(count, DT) if held else DT * (1.0 + 0.3 * np.sin(np.arange(count)))
        t = np.concatenate([[0.0], np.cumsum(lengths[:-1])])
        y, u = Y[:, : observer.n_y], U[:, : observer.n_u]
        found = observer.run(DT if held else t, y, u, memory0=observer.memory)
        moved = CASES[case]()
        predicted = []
        for k in range(count):
            dt = DT if held else float((t[k + 1] if k + 1 < count else t[k] + DT) - t[k])
            if observer.timing == "current":
                moved.correct(y[k])
                moved.predict(u[k], dt)
            else:
                moved.step(y[k], u[k], dt=dt)
            predicted.append(moved.memory[: observer.n].copy())
    for version in VERSIONS:
        of = unit(tmp_path / version, CASES[case](), version, dt=DT)
        of.start()
        inputs = [name for name in names_of(of, "input") if not name.endswith("_present")]
        estimates = names_of(of, "output", "_hat")
        corrected = names_of(of, "output", "_corrected")
        assert len(inputs) == observer.n_y + observer.n_u and len(estimates) == observer.n
        assert bool(corrected) == (observer.timing == "current")
        for k in range(count):
            if not corrected:
                assert of.get(*estimates) == found.x_hat[k].tolist()
            # the unit's time is the record's, not a sum of its own
            of.time = DT * k if held else float(t[k])
            dt = DT if held else float((t[k + 1] if k + 1 < count else t[k] + DT) - t[k])
            of.step(dt, **dict(zip(inputs, map(float, (*y[k], *u[k])), strict=True)))
            assert of.status == int(np.isnan(y[k]).any())
            if corrected:
                assert of.get(*corrected) == found.x_hat[k].tolist()
            assert of.get(*estimates) == predicted[k].tolist()
        of.close()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("case", [SAMPLE[0], SAMPLE[2], SAMPLE[6], SAMPLE[1]])
def test_a_fixed_period_has_the_bits_of_run(tmp_path: Path, case: str, version: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        observer = CASES[case]()
        y, u = Y[:, : observer.n_y], U[:, : observer.n_u]
        found = observer.run(DT, y, u)
        of = unit(tmp_path, observer, version, fixed_dt=DT)
    assert not of.described.coSimulation.canHandleVariableCommunicationStepSize
    assert float(of.described.defaultExperiment.stepSize) == DT
    of.start()
    inputs = [name for name in names_of(of, "input") if not name.endswith("_present")]
    current = observer.timing == "current"
    shown = names_of(of, "output", "_corrected" if current else "_hat")
    for k in range(len(y)):
        if not current:
            assert of.get(*shown) == found.x_hat[k].tolist()
        of.time = DT * k
        # a tool's steps are differences of its times
        of.step(
            DT * (1.0 + 1e-9 * (-1) ** k),
            **dict(zip(inputs, map(float, (*y[k], *u[k])), strict=True)),
        )
        if current:
            assert of.get(*shown) == found.x_hat[k].tolist()
    with pytest.raises(FMICallException):
        of.step(1.01 * DT)
    if version == "3.0":
        told = "a step whose length is not 0.01 s, for which the observer was exported"
        assert of.said == [told]
    of.close()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("timing", ["current", "predictor"])
def test_single_precision_has_the_bits_of_the_vector(
    tmp_path: Path, timing: str, version: str
) -> None:
    observer = axis(timing=timing)
    rows = program(observer, name="axis", precision="single").vector
    of = unit(tmp_path, observer, version, precision="single").start()
    current = timing == "current"
    for k, row in enumerate(rows[: len(rows) - current]):
        moving = rows[k + 1] if current else row
        of.time = moving.t
        of.step(moving.dt, y=row.y[0], u=moving.u[0])
        shown = ("q_corrected", "w_corrected") if current else ("q_hat", "w_hat")
        assert of.get(*shown) == list(row.memory[:2])
        assert np.float32(of.get("w_hat")[0]) == of.get("w_hat")[0]
    of.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_turning_axis_stays_in_one_turn(tmp_path: Path, version: str) -> None:
    observer = hgo.StandardObserver(2, 30.0, wrap=2.0 * np.pi)
    t = 0.01 * np.arange(400)
    y = np.mod(9.0 * t, 2.0 * np.pi)
    y[200:230] = np.nan
    found = observer.run(t, y)
    of = unit(tmp_path, observer, version).start()
    for k in range(400):
        of.time = float(t[k])
        of.step(float(t[k + 1] - t[k]) if k < 399 else 0.01, y=float(y[k]))
        assert of.get("x1_corrected", "x2_corrected") == found.x_hat[k].tolist()
    assert abs(of.get("x2_hat")[0] - 9.0) < 1e-6
    of.close()


# --- variables ------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_a_sample_that_is_not_present_is_missing(tmp_path: Path, version: str) -> None:
    units = [unit(tmp_path / word, axis(), version).start() for word in ("nan", "infinite", "no")]
    for k in range(30):
        missing = k % 4 == 3
        for of, value in zip(units, (np.nan, -np.inf, 7.0), strict=True):
            told = {"y": value if missing else 0.1 * k, "u": 0.3}
            if of is units[-1]:
                told["y_present"] = not missing
            of.step(0.01, **told)
            assert of.status == int(missing)
        first, *others = (of.get("q_hat", "w_hat", "elapsed") for of in units)
        assert others == [first, first]
    for of in units:
        of.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_parameters_and_start_are_told(tmp_path: Path, version: str) -> None:
    of = unit(tmp_path, axis(), version, units=NAMES)
    described = of.variables
    told = {"q_hat": "rad", "w_corrected": "rad/s", "u": "N*m", "J": "kg*m^2", "y": "rad"}
    for name, of_name in (told | {"elapsed": "s"}).items():
        assert described[name].unit == of_name
    assert described["J"].causality == "parameter" and described["J"].variability == "tunable"
    assert float(described["J"].start) == 0.5 and float(described["q_hat"].start) == 0.0
    of.start(q_hat=0.3, w_hat=-1.0, J=0.25)
    assert of.get("q_corrected", "w_corrected", "J") == [0.3, -1.0, 0.25]
    observer = axis()
    t, y, u = 0.01 * np.arange(40), 0.02 * np.arange(40), np.linspace(-1.0, 1.0, 40)
    model = observer.model
    other = hgo.StandardObserver(2, 15.0, model=model.with_parameters(J=0.25))
    found = other.run(t[:20], y[:20], u[:20], x_hat0=[0.3, -1.0], until=t[20])
    after = hgo.StandardObserver(2, 15.0, model=model.with_parameters(J=0.25, c=0.9))
    last = after.run(t[20:], y[20:], u[20:], memory0=found.next_memory)
    whole = np.concatenate([found.x_hat, last.x_hat])
    for k in range(40):
        of.time = float(t[k])
        dt = float(t[k + 1] - t[k]) if k < 39 else 0.01
        of.step(dt, y=float(y[k]), u=float(u[k]), **({"c": 0.9} if k == 20 else {}))
        assert of.get("q_corrected", "w_corrected") == whole[k].tolist()
    of.close()


def test_names_that_c_has_taken_are_mangled(tmp_path: Path) -> None:
    model = hgo.Model(
        states=["time", "q_hat"],
        inputs=["sample_status", "int"],
        parameters={"dt": 2.0, "PI": 3.0},
        phi="sample_status + int - dt*q_hat - PI*sin(time)",
    )
    observer = hgo.StandardObserver(2, 9.0, model=model)
    for version in VERSIONS:
        observer.reset()
        of = unit(tmp_path / version, observer, version, units={"dt": "1/s", "int": "N"})
        assert len(of.variables) == len(of.described.modelVariables)
        assert of.variables["parameter_dt"].unit == "1/s" and of.variables["input_int"].unit == "N"
        assert {"sample_status", "time_hat", "q_hat_hat", "state_PI"} - set(of.variables) == {
            "state_PI"
        }
        assert of.variables["parameter_PI"].description == "parameter PI"
        assert of.variables["sample_status"].causality == "input"
        assert of.variables["sample_status_2"].causality == "output"
        assert of.variables["time_2"].causality == "independent"
        of.start().step(0.01, y=0.4, sample_status=1.0, input_int=2.0)
        observer.correct(0.4)
        observer.predict([1.0, 2.0], 0.01)
        assert of.get("time_hat", "q_hat_hat") == observer.memory[:2].tolist()
        of.close()


def test_units_have_their_dimensions(tmp_path: Path) -> None:
    assert (
        dimension("N*m/rad")
        == dimension("kg.m2/s^2/rad")
        == dimension("J rad^-1".replace(" ", "*"))
    )
    volt = dimension("V")
    assert volt is not None and volt.attributes == {"kg": "1", "m": "2", "s": "-3", "A": "-1"}
    turn = dimension("rev/min")
    assert turn is not None and turn.factor == pytest.approx(2.0 * np.pi / 60.0, rel=1e-15)
    assert (
        dimension("furlong/s") is None and dimension("m/") is None and dimension("1/s") is not None
    )
    text = sources(axis(), to="fmu", units={"q": "furlong", "w": 'a"<b'})["modelDescription.xml"]
    found = {unit.get("name"): list(unit) for unit in ElementTree.fromstring(text).iter("Unit")}
    assert found["furlong"] == [] and found['a"<b'] == [] and len(found["s"]) == 1


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (
            {"to": "fmu", "units": {"speed": "m/s"}},
            "units = 'speed': must be .*of one of y, u, q, w",
        ),
        ({"to": "fmu", "units": {"q": 1}}, r"units\['q'\] = 1: must be a text"),
        ({"to": "fmu", "units": ["rad"]}, r"units = \['rad'\]: must be a dict"),
        ({"to": "fmu", "version": "1.0"}, "version = '1.0'"),
        ({"to": "c", "version": "2.0"}, "version = '2.0': only for to="),
        ({"to": "rust", "units": {}}, "units = {}: only for to="),
        ({"to": "fmi"}, "to = .*fmu"),
    ],
)
def test_what_is_refused(options: dict[str, Any], told: str) -> None:
    with pytest.raises(HgoError, match=told):
        sources(axis(), **options)


# --- the life of a unit ---------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_kept_reset_and_restored(tmp_path: Path, version: str) -> None:
    of = unit(tmp_path, axis(), version).start()

    def moved(first: int, last: int) -> list[list[float]]:
        rows = []
        for k in range(first, last):
            of.time = 0.01 * k
            of.step(0.01, y=float(np.sin(0.1 * k)) if k % 5 else np.nan, u=0.1 * k)
            rows.append(of.get("q_hat", "w_hat", "q_corrected", "elapsed"))
        return rows

    before = moved(0, 20)
    word = "FMUstate" if of.second else "FMUState"
    held = getattr(of.fmu, f"get{word}")()
    size = of.fmu.fmi2SerializedFMUstateSize if of.second else of.fmu.fmi3SerializedFMUStateSize
    text = (of.fmu.serializeFMUstate if of.second else of.fmu.serializeFMUState)(held)
    assert size is not None and len(text) > 0
    after = moved(20, 40)
    getattr(of.fmu, f"set{word}")(held)
    assert moved(20, 40) == after
    back = (of.fmu.deSerializeFMUstate if of.second else of.fmu.deserializeFMUState)(text)
    getattr(of.fmu, f"set{word}")(back)
    assert moved(20, 40) == after
    for state in (held, back):
        getattr(of.fmu, f"free{word}")(state)
    of.set(J=9.0)
    of.fmu.terminate()
    of.fmu.reset()
    of.start()
    assert of.get("q_hat", "J") == [0.0, 0.5]
    assert moved(0, 20) == before
    of.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_calls_out_of_order_are_refused(tmp_path: Path, version: str) -> None:
    of = unit(tmp_path, axis(), version)
    with pytest.raises(FMICallException):
        of.step(0.01)
    of.start()
    for dt in (0.0, -0.01, np.nan, np.inf):
        with pytest.raises(FMICallException):
            of.step(dt)
    for name in ("q_hat", "w_corrected", "elapsed", "time"):
        with pytest.raises(FMICallException):
            of.set(**{name: 1.0})
    for kind in ("Float64", "Int32", "Boolean"):
        with pytest.raises(FMICallException):
            of._of("get", kind)([99])
    with pytest.raises(FMICallException):
        of.fmu.enterInitializationMode()
    assert of.get("q_hat") == [0.0]
    of.close()
    if version == "3.0":
        assert "a variable that is computed, or that is set before the first step only" in of.said


def test_what_is_no_sample_of_this_observer_is_warned_of(tmp_path: Path) -> None:
    """A time without gains, and a model without a value: the estimate goes on from what it was."""
    low = hgo.LowPowerObserver(3, 20.0, method="zoh", timing="current")
    of = unit(tmp_path / "low", low, "3.0", dt=0.01, periods=2).start()
    for dt, expected in ((0.01, 0), (0.013, 0), (0.01, 3), (0.01, 0)):
        of.step(dt, y=0.2)
        assert of.status == expected
    assert of.said == ["the time since the last sample used is not one that gains are held for"]
    of.close()
    described = fmpy.read_model_description(str(tmp_path / "low" / "axis.fmu"))
    assert not described.coSimulation.canHandleVariableCommunicationStepSize
    assert float(described.defaultExperiment.stepSize) == 0.01
    model = hgo.Model(states=["q", "w"], inputs=["u"], phi="log(u)")
    of = unit(tmp_path / "log", hgo.StandardObserver(2, 5.0, model=model), "3.0").start()
    of.step(0.01, y=0.2, u=2.0)
    kept = of.get("w_hat")
    of.step(0.01, y=np.nan, u=-1.0)
    assert of.status == 2 and of.get("w_hat") == kept
    of.step(0.01, y=0.2, u=2.0)
    assert of.status == 0 and of.get("w_hat") != kept
    of.close()


def test_another_token_is_refused(tmp_path: Path) -> None:
    of = unit(tmp_path, axis(), "3.0")
    other = hgo.StandardObserver(2, 16.0, model=axis().model)
    one, two = (sources(o, to="fmu")["modelDescription.xml"] for o in (axis(), other))
    tokens = [ElementTree.fromstring(text).get("guid") for text in (one, two)]
    assert tokens[0] != tokens[1]
    first, of.fmu.guid = of.fmu.component, "{another}"
    with pytest.raises(Exception, match="Failed to instantiate"):
        of.fmu.instantiate(logMessage=of._heard)
    assert of.said == ["the token is of another modelDescription.xml, or no memory is left"]
    of.fmu.component = first
    of.start().close()


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("version", VERSIONS)
def test_sources_compile_without_warnings(tmp_path: Path, version: str, precision: str) -> None:
    for number, case in enumerate(("standard, zoh, current", "chains, zoh, predictor")):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            texts = sources(
                CASES[case](), to="fmu", name="axis", version=version, dt=DT, precision=precision
            )
        folder = put(tmp_path / str(number), texts) / "sources"
        flags = (*WARNINGS, "-Wcast-qual", "-ffp-contract=off", "-O1", "-c")
        for compiler in (("cc", "-std=c99"), ("g++", "-x", "c++", "-std=c++11")):
            run(*compiler, *flags, folder / "axis_fmu.c", "-o", folder / "unit.o")
        prefix = f"-DFMI{version[0]}_FUNCTION_PREFIX=axis_"
        run("cc", "-std=c99", *flags, prefix, folder / "axis_fmu.c", "-o", folder / "unit.o")
        assert f" T axis_fmi{version[0]}DoStep\n" in run("nm", folder / "unit.o")


PROGRAM = """\
#include "fmi2Functions.h"
#include <math.h>
#include <stdlib.h>

static void heard(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                  fmi2String category, fmi2String message, ...)
{
    (void)environment; (void)name; (void)status; (void)category; (void)message;
}

int main(void)
{
    const fmi2CallbackFunctions functions = {heard, calloc, free, NULL, NULL};
    const fmi2ValueReference given[] = {1, 2}, shown[] = {3, 4};
    fmi2FMUstate state = NULL;
    char bytes[4096];
    double first[2], second[2], values[2];
    size_t size;
    fmi2Component unit;
    int run, k;
    if (fmi2Instantiate("other", fmi2CoSimulation, "{other}", "", &functions, 0, 0)) return 1;
    unit = fmi2Instantiate("of some length", fmi2CoSimulation, "TOKEN", "", &functions, 0, 0);
    if (!unit || fmi2SetupExperiment(unit, 0, 0, 0, 0, 0)) return 2;
    if (fmi2EnterInitializationMode(unit) || fmi2ExitInitializationMode(unit)) return 3;
    if (fmi2GetFMUstate(unit, &state) || fmi2GetFMUstate(unit, &state)) return 4;
    fmi2SerializedFMUstateSize(unit, state, &size);
    if (size > sizeof bytes || fmi2SerializeFMUstate(unit, state, bytes, size)) return 5;
    if (!fmi2SerializeFMUstate(unit, state, bytes, size - 1)) return 6;
    fmi2FreeFMUstate(unit, &state);
    for (run = 0; run < 2; ++run) {
        for (k = 0; k < 50; ++k) {
            values[0] = k % 7 ? sin(0.1 * k) : NAN;
            values[1] = 0.1 * k;
            if (fmi2SetReal(unit, given, 2, values)) return 7;
            if (fmi2DoStep(unit, 0.01 * k, 0.01, fmi2True)) return 8;
        }
        fmi2GetReal(unit, shown, 2, run ? second : first);
        if (fmi2DeSerializeFMUstate(unit, bytes, size, &state)) return 9;
        if (fmi2SetFMUstate(unit, state)) return 10;
    }
    fmi2FreeFMUstate(unit, &state);
    fmi2FreeFMUstate(unit, &state);
    fmi2FreeInstance(unit);
    fmi2FreeInstance(NULL);
    return first[0] == second[0] && first[1] == second[1] && first[0] != 0.0 ? 0 : 11;
}
"""


def test_a_c_program_by_the_headers_of_the_standard(tmp_path: Path) -> None:
    """With sanitizers: no leak, no byte beside the unit's own."""
    headers = Path(fmpy.__file__).parent / "c-code"
    texts = sources(axis(), to="fmu", name="axis")
    token = str(ElementTree.fromstring(texts["modelDescription.xml"]).get("guid"))
    put(tmp_path, {**texts, "program.c": PROGRAM.replace("TOKEN", token)})
    parts = [tmp_path / "program.c", *(tmp_path / "sources").glob("*.c")]
    checked = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    include = (f"-I{headers}", f"-I{tmp_path / 'sources'}")
    run("gcc", *checked, *include, *parts, "-lm", "-o", tmp_path / "program")
    run(tmp_path / "program")


@pytest.mark.parametrize("version", VERSIONS)
def test_without_a_compiler_it_is_of_sources(
    tmp_path: Path, version: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -O3")
    told = r"no C compiler \(no-such-compiler\) is here: the FMU has sources only"
    with pytest.warns(UserWarning, match=told):
        (file,) = export(axis(), to="fmu", out=tmp_path / "p.fmu", name="axis", version=version)
    assert file == tmp_path / "p.fmu" and validate_fmu(str(file)) == []
    names = set(zipfile.ZipFile(file).namelist())
    build = {"sources/buildDescription.xml"} if version == "3.0" else set()
    code = {f"sources/axis{end}" for end in (".c", ".h", "_fmu.c")}
    assert names == {"modelDescription.xml", *code, *build}
    monkeypatch.setenv("CC", "false")
    with pytest.warns(UserWarning, match=r"the C compiler \(false\) failed: no message"):
        export(axis(), to="fmu", out=tmp_path, version=version)
    # the importing tool's part: FMPy builds it from what the description names
    from fmpy.build import build_platform_binary

    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")  # its cmake
    where = fmpy.extract(str(file), unzipdir=str(tmp_path / "built"))
    build_platform_binary(where)
    assert [path.name for path in (tmp_path / "built" / "binaries").glob("*/*")] == ["axis.so"]


def test_the_same_observer_gives_the_same_file(tmp_path: Path) -> None:
    files = [export(axis(), to="fmu", out=tmp_path / f"{i}", units=NAMES)[0] for i in range(2)]
    assert files[0].read_bytes() == files[1].read_bytes()
    inside = zipfile.ZipFile(files[0])
    assert inside.read("sources/observer.c").decode() == sources(axis(), to="c")["observer.c"]
    library = inside.read("binaries/linux64/observer.so")
    (tmp_path / "observer.so").write_bytes(library)
    shown = run("nm", "-D", "--defined-only", tmp_path / "observer.so").split("\n")
    assert all(" T fmi2" in line for line in shown if line)


def test_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    axis().save(tmp_path / "axis.toml")
    given = ["export", str(tmp_path / "axis.toml"), "--to", "fmu", "--out"]
    with pytest.raises(SystemExit) as ended:
        main(
            [*given, str(tmp_path), "--fmi-version", "3.0", "--unit", "w=rad/s", "--unit", "u=N*m"]
        )
    assert ended.value.code == 0 and capsys.readouterr().out.endswith(": axis.fmu\n")
    described = fmpy.read_model_description(str(tmp_path / "axis.fmu"))
    assert described.fmiVersion == "3.0"
    assert {v.name: v.unit for v in described.modelVariables}["w_hat"] == "rad/s"
    with pytest.raises(SystemExit) as ended:
        main([*given, str(tmp_path / "other.fmu")])
    assert ended.value.code == 0 and capsys.readouterr().out.endswith(": other.fmu\n")
    with pytest.raises(SystemExit) as ended:
        main([*given, str(tmp_path), "--unit", "w"])
    assert ended.value.code == 2 and "must be NAME=UNIT" in capsys.readouterr().err
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(SystemExit) as ended:
        main([*given, str(tmp_path)])
    assert ended.value.code == 0
    assert capsys.readouterr().err.startswith("hgo: no C compiler (no-such-compiler) is here: the")
