"""The JSON Schema of an `observer.toml` against the reader of the file, by another validator."""

import json
import re
import warnings
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_config import COMMON, observers

import hgo_rs
from hgo_rs import Config, ConfigError
from hgo_rs.config import FORMAT, OBSERVERS, SchemaWarning, keys, schema
from hgo_rs.config.text import parsed

jsonschema = pytest.importorskip("jsonschema")

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs" / f"observer-{FORMAT}.schema.json"
SCHEMA = json.loads(FILE.read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft7Validator(SCHEMA)
TOML = re.compile(r"^```toml\n(.*?)^```$", re.M | re.S)


def faults(data):
    return [error.message for error in VALIDATOR.iter_errors(data)]


def test_the_file_is_that_of_this_version():
    assert FILE.read_text(encoding="utf-8") == schema.text(), "hgo list schema > docs/..."
    jsonschema.Draft7Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("observer", list(observers()), ids=lambda o: f"{type(o).__name__}-{o.n}")
def test_every_file_that_is_written_validates(observer):
    log = {"time": ["a", "b"], "output": "q", "unit": ["s", "ms"], "scale": {"q": 2.0}}
    assert not faults(json.loads(json.dumps(dict(Config.of(observer, **log).data))))


def test_every_file_of_the_documentation_validates():
    found = 0
    for page in sorted((ROOT / "docs").glob("*.md")):
        for text in TOML.findall(page.read_text(encoding="utf-8")):
            if "format = 1" in text:
                found += 1
                assert not faults(parsed(text, page.name)[0]), page
    assert found and not faults(parsed(COMMON, "")[0])


OWN = 'format = 1\nobserver = "standard"\ngain = 2.0\n[model]\nstates = ["q"]\nphi = "-q"\n'
CHAINS = (
    'format = 1\nobserver = "chains"\n[[observers]]\nobserver = "standard"\norder = 1\ngain = 2.0\n'
    '[[observers]]\nobserver = "standard"\norder = 1\ngain = 2.0\n'
)


@pytest.mark.parametrize(
    ("text", "old", "new"),
    [
        (COMMON, "gain =", "gian ="),
        (COMMON, "format = 1", "format = 2"),
        (COMMON, "format = 1\n", ""),
        (COMMON, 'observer = "low-power"\n', ""),
        (COMMON, '"low-power"', '"low-pover"'),
        (COMMON, "order = 3", 'order = "3"'),
        (COMMON, "order = 3", "order = 3.5"),
        (COMMON, "gain = 160.0", "gain = true"),
        (COMMON, "gain = 160.0", 'gain = { law = "adaptive", p1 = 1.0, p2 = 1.0 }'),
        (COMMON, "gain = 160.0", 'gain = { law = "constant", ell = 1.0, p1 = 1.0 }'),
        (COMMON, "gain = 160.0", 'gain = { law = "nonsense" }'),
        (COMMON, "order = 3", "order = 3\nshape = { decay = 1.0 }"),
        (COMMON, "order = 3", "order = 3\nsaturation = 1.0"),
        (COMMON, "order = 3", "order = 3\npoles = [[-1.0, 1.0, 2.0]]"),
        (COMMON, 'output = "q"', "output = 1"),
        (COMMON, 'output = "q"', 'output = "q"\nouput = "q"'),
        (COMMON, 'output = "q"', 'output = "q"\nschedule = { alfa = 1.0 }'),
        (COMMON, "[log]", '[start]\nfrom = "zero"\nx_hat = [1.0]\n[log]'),
        (COMMON, "[log]", '[start]\nfrom = "here"\n[log]'),
        (OWN, 'phi = "-q"', 'fi = "-q"'),
        (OWN, 'states = ["q"]', "states = []"),
        (OWN, '[model]\nstates = ["q"]\nphi = "-q"\n', "[model]\n"),
        (OWN, "[model]", '[model]\nkind = "lee"'),
        (CHAINS, "order = 1", "odrer = 1"),
        (CHAINS, 'observer = "standard"', 'observer = "standart"'),
    ],
)
def test_what_is_refused_is_invalid(text, old, new):
    """By the schema as by the reader; the text itself is neither."""
    good, wrong = parsed(text, "")[0], parsed(text.replace(old, new, 1), "")[0]
    Config(good)
    assert not faults(good)
    with pytest.raises(ConfigError):
        Config(wrong)
    assert faults(wrong)


def test_a_choice_that_there_is_not_is_invalid_where_the_class_refuses_it():
    for key in ("method", "timing", "motion"):
        text = COMMON.replace('method = "rk4-innovation-held"', f'{key} = "nonsense"')
        with pytest.raises(ConfigError, match=key):
            Config.from_toml(text).observer()
        assert faults(parsed(text, "")[0])


scalars = st.one_of(
    st.booleans(),
    st.integers(-3, 3),
    st.floats(-2.0, 2.0).filter(lambda v: v != int(v)),  # JSON has one kind of number
    st.text("ab", max_size=2),
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("ab", max_size=2), inner),
    max_leaves=5,
)
KINDS = {name: kind for name, kind in vars(keys).items() if isinstance(kind, keys.Kind)}
CHOSEN = {"_UNIT", "UNIT", "GAIN"}
"""Kinds whose schemas know the choices."""


@settings(deadline=None, max_examples=300)
@given(values)
def test_each_kind_is_what_its_schema_says(value):
    for name, kind in KINDS.items():
        told = jsonschema.Draft7Validator(kind.schema).is_valid(value)
        same = told == kind.holds(value)
        assert same or (name in CHOSEN and kind.holds(value) and not told), (name, value)


@settings(deadline=None, max_examples=200)
@given(
    st.sampled_from(list(OBSERVERS)),
    st.dictionaries(st.sampled_from([k for k in keys.TOP if k != "format"]), values, max_size=2),
)
def test_what_validates_is_read(observer, extra):
    """And what is read validates, but for choices, which the classes look at."""
    data = {"format": FORMAT, "observer": observer, **extra}
    try:
        Config(data)
    except ConfigError:
        assert faults(data)
    else:
        choices = ("is not one of", "is not valid under any")
        assert all(any(told in fault for told in choices) for fault in faults(data))


def test_a_schema_of_another_version_is_told(tmp_path):
    path = tmp_path / "o.toml"
    path.write_text(f"#:schema observer-{FORMAT}.schema.json\n{COMMON}")
    near = tmp_path / FILE.name
    near.write_text(FILE.read_text())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert hgo_rs.load(path).data["order"] == 3
    near.write_text(near.read_text().replace(hgo_rs.__version__, "0.0.9"))
    with pytest.warns(SchemaWarning, match=r"o\.toml, line 1: the schema .* of hgo_rs 0\.0\.9"):
        hgo_rs.load(path)
    path.write_text(f"# mine\n#:schema https://x.org/observer-9.schema.json\n{COMMON}")
    with pytest.raises(ConfigError, match=r"o\.toml, line 2: .* is of format 9.*`hgo list schema`"):
        hgo_rs.load(path)
    for other in ("mine.json", "https://x.org/other.json"):
        path.write_text(f"#:schema {other}\n{COMMON}")
        hgo_rs.load(path)
