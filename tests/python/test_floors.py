"""The floors of the Python package: a module imports lower floors only, and there is no circle."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import hgo_rs

PACKAGE = Path(hgo_rs.__file__).parent

FLOORS = (
    "_core",
    "_version",
    "upward",
    "errors",
    "markup",
    "times",
    "signals",
    "files",
    "read_only",
    "laws",
    "llvm",
    "reference",
    "plots",
    "expressions",
    "models.papers",
    "models.own",
    "models",
    "design",
    "observers",
    "simulation",
    "simulation.studies",
    "config",
    "logs",
    "data",
    "exports",
    "tuning",
    "pages",
    "smoothing",
    "bench",
    "scenarios",
    "cli",
    "",
)
"""Every folder and every module beside them, from the lowest on; "" is `hgo_rs/__init__.py`."""

LATER = {"", "scenarios.base", "scenarios.katayama", "scenarios.astolfi", "scenarios", "errors"}
"""Who may load modules whose names are values: the head, the scenarios, and `errors.need`."""


def sources(folder):
    """Name, without "hgo_rs", and text of every module."""
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        yield ".".join(part for part in parts if part != "__init__"), path.read_text()


def imports(texts):
    """Module -> the modules of the package that it imports, anywhere in its text."""
    known = {*texts, "_core"}
    found = {}
    for name, text in texts.items():
        tree = ast.parse(text)
        mine = found[name] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                asked = [(alias.name, None) for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                parts = ["hgo_rs", *name.split(".")]
                is_folder = any(other.startswith(f"{name}.") for other in texts)
                parts = parts[: len(parts) + is_folder - node.level] if node.level else []
                parts += [node.module] if node.module else []
                asked = [(".".join(parts), alias.name) for alias in node.names]
            else:
                loads = isinstance(node, ast.Name | ast.Attribute)
                called = getattr(node, "id", getattr(node, "attr", "")) if loads else ""
                hidden = called in ("import_module", "__import__") and name not in LATER
                assert not hidden, f"hgo_rs.{name}: an import that is a value cannot be seen"
                continue
            for module, member in asked:
                top, _, inner = module.partition(".")
                if top != "hgo_rs":
                    continue
                whole = f"{inner}.{member}".strip(".")
                mine.add(whole if member and whole in known else inner)
    return found


def floor(module, floors):
    """The floor of a module: that of its innermost folder which has one."""
    parts = module.split(".") if module else []
    for length in range(len(parts), 0, -1):
        if ".".join(parts[:length]) in floors:
            return floors.index(".".join(parts[:length]))
    assert not module, f"hgo_rs.{module} has no floor: give its folder one in test_floors.py"
    return floors.index("")


def faults(found, floors):
    """What is wrong with the imports, in words."""
    for module, others in found.items():
        for other in others:
            if floor(other, floors) > floor(module, floors):
                yield f"hgo_rs.{module} imports hgo_rs.{other}, which is a floor above it"
    try:
        TopologicalSorter(found).prepare()
    except CycleError as error:
        circle = " -> ".join(f"hgo_rs.{module}" for module in error.args[1][::-1])
        yield f"a circle of imports: {circle}"


def test_modules_import_lower_floors_only():
    said = "\n".join(faults(imports(dict(sources(PACKAGE))), FLOORS))
    assert not said, said


def test_every_floor_is_there():
    names = {name for name, _ in sources(PACKAGE)} | {"_core"}
    assert set(FLOORS) <= names


@pytest.mark.parametrize(
    ("low", "text", "told"),
    [
        ("low.a", "from hgo_rs.high import b", "hgo_rs.low.a imports hgo_rs.high.b"),
        ("low.a", "def f():\n    import hgo_rs.high.b", "hgo_rs.low.a imports hgo_rs.high.b"),
        ("low.a", "if TYPE_CHECKING:\n    from hgo_rs.high.b import X", "imports hgo_rs.high.b"),
        ("low.a", "from hgo_rs import X", "hgo_rs.low.a imports hgo_rs., which is a floor above"),
        (
            "high.c",
            "from hgo_rs.high.b import X",
            "hgo_rs.high.b -> hgo_rs.high.c -> hgo_rs.high.b",
        ),
        ("low.a", "import_module('hgo_rs.high')", "an import that is a value"),
        ("other", "", "hgo_rs.other has no floor"),
    ],
)
def test_a_wrong_import_is_named(low, text, told):
    house = {"": "", "high.b": "from hgo_rs.low import a\nfrom hgo_rs.high.c import Y"}
    house |= {"low.a": "", "high.c": "", "low": "", "high": "", low: text}
    house["user"] = f"import hgo_rs.{low}"
    try:
        said = list(faults(imports(house), ("low", "high", "user", "")))
    except AssertionError as error:
        said = [str(error)]
    assert any(told in line for line in said), said


def test_what_floors_above_do_is_registered():
    """Every name that `upward.call` is given has a function that is there."""
    from hgo_rs import upward

    called = set()
    for name, text in sources(PACKAGE):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "upward.call":
                assert isinstance(node.args[0], ast.Constant), name
                called.add(node.args[0].value)
    import hgo_rs.expressions  # noqa: F401  (which registers for itself)

    assert called == set(upward._registered)
