"""`observer.toml`: exact round trips; errors that name file, line and remedy."""

import inspect
import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hgo_rs
from hgo_rs import Config, ConfigError, HgoError
from hgo_rs.config import FORMAT, LOG, MODELS, OBSERVERS, START, TOP
from hgo_rs.config.configuration import maker

COMMON = """\
format = 1
observer = "low-power"
order = 3
gain = 160.0
method = "rk4-innovation-held"

[log]
time = "t_ms"  # milliseconds, by its name
output = "q"
"""


def refusal(text, build=True):
    with pytest.raises(ConfigError) as caught:
        config = Config.from_toml(text, "axis/observer.toml")
        if build:
            config.observer()
    message = str(caught.value)
    assert message.startswith("axis/observer.toml")
    assert "\n" not in message
    return message


def test_a_common_case_in_less_than_ten_lines(tmp_path):
    assert len(COMMON.splitlines()) < 10
    (tmp_path / "observer.toml").write_text(COMMON, encoding="utf-8")
    config = hgo_rs.load(tmp_path / "observer.toml")
    expected = hgo_rs.LowPowerObserver(3, gain=160.0, method="rk4-innovation-held")
    assert config.observer().spec == expected.spec
    assert config.log == {"time": "t_ms", "output": "q"}
    assert config.source == str(tmp_path / "observer.toml")


def observers():
    adaptive = hgo_rs.AdaptiveGain(2.0, 0.1, 0.2)
    triple = hgo_rs.RepelledCollection(adaptive, k=[2.0, 1.0], k_bar=[0.1, 0.3], copies=3)
    triple.reset(memory0=triple.spread([[0.0, 0.1], [0.2, 0.3], [0.4, 0.5]], [1.0, 2.0, 3.0]))
    ship = hgo_rs.Ship(0.1, (0.01, -0.02, 1e-300))
    yield hgo_rs.StandardObserver(1, gain=1 / 3)
    yield hgo_rs.StandardObserver(4, epsilon=0.1, poles=[-1, -2, -1 + 0.3j, -1 - 0.3j])
    yield hgo_rs.StandardObserver(2, gain=adaptive, model=hgo_rs.SanfelicePraly(0.1, 0.7))
    yield hgo_rs.StandardObserver(2, gain=hgo_rs.DeadZoneGain(2.0, 0.1, 0.2), method="rk4")
    yield hgo_rs.StandardObserver(3, gain=20.0, model=hgo_rs.InputGain(-0.1))
    yield hgo_rs.StandardObserver(2, gain=20.0, model=hgo_rs.VanDerPol(0.7), allow_unstable=True)
    yield hgo_rs.LowPowerObserver(2, gain=3.0, model=hgo_rs.Lee())
    yield hgo_rs.LowPowerObserver(3, gain=3.0, alpha=[3.0, 2.0, 1.0], beta=[3.0, 1.1])
    crackle = hgo_rs.Crackle(2.5)
    yield hgo_rs.PeakingFreeObserver(5, 9.0, saturation=3.0, clip="smooth", model=crackle)
    yield triple
    yield hgo_rs.ModifiedObserver(adaptive, k=[2.0, 1.0], k_bar=[0.1, 0.3], copies=2)
    yield hgo_rs.SampledDataObserver(hgo_rs.VanDerPol(0.5, 0.1, True), gain="printed")
    yield hgo_rs.ReducedOrderObserver(0.3, h_bar=[0.1, 0.2, 1 / 3], model=ship)


@pytest.mark.parametrize("observer", list(observers()), ids=lambda o: f"{type(o).__name__}-{o.n}")
def test_every_observer_comes_back_to_the_last_bit(observer, tmp_path):
    path = tmp_path / "observer.toml"
    observer.save(path, time="t", output=["a", "b"], input=None, dt=0.1 + 0.2)
    config = hgo_rs.load(path)
    back = config.observer()
    assert type(back) is type(observer)
    assert back.spec == observer.spec
    assert back.allow_unstable == observer.allow_unstable
    np.testing.assert_array_equal(back.memory, observer.memory)
    assert config.log == {"time": "t", "output": ["a", "b"], "dt": 0.1 + 0.2}
    # what was read is written as it was read
    assert Config.from_toml(config.to_toml()) == config
    assert config.to_toml() == path.read_text(encoding="utf-8")


def test_an_observer_under_way_is_saved_where_it_stands(tmp_path):
    observer = hgo_rs.StandardObserver(3, gain=20.0)
    for k in range(30):
        observer.step(np.sin(0.01 * k), dt=0.01)
    observer.save(tmp_path / "o.toml")
    back = hgo_rs.load(tmp_path / "o.toml").observer()
    for law in (observer, back):
        law.step(0.3, dt=0.01)
    np.testing.assert_array_equal(back.memory, observer.memory)


@settings(deadline=None)
@given(st.floats(min_value=5e-324, max_value=1e150), st.floats(allow_nan=False, width=64))
def test_numbers_come_back_to_the_last_bit(gain, x_hat):
    start = {"x_hat": [x_hat, -0.0]}
    data = {"format": FORMAT, "observer": "standard", "order": 2, "gain": gain, "start": start}
    back = Config.from_toml(Config(data).to_toml()).data
    assert back == data
    assert str(back["start"]["x_hat"]) == str(start["x_hat"])


@settings(deadline=None)
@given(st.text(), st.text())
def test_any_text_comes_back(name, other):
    data = {"format": FORMAT, "observer": "standard", "order": 2, "gain": 1.0}
    data["log"] = {"time": name, "output": [other, name]}
    try:
        text = Config(data).to_toml()
        text.encode()
    except UnicodeEncodeError:  # a surrogate is no text
        return
    assert Config.from_toml(text).data == data


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a" * 2**18 + " = 1", "has more than 262144 bytes"),
        ("format = 1\n" + ".".join("a" * 100_000) + " = 1", "line 2: a key of more than 16 parts"),
        ("format = 1\n[" + " . ".join(["a"] * 50_000) + "]", "line 2: a key of more than 16 parts"),
        ("x = " + "{a = " * 50_000, "nested too deeply"),
        ("x = " + "[" * 100_000, "nested too deeply"),
        ("x = [\n" + "1,\n" * 80_000 + "]", "line 1: a value of more than 300 lines"),
        ("\n".join(f"a.b{k} = 1" for k in range(20_000)), "line 1: a is not a known key"),
    ],
    ids=["long", "dotted", "dotted table", "tables", "lists", "lines", "keys"],
)
def test_a_text_of_any_size_is_refused_soon(tmp_path, text, message):
    text = text if len(text) <= 2**18 or "has more" in message else text[: 2**17] + " = 1"
    path = tmp_path / "o.toml"
    path.write_text(text)
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError) as caught:
            hgo_rs.load(path)
        assert tracemalloc.get_traced_memory()[1] < 2**26
    finally:
        tracemalloc.stop()
    assert message in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in the file system")
def test_what_may_have_no_end_is_refused(tmp_path):
    os.mkfifo(tmp_path / "o.toml")
    for path in (tmp_path / "o.toml", "/dev/zero"):
        with pytest.raises(ConfigError, match="is a pipe or a device"):
            hgo_rs.load(path)


def test_a_wrong_expression_is_shown_on_one_line():
    text = 'format = 1\nobserver = "standard"\ngain = 2.0\n[model]\nstates = ["q", "v"]\n'
    said = refusal(text + 'phi = "sin(q) + * v"\n')
    assert "line 6: phi: unexpected '*'" in said
    assert said.endswith(", in 'sin(q) + * v'")


HEAD = 'format = 1\nobserver = "standard"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": format is missing; begin the file with format = 1"),
        ("formt = 1", "line 1: formt is not a known key; nearest: format"),
        ('format = "1"', "line 1: format is text; write an integer"),
        ("# a\nformat = 7", "line 2: format = 7: the file is of format 7, hgo_rs "),
        ("format = 7\nnew_key = 1", f"reads format {FORMAT}; take the version of hgo_rs"),
        ("format = 1", "line 1: observer is missing; name one of standard, "),
        ("format = 1\nobserver = 'standrd'", "line 2: observer = 'standrd' is not known; nearest"),
        (HEAD + "gain = 2.0", "line 2: order is missing; add order = ..."),
        (HEAD + 'order = "3"', "line 3: order is text; write an integer"),
        (HEAD + "order = true", "line 3: order is a flag; write an integer"),
        (HEAD + "order = 3\ngain = [1]", "line 4: gain is a list of something else; write a num"),
        (HEAD + "order = 3\ngain = -1", "line 4: gain = -1: must be finite and > 0"),
        (HEAD + "order = 3\ngain = nan", "line 4: gain = nan: must be finite"),
        (HEAD + "order = 3", "gain: give either gain"),
        (HEAD + "order = 99\ngain = 1", "line 3: n = 99: must be an integer >= 1 and <= 12"),
        (
            HEAD + "order = 2\ngain = 1\ngains = 2",
            "line 5: gains is not a known key; nearest: gain",
        ),
        (HEAD + "order = 2\ngain = 1\nclip = 'hard'", "line 5: clip has no meaning for observer"),
        (
            HEAD + "order = 2\ngain = 1\npoles = [\n  -1,\n  # second\n  1,\n]\n",
            "line 5: poles = (1+0j): must be finite with a negative real part",
        ),
        (HEAD + "order = 2\ngain = 1\nmethod = 'eulr'", "line 5: method = 'eulr': must be one of"),
        (HEAD + "order = 2\ngain = { law = 'adaptiv' }", "line 4: gain.law = 'adaptiv' is not kno"),
        (HEAD + "order = 2\ngain = { p1 = 1 }", "line 4: gain.law is missing; name one of const"),
        (HEAD + "order = 2\ngain = { law = 'adaptive', p1 = 1 }", "line 4: gain.p2 is missing"),
        (HEAD + "order = 2\n[gain]\nlaw = 'constant'\nl = 1", "line 6: gain.l is not a known key"),
        (
            HEAD + "order = 2\ngain = 1\n\n[model]\nkind = 'lee'\nmu = 1",
            "line 8: model.mu is not a known key; known: kind",
        ),
        (HEAD + "gain = 1\nmodel.kind = 'input'", "line 4: model.b0 is missing; add b0 = ..."),
        (HEAD + "gain = 1\n[model]\nkind = 'inpt'", "model.kind = 'inpt' is not known; nearest: i"),
        (HEAD + "gain = 1\n[model]\n", "line 4: model.kind is missing; name one of unknown"),
        (
            HEAD + "gain = 1\n[model]\nkind = 'sanfelice-praly'\nnu1 = inf",
            "line 6: nu1 = inf: must be finite",
        ),
        (
            HEAD + "order = 3\ngain = 1\n[model]\nkind = 'lee'",
            "line 5: model = Lee(): must be of order 3; its order is 2",
        ),
        (HEAD + "order = 1\ngain = 1\n[start]\nr = 2.0", "line 6: r0 = 2.0: must be left out"),
        (HEAD + "order = 1\ngain = 1\n[start]\nx_hat = [1, 2]", "line 6: x_hat0 of shape (2,)"),
        (HEAD + "order = 1\ngain = 1\n[log]\ntme = 't'", "line 6: log.tme is not a known key; nea"),
        (
            HEAD + "order = 1\ngain = 1\n[log]\nclip = 't'",
            "line 6: log.clip is not a known key; it",
        ),
        (HEAD + "time = 't'", "line 3: time is not a known key; it belongs to [log]"),
        (
            HEAD + "order = 1\ngain = 1\n[[log]]\ntime = 't'",
            "line 5: log is a list of something else; write a table",
        ),
        (HEAD + "order = = 1", "line 3, column 9: not TOML: "),
        (HEAD + "order = 1\norder = 2", "line 4: not TOML: Cannot overwrite a value"),
        (HEAD + "log = " + "[" * 5000, "not TOML|nested"),
    ],
)
def test_refusals_name_line_and_remedy(text, message):
    said = refusal(text)
    assert any(part in said for part in message.split("|")), said


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "observer.toml").write_text(COMMON)
    with pytest.raises(ConfigError, match=r"no file .*obsrver\.toml; nearest: observer\.toml"):
        hgo_rs.load(tmp_path / "obsrver.toml")
    with pytest.raises(ConfigError, match="cannot read"):
        hgo_rs.load(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"format = 1 # \xe9")
    with pytest.raises(ConfigError, match=r"latin\.toml is not text in UTF-8: byte 13"):
        hgo_rs.load(tmp_path / "latin.toml")
    with pytest.raises(ConfigError, match="cannot write"):
        Config.from_toml(COMMON).save(tmp_path / "absent" / "o.toml")


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([*TOP, *LOG, *START, "kind", "nu1", "[model]", "[log]", "x"]),
            st.sampled_from(["1", "-1.5", '"t"', "[1, 2]", '["a"]', "true", "{ a = 1 }", "nan"]),
        ),
        max_size=6,
    )
)
def test_any_file_is_read_or_refused(lines):
    text = HEAD + "\n".join(k if k.startswith("[") else f"{k} = {v}" for k, v in lines)
    try:
        Config.from_toml(text, "o.toml").observer()
    except HgoError as error:
        assert str(error).startswith("o.toml")


def test_replacing_drops_what_it_stands_for():
    config = Config.from_toml(COMMON).replace({"output": "v"}, epsilon=0.1, poles=[-1, -2 + 1j])
    assert "gain" not in config.data
    assert config.data["poles"] == [-1, [-2.0, 1.0]]
    assert config.log == {"time": "t_ms", "output": "v"}
    with pytest.raises(ConfigError, match="order"):
        config.replace(order="x")


def test_schedule():
    text = HEAD + "order = 2\ngain = 5.0\n[log]\noutput = 'q'\n"
    schedule = "schedule = { alpha = 0.1, epsilon = 0.2, k0 = 50 }\n"
    law = Config.from_toml(text + schedule).log["schedule"]
    assert law == hgo_rs.StochasticApproximation(0.1, 0.2, 50)
    with pytest.raises(ConfigError, match=r"o\.toml, line 7: log\.schedule\.k0 is missing"):
        _ = Config.from_toml(text + "schedule = { alpha = 0.1, epsilon = 0.2 }\n", "o.toml").log


def test_the_tables_of_keys_are_those_of_the_classes():
    arguments = {"format", "observer", "model", "start", "log"}
    for kind in OBSERVERS:
        _, parameters = maker(kind)
        arguments |= {{"n": "order"}.get(key, key) for key in parameters}
    assert arguments <= set(TOP)
    for kind, (name, keys) in MODELS.items():
        if kind != "own":
            assert set(inspect.signature(getattr(hgo_rs, name)).parameters) == set(keys)


def test_own_model(tmp_path):
    text = HEAD + (
        "gain = 200.0\n[model]\n"
        'states = ["q", "v"]\ninputs = ["F"]\nparameters = { M = 95.1, Fv = 203.5 }\n'
        'phi = "(F - Fv*v)/M"\n'
    )
    config = Config.from_toml(text)
    law = config.observer()
    model = hgo_rs.Model(
        states=["q", "v"], inputs=["F"], parameters={"M": 95.1, "Fv": 203.5}, phi="(F - Fv*v)/M"
    )
    assert law.spec == hgo_rs.StandardObserver(2, gain=200.0, model=model).spec
    law.save(tmp_path / "o.toml")
    assert hgo_rs.load(tmp_path / "o.toml").observer().spec == law.spec


CHAINS = """\
format = 1
observer = "chains"

[[observers]]
observer = "standard"
order = 2
gain = 20.0

[[observers]]
observer = "low-power"
order = 2
gain = 15.0

[model]
states = ["a", "va", "b", "vb"]
orders = [2, 2]
phi = ["-a + 0.1*vb", "-sin(b)"]
"""


def test_several_chains(tmp_path):
    config = Config.from_toml(CHAINS)
    law = config.observer()
    model = hgo_rs.Model(
        states=["a", "va", "b", "vb"], orders=[2, 2], phi=["-a + 0.1*vb", "-sin(b)"]
    )
    first = hgo_rs.StandardObserver(2, gain=20.0)
    second = hgo_rs.LowPowerObserver(2, gain=15.0)
    assert law.spec == hgo_rs.MultiOutputObserver([first, second], model=model).spec
    law.save(tmp_path / "o.toml")
    assert hgo_rs.load(tmp_path / "o.toml").observer().spec == law.spec
    assert Config.from_toml(config.to_toml()) == config
    assert "line 12: gian is not a known key" in refusal(CHAINS.replace("gain = 15", "gian = 15"))
    assert "line 12: gain = -15.0: must be" in refusal(CHAINS.replace("15.0", "-15.0"))
    assert "line 6: order is text" in refusal(CHAINS.replace("order = 2", "order = 'x'", 1))
    assert "gain has no meaning" in refusal(CHAINS.replace("[[", "gain = 1\n\n[[", 1))


def test_the_time_of_steps_is_saved(tmp_path):
    """A model with t goes on at its time: x' = v, v' = t, so v is t^2/2 without any correction."""
    model = hgo_rs.Model(states=["q", "v"], phi="t")
    observer = hgo_rs.StandardObserver(2, gain=5.0, model=model, method="rk4", timing="predictor")
    for _ in range(20):
        observer.step(None, dt=0.1)
    observer.save(tmp_path / "o.toml")
    assert "[start]" in (tmp_path / "o.toml").read_text()
    config = hgo_rs.load(tmp_path / "o.toml")
    assert config.data["start"]["t"] == pytest.approx(2.0)
    back = config.observer()
    assert Config.of(back) == config
    for _ in range(10):
        np.testing.assert_array_equal(back.step(None, dt=0.1), observer.step(None, dt=0.1))
    np.testing.assert_allclose(back.x_hat[1], 3.0**2 / 2.0, rtol=1e-12)
    fresh = config.replace(start={"memory": config.data["start"]["memory"]}).observer()
    assert fresh.step(None, dt=0.1)[1] < back.x_hat[1]
    back.reset()
    assert back._time == 0.0


def test_a_missing_folder_and_a_folder_are_refused(tmp_path):
    config = Config({"format": 1, "observer": "standard", "order": 2, "gain": 20.0})
    for path in (tmp_path / "no" / "o.toml", tmp_path):
        with pytest.raises(ConfigError, match="cannot write"):
            config.save(path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("law", [{"method": "zoh"}, {"method": "rk4"}, {"timing": "predictor"}])
@pytest.mark.parametrize("samples", [0, 1, 2])
def test_a_file_of_an_observer_in_use_says_that_its_first_sample_is_taken(tmp_path, law, samples):
    """The first step of current timing takes no time: where it was taken is known to the file."""
    observer = hgo_rs.StandardObserver(2, 20.0, **law)
    for _ in range(samples):
        observer.step(0.7, dt=0.01)
    observer.save(tmp_path / "saved.toml")
    again = hgo_rs.load(tmp_path / "saved.toml").observer()
    for y in (0.71, 0.72):
        assert np.array_equal(again.step(y, dt=0.01), observer.step(y, dt=0.01))


def test_a_time_to_stand_at_is_not_negative():
    text = 'format = 1\nobserver = "standard"\norder = 2\ngain = 9.0\n[start]\nt = -1.0\n'
    with pytest.raises(ConfigError, match=r"line 6: t = -1.0: must be finite and >= 0"):
        Config.from_toml(text).observer()
