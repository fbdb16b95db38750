"""Expressions: grammar, printer, table, derivative and bounds, each against something independent.

Python's own parser reads the printed text (operator by operator, so that every rounding is known),
mpmath differentiates in 40 digits, and samples must lie within the interval bounds.
"""

import ast
import math
import operator
import pickle
import time

import mpmath
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from hgo_rs import HgoError
from hgo_rs.expressions import (
    FUNCTIONS,
    ExpressionError,
    UntraceableError,
    bounds,
    compile_table,
    derivative,
    evaluate,
    from_sympy,
    jumps,
    latex,
    nodes,
    parse,
    symbols,
    text,
)
from hgo_rs.expressions.grammar import MAX_LENGTH
from hgo_rs.expressions.library import SUBSTITUTES
from hgo_rs.expressions.tracing import Symbolic, as_node, symbolic_vector
from hgo_rs.reference.table import Table

NAMES = ("x", "y", "z")
X, Y, Z = map(nodes.symbol, NAMES)
quick = settings(
    max_examples=120, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)

# --- random expressions ---------------------------------------------------------------------------

ONE = ("neg", "sin", "cos", "tan", "atan", "exp", "log", "sqrt", "tanh", "abs", "sign")
TWO = ("add", "sub", "mul", "div", "atan2", "min", "max")
THREE = ("power", "root", "pow", "lt", "le", "eq", "and", "or", "not", "select", "select")
EXPONENTS = (-4, -1, 2, 3, 5)
ROOTS = (0.5, 1.5, -0.25)

numbers = st.floats(-5.0, 5.0, allow_subnormal=False) | st.integers(-4, 4).map(float)
steps = st.tuples(st.sampled_from((*ONE, *TWO, *THREE)), *[st.integers(0, 30)] * 3)


def grown(constants, program):
    """An expression: each step applies an operation to what the steps before have made."""
    made = [X, Y, Z, *map(nodes.constant, constants)]
    conditions = [nodes.compare("lt", X, Y)]
    for op, i, j, k in program:
        a, b, c = (made[-1 - i % len(made)] for i in (i, j, k))
        p, q = (conditions[-1 - i % len(conditions)] for i in (i, j))
        if op in ONE:
            made.append(nodes.function(op, a))
        elif op in TWO:
            made.append(a if op == "div" and b.number == 0.0 else nodes.function(op, a, b))
        elif op in ("lt", "le", "eq"):
            conditions.append(nodes.compare(op, a, b))
        elif op in ("and", "or", "not"):
            make = {"and": nodes.both, "or": nodes.either, "not": lambda p, _: nodes.no(p)}[op]
            conditions.append(make(p, q))
        elif op == "select":
            made.append(nodes.select(p, b, c))
        else:
            exponents = {"power": EXPONENTS, "root": ROOTS}.get(op)
            e = nodes.constant(exponents[j % len(exponents)]) if exponents else b
            integer = e.number.is_integer() and abs(e.number) > 5
            made.append(a if integer else nodes.power(a, e))
    return made[-1]


expressions = st.builds(grown, st.lists(numbers, max_size=3), st.lists(steps, max_size=9))
points = st.tuples(*[st.floats(-3.0, 3.0, allow_subnormal=False)] * 3)


# --- evaluation by Python's own parser ------------------------------------------------------------


def _pow(x, p):
    return np.nan if x < 0.0 else np.power(x, p)


CALLS = {
    "abs": np.abs,
    "sign": lambda x: np.float64(0.0) if x == 0.0 else np.sign(x),
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "atan": np.arctan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "tanh": np.tanh,
    "atan2": np.arctan2,
    "min": lambda a, b: b if b < a else a,
    "max": lambda a, b: b if b > a else a,
}
BINARY = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}
COMPARE = {ast.Lt: operator.lt, ast.LtE: operator.le, ast.Eq: operator.eq}


def by_python(tree, values):
    """The value of a Python syntax tree, one IEEE operation at a time."""

    def of(part):
        return by_python(part, values)

    match tree:
        case ast.Expression():
            return of(tree.body)
        case ast.Constant():
            return np.float64(tree.value)
        case ast.Name():
            return np.float64(math.pi if tree.id == "pi" else values[tree.id])
        case ast.UnaryOp(op=ast.USub()):
            return -of(tree.operand)
        case ast.UnaryOp(op=ast.Not()):
            return not of(tree.operand)
        case ast.BoolOp():
            parts = [of(part) for part in tree.values]
            return all(parts) if isinstance(tree.op, ast.And) else any(parts)
        case ast.Compare():
            return COMPARE[type(tree.ops[0])](of(tree.left), of(tree.comparators[0]))
        case ast.BinOp(op=ast.Div()):
            return np.divide(of(tree.left), of(tree.right))
        case ast.BinOp(op=ast.Pow()):
            return _power(of(tree.left), tree.right, of)
        case ast.BinOp():
            return BINARY[type(tree.op)](of(tree.left), of(tree.right))
        case ast.Call(func=ast.Name(id="piecewise")):
            *pairs, default = tree.args
            for value, condition in zip(pairs[::2], pairs[1::2], strict=True):
                if of(condition):
                    return of(value)
            return of(default)
        case ast.Call():
            return CALLS[tree.func.id](*map(of, tree.args))
    raise AssertionError(ast.dump(tree))


def _power(base, exponent, of):
    p = of(exponent)
    constant = all(not isinstance(n, ast.Name | ast.Call) for n in ast.walk(exponent))
    if not constant or not float(p).is_integer():
        return _pow(base, p)
    product = base
    for _ in range(abs(int(p)) - 1):
        product = product * base
    return product if p > 0 else np.float64(1.0) / product


@quick
@given(expressions)
def test_the_printed_text_is_read_back_as_the_same_expression(node):
    assert parse(text(node), NAMES) is node
    assert pickle.loads(pickle.dumps(node)) is node
    assert latex(node)


@quick
@given(expressions, points)
def test_numpy_and_the_table_give_the_bits_of_the_written_order(node, point):
    values = dict(zip(NAMES, point, strict=True))
    tree = ast.parse(text(node), mode="eval")
    with np.errstate(all="ignore"):
        want = np.float64(by_python(tree, values))
        table = Table(compile_table([node], {n: n for n in NAMES}, ["f"]), "table")
        (by_table,) = table(point)
    (by_numpy,) = evaluate([node], values)
    np.testing.assert_array_equal(by_numpy, want)
    np.testing.assert_array_equal(by_table, want)
    np.testing.assert_array_equal(np.signbit(by_table), np.signbit(by_numpy))


@quick
@given(st.lists(expressions, min_size=1, max_size=3))
def test_a_table_computes_each_thing_once_and_from_what_stands_before(roots):
    table = compile_table(
        roots, {"x": "x[0]", "y": "x[1]", "z": "M"}, list("abc"[: len(roots)]), "z"
    )
    base = len(table["inputs"]) + len(table["constants"])
    assert len({tuple(op) for op in table["ops"]}) == len(table["ops"])
    assert len({c.hex() for c in table["constants"]}) == len(table["constants"])
    used = set(table["outputs"])
    late = False
    still = {2, *range(3, base)}
    for i, (_, *operands) in enumerate(table["ops"]):
        assert all(0 <= r < base + i for r in operands)
        used |= set(operands)
        moves = not set(operands) <= still
        still |= set() if moves else {base + i}
        assert not (late and not moves), "parameters only, but not first"
        late |= moves
    assert used >= set(range(3, base + len(table["ops"])))


# --- derivative -----------------------------------------------------------------------------------


MP = {
    "neg": operator.neg,
    "abs": abs,
    "sign": mpmath.sign,
    "sqrt": mpmath.sqrt,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "tan": mpmath.tan,
    "atan": mpmath.atan,
    "exp": mpmath.exp,
    "log": mpmath.log,
    "tanh": mpmath.tanh,
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "min": min,
    "max": max,
    "pow": operator.pow,
    "atan2": mpmath.atan2,
    "lt": operator.lt,
    "le": operator.le,
    "eq": operator.eq,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": operator.not_,
    "select": lambda c, a, b: a if c else b,
}


class NoValue(Exception):
    """Where an expression has no real value, or too large a one."""


def by_mpmath(root, values):
    """The value in mpmath's precision."""
    known = {}
    for node in nodes.order([root]):
        args = [known[arg] for arg in node.args]
        if node.op == "symbol":
            known[node] = values[node.value]
        elif node.op == "constant":
            known[node] = mpmath.mpf(node.value)
        else:
            try:
                with_power = [*args, node.value] if node.op == "power" else args
                value = MP.get(node.op, operator.pow)(*with_power)
            except (ZeroDivisionError, OverflowError, ValueError):
                raise NoValue from None
            if isinstance(value, mpmath.mpc) or (not isinstance(value, bool) and abs(value) > 1e8):
                raise NoValue
            known[node] = value
    return known[root]


@quick
@given(expressions, points)
def test_the_derivative_is_the_one_of_mpmath(node, point):
    slope = derivative(node, "x")
    with mpmath.workdps(40):
        y, z = (mpmath.mpf(v) for v in point[1:])

        def value(root, at):
            return by_mpmath(root, {"x": at, "y": y, "z": z})

        x, h = mpmath.mpf(point[0]), mpmath.mpf("1e-12")
        try:
            have = value(slope, x)
            sides = [value(node, x + i * h) for i in (-2, -1, 1, 2)]
            centre = value(node, x)
        except NoValue:
            assume(False)
        left = (3 * centre - 4 * sides[1] + sides[0]) / (2 * h)
        right = (-3 * centre + 4 * sides[2] - sides[3]) / (2 * h)
        scale = 1 + abs(have) + abs(centre)
        # not near a kink, a jump or a pole
        assume(abs(sides[3] - sides[0]) < mpmath.mpf("1e-6"))
        assume(abs(left - right) < mpmath.mpf("1e-6") * scale)
        assert abs((left + right) / 2 - have) < mpmath.mpf("1e-5") * scale


@pytest.mark.parametrize(
    ("written", "point", "slope"),
    [
        ("abs(x)", 0.0, 1.0),
        ("abs(x)", -0.5, -1.0),
        ("min(2*x, x)", 0.0, 2.0),
        ("max(2*x, x)", 0.0, 2.0),
        ("saturate(x, -1, 1)", 1.0, 1.0),
        ("saturate(x, -1, 1)", 1.5, 0.0),
        ("piecewise(x, x < 0, 3*x)", 0.0, 3.0),
        ("sign(x)", 0.0, 0.0),
        ("x**0 + x**1", 2.0, 1.0),
        ("x**y", 2.0, 12.0),
    ],
)
def test_kinks_take_the_slope_of_the_branch_of_the_value(written, point, slope):
    node = derivative(parse(written), "x")
    assert evaluate([node], {"x": point, "y": 3.0})[0] == slope


def test_a_derivative_is_simplified():
    assert text(derivative(parse("a*x + b*y"), "x")) == "a"
    assert text(derivative(parse("x**2"), "x")) == "2*x"
    assert derivative(parse("sin(y)"), "x").number == 0.0


# --- bounds ---------------------------------------------------------------------------------------

ends = st.floats(-4.0, 4.0, allow_subnormal=False).map(lambda end: end + 0.0)
boxes = st.tuples(*[st.tuples(ends, ends).map(sorted)] * 3)


@quick
@given(expressions, boxes, st.integers(0, 2**32 - 1))
def test_bounds_contain_every_sample(node, box, seed):
    (pair,) = bounds([node], dict(zip(NAMES, box, strict=True)))
    rng = np.random.default_rng(seed)
    values = {n: rng.uniform(*b, 200).clip(*b) for n, b in zip(NAMES, box, strict=True)}
    for name, (low, high) in zip(NAMES, box, strict=True):
        values[name][:2] = low, high
    (found,) = evaluate([node], values)
    found = found[~np.isnan(found)]
    assert np.all((pair[0] <= found) & (found <= pair[1])), (text(node), pair, found)


@pytest.mark.parametrize(
    ("written", "box", "want"),
    [
        ("x*x", (-1, 2), (0, 4)),
        ("x**2 - 1", (-1, 2), (-1, 3)),
        ("sin(x)", (1, 2), (math.sin(1), 1)),
        ("sin(x)", (0, 7), (-1, 1)),
        ("cos(x)", (3, 3.5), (-1, math.cos(3.5))),
        ("1/x", (1, 2), (0.5, 1)),
        ("1/x", (-1, 2), (-math.inf, math.inf)),
        ("tan(x)", (1, 2), (-math.inf, math.inf)),
        ("exp(x)", (0, 1), (1, math.e)),
        ("sqrt(x)", (0, 4), (0, 2)),
        ("sqrt(x*x + abs(x))", (-1, 1), (0, math.sqrt(2))),
        ("sqrt(x)", (-1, 4), (-math.inf, math.inf)),
        ("min(1, log(x))", (-2, 0.5), (-math.inf, 1)),
        ("x**1.5", (-1, 4), (-math.inf, math.inf)),
        ("log(x)", (0, 1), (-math.inf, 0)),
        ("log(x)", (-2, -1), (-math.inf, math.inf)),
        ("piecewise(2, x < 0, 5)", (-1, -0.5), (2, 2)),
        ("piecewise(2, x < 0, 5)", (-1, 1), (2, 5)),
        ("atan2(1, x)", (-1, 1), (math.pi / 4, 3 * math.pi / 4)),
        ("atan2(x, -1)", (-1, 1), (-math.pi, math.pi)),
        ("abs(x)", (-3, 2), (0, 3)),
    ],
)
def test_bounds_are_tight(written, box, want):
    (pair,) = bounds([parse(written)], {"x": box})
    np.testing.assert_allclose(pair, want, rtol=1e-14, atol=1e-14)
    assert pair[0] <= want[0]
    assert pair[1] >= want[1]


def test_bounds_of_many_boxes_at_once():
    low, high = np.array([0.0, 1.0]), np.array([1.0, 3.0])
    (pair,) = bounds([parse("x**2")], {"x": (low, high)})
    np.testing.assert_allclose(pair, ([0, 1], [1, 9]), atol=1e-14)
    with pytest.raises(ExpressionError, match="low <= high"):
        bounds([X], {"x": (1.0, 0.0)})
    with pytest.raises(ExpressionError, match="x has no bounds"):
        bounds([X], {"y": (0.0, 1.0)})


@pytest.mark.parametrize(
    ("written", "count"),
    [
        ("sign(x)", 1),
        ("sign(x + 10)", 0),
        ("piecewise(-1, x < -1, 1, x > 1, x)", 0),
        ("piecewise(0, x < 0, x + 1)", 1),
        ("piecewise(x, x < y, y)", 0),
        ("piecewise(x, x < y, 2*y)", 1),
        ("piecewise(0, x < 0 or y < 0, x*y)", 0),
        ("piecewise(0, x*y < 1, x)", 1),
        ("saturate(x, -1, 1) + abs(x) + min(x, y)", 0),
        ("atan2(x, y)", 1),
        ("atan2(x, y + 10)", 0),
        ("sign(y) + piecewise(x, y < 0, 2*x)", 0),
        ("piecewise(1, 1/x < 0, 2)", 1),
        ("piecewise(1/x, x < y, 1/y)", 0),
    ],
)
def test_jumps_are_found(written, count):
    box = {"x": (-2.0, 2.0), "y": (-2.0, 2.0)}
    assert len(jumps([parse(written)], box, ["x"])) == count


# --- the grammar ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "values", "want"),
    [
        ("-x**2", {"x": 3.0}, -9.0),
        ("2**-1", {}, 0.5),
        ("2**3**2", {}, 512.0),
        ("10 - 4 - 3", {}, 3.0),
        ("12/3/2", {}, 2.0),
        ("-2*-3", {}, 6.0),
        ("+1.5e-3 + .5", {}, 0.5015),
        ("pow(x, 3)", {"x": -2.0}, -8.0),
        ("pow(x, 0.5)", {"x": 4.0}, 2.0),
        ("pow(x, 0.5)", {"x": -4.0}, math.nan),
        ("min(3, 1, 2) + max(3, 1, 2)", {}, 4.0),
        ("piecewise(1, 0 < x < 2, 2, not x == 5 and x != 6, 3)", {"x": 1.0}, 1.0),
        ("piecewise(1, 0 < x < 2, 2, not x == 5 and x != 6, 3)", {"x": 4.0}, 2.0),
        ("piecewise(1, 0 < x < 2, 2, not x == 5 and x != 6, 3)", {"x": 5.0}, 3.0),
        ("piecewise(1, x >= 2 or x <= -2, 0)", {"x": -2.0}, 1.0),
        ("sin(pi/2)", {}, 1.0),
        ("saturate(x, -1, 1)", {"x": 7.0}, 1.0),
        ("sign(x)", {"x": -0.0}, 0.0),
        ("order + android", {"order": 1.0, "android": 2.0}, 3.0),
        (" ( x )\n*\t2 ", {"x": 1.0}, 2.0),
    ],
)
def test_what_is_written_is_what_is_meant(written, values, want):
    np.testing.assert_array_equal(evaluate([parse(written)], values)[0], want)


_OF_NUMPY = {"asin": "arcsin", "acos": "arccos", "atanh": "arctanh", "sat": "clip", "clamp": "clip"}


@pytest.mark.parametrize("name", SUBSTITUTES)
def test_what_is_offered_for_a_function_is_that_function(name):
    """By NumPy's function of the name."""
    twin = getattr(np, _OF_NUMPY.get(name, name))
    levels = {"low": 0.2, "high": 0.6} if "saturate" in SUBSTITUTES[name] else {}
    x = np.array([0.1, 0.4, 0.9] if "log" in name else [-0.9, 0.1, 0.4, 0.9])
    got = evaluate([parse(SUBSTITUTES[name])], {"x": x, **levels})[0]
    np.testing.assert_allclose(got, twin(x, *levels.values()), rtol=1e-14)
    with pytest.raises(ExpressionError, match=f"unknown function {name}.*write "):
        parse(f"{name}(x)")


def test_nan_goes_the_ways_that_are_documented():
    nan = {"x": math.nan, "y": 1.0}
    for written in ("min(x, y)", "sign(x)", "saturate(x, 0, 1)", "pow(x, 0.5)"):
        assert math.isnan(evaluate([parse(written)], nan)[0]), written
    assert evaluate([parse("min(y, x)")], nan)[0] == 1.0


WRONG = {
    "a + + * b": ("unexpected '*'", 6),
    "a^2": (r"write \*\* for a power", 1),
    "2x": ("an operator is missing", 1),
    "x y": ("an operator is missing", 2),
    "x(1)": ("x is not a function", 0),
    "(x": ("a parenthesis is open", 2),
    "x + 1)": ("closed that was not open", 5),
    "x +": ("ends early", 3),
    "x // y": ("no integer division", 3),
    "x % y": ("no remainder", 2),
    "x.real": ("no attributes", 1),
    "x[0]": ("the state's name", 1),
    "'x'": ("no strings", 0),
    "x = 1": ("right-hand side only", 2),
    "λ + 1": ("in ASCII", 0),
    "x\u00a0+ 1": ("in ASCII", 1),
    "ｘ": ("in ASCII", 0),
    "sinn(x)": ("did you mean sin", 0),
    "1 + asin(x)": (r"write atan2\(x, sqrt\(1 - x\*\*2\)\)", 4),
    "clip(x, 0, 1)": (r"write saturate\(x, low, high\)", 0),
    "frobnicate(x)": ("choose one of them", 0),
    "1 + Vel": ("did you mean vel", 4),
    "__class__": ("unknown name __class__", 0),
    "__import__(x)": ("unknown function __import__", 0),
    "e": (r"write exp\(1\)", 0),
    "sin": (r"sin is a function.*write sin\(x\)", 0),
    "1 + sin()": (r"0 arguments given: must be 1; write sin\(x\)", 4),
    "atan2(x)": (r"1 argument given: must be 2; write atan2\(y, x\)", 0),
    "piecewise(1, x < 0)": ("must be at least 3", 0),
    "piecewise(1, x < 0, 2, 3)": ("must be pairs", 0),
    "piecewise(1, x, 2)": ("a number stands where a condition is needed", 13),
    "x < 1": ("a condition stands where a number is needed", 0),
    "sin(x < 1)": ("a condition stands where a number is needed", 4),
    "x and y": ("a number stands where a condition is needed", 0),
    "1/0": ("division by zero", 1),
    "x/0.0": ("division by zero", 1),
    "1 + 1e999": ("too large", 4),
    "x**65": ("within \\+-64", 1),
    "lambda": ("unknown name lambda", 0),
    "x if y else y": ("operator is missing", 2),
    "x; y": ("one expression", 1),
    "x, y": ("unexpected comma", 1),
}


@pytest.mark.parametrize("written", WRONG)
def test_errors_say_what_and_where(written):
    says, at = WRONG[written]
    with pytest.raises(ExpressionError, match=says) as caught:
        parse(written, ["x", "y", "vel"])
    assert caught.value.position == at
    *_, line, mark = str(caught.value).split("\n")
    assert mark == " " * (at + 4) + "^"
    assert line.startswith("    ")
    assert isinstance(caught.value, HgoError)
    assert isinstance(caught.value, ValueError)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    assert isinstance(caught.value.__context__, ExpressionError | None)  # dask sends it too


ATTACKS = {
    "parentheses": "(" * 4900 + "x" + ")" * 4900,
    "open parentheses": "(" * MAX_LENGTH,
    "signs": "-" * 9999 + "x",
    "powers": "x**" * 3000 + "x",
    "sums": "x+" * 4900 + "x",
    "calls": "sin(" * 1900 + "x" + ")" * 1900,
    "nots": "piecewise(1," + "not " * 2000 + "x<1, 0)",
    "too long": "x" * (MAX_LENGTH + 1),
    "a long name": "x" * MAX_LENGTH,
    "digits": "9" * MAX_LENGTH,
    "commas": "min(" + "x," * 4000 + "x)",
    "comparisons": "piecewise(1, x" + "<x" * 3000 + ", 0)",
    "lines": "\n" * 5000 + "y y",
    "a nul": "x\0",
    "a surrogate": "\ud800",
    "an emoji": "🙂",
    "direction": "x\u202e+1",
}


@pytest.mark.parametrize("attack", ATTACKS.values(), ids=list(ATTACKS))
def test_attacks_end_soon_with_a_value_or_a_clear_error(attack):
    started = time.perf_counter()
    try:
        node = parse(attack, ["x"])
    except ExpressionError as error:
        assert len(str(error)) < 700
        str(error).encode()
    else:
        assert node.depth <= nodes.MAX_DEPTH
    assert time.perf_counter() - started < 20.0


@settings(quick, max_examples=60)
@given(st.text(max_size=30) | st.text(alphabet="xy01.e+-*/()<>=!, sincospw^", max_size=40))
def test_no_text_does_anything_but_parse_or_be_refused(written):
    try:
        node = parse(written, NAMES)
    except ExpressionError as error:
        assert error.position is None or 0 <= error.position <= len(written)
    else:
        assert set(symbols([node])) <= set(NAMES)


# --- the graph ------------------------------------------------------------------------------------


def test_equal_expressions_are_one_object():
    assert parse("sin(x)*2") is nodes.function("mul", nodes.function("sin", X), nodes.constant(2.0))
    assert parse("0.0") is not parse("-0.0")
    assert parse("x*1 - 0") is X
    assert parse("--x") is X
    assert parse("0 - x") is not parse("-x"), "0 - 0 is +0, -0 is -0"
    assert parse("x + 0") is not X, "-0 + 0 is +0"
    assert parse("2*3 + 1").number == 7.0
    assert parse("sin(1)").op == "sin", "another library may round it differently"


def test_shared_parts_do_not_blow_up():
    node = X
    for _ in range(60):
        node = nodes.function("mul", node, node)
    assert "60 operations" in text(node)
    slope = derivative(node, "x")
    table = compile_table([node, slope], {"x": "x"}, ["f", "df"])
    assert len(table["ops"]) < 300
    with pytest.raises(ExpressionError, match="operations deep"):
        for _ in range(nodes.MAX_DEPTH):
            node = nodes.function("mul", node, node)


def test_a_table_of_two_outputs():
    roots = [parse("(a*b + sin(x))**2"), parse("sin(x)/(a*b)")]
    table = compile_table(
        roots, {"t": "t", "x": "x[0]", "a": "a", "b": "b"}, ["f", "g"], ["a", "b"]
    )
    assert table == {
        "inputs": ["t", "x[0]", "a", "b"],
        "constants": [],
        "ops": [["mul", 2, 3], ["sin", 1], ["add", 4, 5], ["mul", 6, 6], ["div", 5, 4]],
        "outputs": [7, 8],
        "output_names": ["f", "g"],
    }
    with pytest.raises(ExpressionError, match="y has no value"):
        compile_table([Y], {"x": "x"}, ["f"])
    with pytest.raises(ExpressionError, match="y has no value"):
        evaluate([Y], {"x": 1.0})


def test_division_by_a_power_of_two_is_a_product():
    table = compile_table([parse("x/4 + x/3 - x/-0.5")], {"x": "x[0]"}, ["f"])
    assert [op for op, *_ in table["ops"]] == ["mul", "div", "add", "mul", "sub"]
    assert table["constants"] == [0.25, 3.0, -2.0]


def test_latex():
    assert latex(parse("omega_0**2*sin(theta1)/M")) == (
        r"\frac{\omega_{0}^{2} \, \sin\left(\theta_{1}\right)}{M}"
    )
    assert latex(parse("1e-7*abs(x)")) == r"1 \cdot 10^{-7} \, \left|x\right|"
    assert r"\begin{cases}" in latex(parse("piecewise(1, x < 0 and y <= 1, sqrt(x))"))


# --- callables ------------------------------------------------------------------------------------


def traced(call):
    with np.errstate(all="ignore"):
        return [as_node(value) for value in np.ravel(np.asarray(call(*_arguments()), dtype=object))]


def _arguments():
    return Symbolic(nodes.symbol("t")), symbolic_vector(["x", "y"])


MATRIX = np.array([[0.0, 1.0], [-2.0, -3.0]])
CALLABLES = {
    "operators": lambda t, x: [
        2 * x[0] - x[1] / 3 + (-x[0]) ** 3,
        1 - t,
        abs(x[1]),
        +x[0],
        2 / x[0],
    ],
    "powers": lambda t, x: [x[0] ** 2, np.square(x[1]), abs(x[0]) ** 0.5, 2 ** x[1]],
    "ufuncs": lambda t, x: [
        np.sin(x[0]) * np.cos(t),
        np.exp(np.tanh(x[1])),
        np.arctan2(x[0], x[1]),
        np.maximum(x[0], 0.5),
        np.minimum(np.float64(0.1), x[1]),
        np.hypot(x[0], x[1]),
        np.reciprocal(x[0]),
        np.sqrt(np.abs(x[0])),
    ],
    "arrays": lambda t, x: MATRIX @ x + np.sin(x) * np.array([1.0, 2.0]) + x**2,
    "scalars and arrays": lambda t, x: x[0] * x - np.array([1.0, 2.0]) * t + np.maximum(x, t),
    "sums": lambda t, x: [x.sum() + np.dot(x, x), np.sum(MATRIX @ x)],
    "where": lambda t, x: [
        np.where(x[0] > 0, x[0], -x[1]),
        np.where((x[0] <= 0.3) & ~(x[1] == 0) | (x[1] != x[0]), 1.0, 2.0),
        np.clip(x[0], -0.5, 0.5),
    ],
}


@pytest.mark.parametrize("name", CALLABLES)
def test_callables_are_traced(name):
    call = CALLABLES[name]
    roots = traced(call)
    rng = np.random.default_rng(1)
    for _ in range(5):
        t, x = rng.uniform(0, 1), rng.uniform(-1, 1, 2)
        have = evaluate(roots, {"t": t, "x": x[0], "y": x[1]})
        with np.errstate(invalid="ignore"):
            np.testing.assert_allclose(have, np.ravel(call(t, x)), rtol=1e-13)


@pytest.mark.parametrize(
    "call",
    [
        lambda t, x: 1.0 if x[0] > 0 else 2.0,
        lambda t, x: math.sin(x[0]),
        lambda t, x: float(x[0]),
        lambda t, x: max(x[0], 0.0),
        lambda t, x: np.isnan(x[0]),
        lambda t, x: range(x[0]),
        lambda t, x: list(x[0]),
        lambda t, x: np.interp(x[0], [0, 1], [0, 1]),
        lambda t, x: np.where(x[0]),
    ],
)
def test_what_needs_a_value_cannot_be_traced(call):
    with pytest.raises((UntraceableError, TypeError)):
        traced(call)


# --- SymPy ----------------------------------------------------------------------------------------


def test_sympy_expressions_are_walked():
    sympy = pytest.importorskip("sympy")
    x, y = sympy.symbols("x y")
    q = sympy.Function("z")(sympy.Symbol("t"))
    for expression in (
        -x / (1 + x**2) - y,
        sympy.sqrt(x**2 + 1) * sympy.Rational(2, 3) / (y**2 + 1),
        x ** sympy.Rational(-1, 2) * sympy.pi,
        sympy.exp(-(x**2)) * sympy.log(2 + y) - sympy.E * sympy.tan(x),
        sympy.Piecewise((1, (x > 0.2) & (y < 0)), (x / 3, sympy.Or(x < 0.1, y >= 0.3)), (q, True)),
        sympy.Piecewise((y, sympy.Eq(x, y)), (x, sympy.Ne(x, 0.5)), (q, sympy.Not(x <= 0))),
        sympy.Max(x, y, 0.5) + sympy.Min(x, y) + sympy.Abs(y) + sympy.sign(y),
        sympy.atan2(y, x) * sympy.tanh(x) ** 3 * sympy.sin(q) * sympy.cos(x) * sympy.atan(y),
        (2**x) * x**y + 0.1,
        sympy.diff(sympy.sin(x * y) / x, x),
        -2 * x / (3 * y),
        sympy.Integer(7),
    ):
        if isinstance(expression, sympy.Piecewise) and expression.args[-1].cond is not sympy.true:
            with pytest.raises(ExpressionError, match="no last case"):
                from_sympy(expression)
            continue
        node = from_sympy(expression)
        rng = np.random.default_rng(3)
        for _ in range(4):
            values = dict(zip(NAMES, rng.uniform([0.05, -1, 0], [1, 1, 1]), strict=True))
            want = expression.subs({x: values["x"], y: values["y"], q: values["z"]})
            have = evaluate([node], values)[0]
            np.testing.assert_allclose(have, float(want), rtol=1e-12, err_msg=str(expression))
    for bad in (sympy.Integral(x, x), sympy.I * x, sympy.oo, sympy.gamma(x), sympy.zoo):
        with pytest.raises(ExpressionError, match="of SymPy"):
            from_sympy(bad)


def test_derivatives_agree_with_sympy():
    sympy = pytest.importorskip("sympy")
    x = sympy.Symbol("x")
    values = {"x": np.linspace(0.1, 1.2, 7), "y": 0.3}
    for written in ("x**3*sin(2*x)/(1+x**2)", "atan2(x, 1+x)*exp(-x)", "log(x)**2*sqrt(x)", "x**y"):
        truth = sympy.diff(sympy.sympify(written), x)  # a text of this test's own
        have = evaluate([derivative(parse(written), "x")], values)[0]
        want = evaluate([from_sympy(truth)], values)[0]
        np.testing.assert_allclose(have, want, rtol=1e-11)


def test_the_library_is_whole():
    names = "abs sign min max saturate piecewise sin cos tan atan atan2 exp log sqrt tanh pow"
    assert " ".join(FUNCTIONS) == names
