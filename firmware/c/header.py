"""Writes include/hgo.h from the Rust source, which defines the interface.

    python3 firmware/c/header.py           writes the header
    python3 firmware/c/header.py --check   fails if the header is not what the source says

Read are the tables, `repr(C)` structs and functions of src/lib.rs and src/law.rs with their
comments, laid out as rustfmt does it. What is not understood is an error, not left out.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
HEADER = HERE / "include" / "hgo.h"
WIDTH = 100

SCALARS = {"f32": "float", "f64": "double"}
WORDS = {"f32": ("uint32_t", 4), "f64": ("uint64_t", 8)}
NUMBERS = {"u32": "uint32_t", "i32": "int32_t", "usize": "size_t", "c_char": "char", **SCALARS}
FAMILIES = {
    "standard": "Standard observer, fixed gain: memory x_hat, time",
    "adaptive": "Standard observer, adaptive gain: memory x_hat, r, time",
    "dead_zone": "Standard observer, gain with a dead zone: memory x_hat, r, time",
    "low_power": "Low-power observer, fixed gain: memory x_hat, eta, time",
    "peaking_free": "Peaking-free observer (hard clips), fixed gain: memory x_hat, eta, time",
}

INTRODUCTION = """\
/* hgo.h: high-gain observers for C11 and C++11. Link with libhgo.a and -Wl,--gc-sections.
 *
 * Written by firmware/c/header.py from firmware/c/src; do not edit.
 *
 * An observer estimates y and its derivatives, x_hat_1 = y, x_hat_2 = dy/dt and so on, from noisy
 * samples of y. A type is a law, an order n and a precision. For position and velocity in float:
 *
 *     static hgo_standard2_f32 observer;
 *     const hgo_standard_config_f32 config = {.k = {3.0f, 2.0f}, .ell = 50.0f, .dt_max = 0.02f};
 *     hgo_error error;
 *     int32_t status =
 *         hgo_standard2_f32_init(&observer, sizeof observer, HGO_VERSION, &config, &error);
 *
 * The model, d^n y/dt^n = phi, is evaluated by the caller from the estimate and the inputs and is
 * passed as a number; 0 makes a differentiator. There are two ways to use a state; use one of them
 * for each state.
 *
 * A control loop needs the present estimate. At every sample, for example in a timer interrupt,
 *
 *     hgo_standard2_f32_correct(&observer, y);              the present sample is used
 *     hgo_standard2_f32_estimate(&observer, x_hat, 2);      the present estimate
 *     u = control(x_hat);                                   compute the input and apply it
 *     phi = model(x_hat, u);                                under the input that is applied now
 *     hgo_standard2_f32_predict(&observer, phi, 0.001f);    over the period that begins
 *
 * phi and dt of predict belong to the period that begins, and so does the input within phi. Where
 * its length is not known beforehand (a callback), phi is kept, and predict is called at the
 * beginning of the next call, before correct, with the time that has passed.
 *
 * The papers' recursion is one call a sample, whose estimate is that of the next sample's time:
 *
 *     status = hgo_standard2_f32_step(&observer, y, phi, 0.001f);
 *     hgo_standard2_f32_estimate(&observer, x_hat, 2);
 *
 * phi and dt of step belong to the period from this sample to the next one; phi is computed from
 * the estimate before the step. An input that is computed from the estimate after it comes one
 * period too late for this phi: that is what correct and predict are for.
 *
 * The law is discretised by forward Euler (in Python: method="euler", with timing="current" for
 * correct and predict, timing="predictor" for step). Coefficients, gains and step limits come from
 * the Python package hgo_rs, see docs/from-python-to-your-board.md; the laws and their papers
 * stand in docs/ too. What is tied to one model (the sampled-data observer of a Van der Pol
 * oscillator, the reduced-order observer of a ship), collections and the other discretisations are
 * for Rust only.
 *
 * Every function returns a code: >= 0 is what became of the sample or the period, < 0 what was
 * refused, with no state changed. Nothing allocates, blocks, panics or calls another library, but
 * memcpy and its like. A state is the caller's and holds no pointer: it may be copied and moved.
 * One context at a time may use a state; different states are independent.
 *
 * Refused are NULL and unaligned pointers, states that are too small, never made or of another
 * type, and another version's header. A pointer that is wrong otherwise cannot be recognised. */
"""


class LayoutError(RuntimeError):
    """The source is not laid out as this program reads it."""


@dataclass(frozen=True)
class Struct:
    """A repr(C) struct."""

    name: str
    generic: bool
    doc: str
    fields: list[tuple[str, str, str]]
    """Name, Rust type, comment."""


@dataclass(frozen=True)
class Function:
    """A function with C linkage."""

    name: str
    doc: str
    parameters: list[tuple[str, str]]
    result: str


@dataclass(frozen=True)
class Observer:
    """A row of the table of types."""

    family: str
    scalar: str
    order: int
    config: str
    size: int
    memory: int

    @property
    def name(self) -> str:
        return f"{self.family}{self.order}_{self.scalar}"


@dataclass(frozen=True)
class Interface:
    """All that the source says."""

    version: int
    codes: list[tuple[str, int, str]]
    structs: list[Struct]
    sizes: dict[str, int]
    functions: list[Function]
    methods: list[Function]
    observers: list[Observer]


def snake(name: str) -> str:
    """StandardConfig -> standard_config."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def struct_name(name: str, scalar: str = "") -> str:
    return f"hgo_{snake(name)}" + (f"_{scalar}" if scalar else "")


def _doc(block: str) -> str:
    return " ".join(line.strip().removeprefix("///").strip() for line in block.splitlines())


def _parameters(text: str) -> list[tuple[str, str]]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    pairs = [tuple(part.split(": ", 1)) for part in parts]
    return [(name, kind) for name, kind in pairs]


def _found(what: str, matches: list[tuple[str, ...]], expected: int) -> list[tuple[str, ...]]:
    if len(matches) != expected or not matches:
        raise LayoutError(f"{len(matches)} of {expected} {what} understood: see header.py")
    return matches


def read(folder: Path = HERE / "src") -> Interface:
    """The interface that the source defines."""
    library = (folder / "lib.rs").read_text(encoding="utf-8")
    text = library + (folder / "law.rs").read_text(encoding="utf-8")

    version = re.search(r"^const VERSION: u32 = (\d+);$", library, re.M)
    if version is None:
        raise LayoutError("no VERSION")
    table = _table(library, "codes")
    found = re.findall(r'^    (\w+) = (-?\d+), b"(.*)\\0";$', table, re.M)
    codes = [(n, int(v), t) for n, v, t in _found("codes", found, table.count(";"))]

    comment = r"((?:^ *///[^\n]*\n)+)"
    derived = r"#\[repr\(C\)\]\n#\[derive[^\n]*\]\n"
    pattern = comment + derived + r"pub struct (\w+)(<T>)? \{\n(.*?)^\}"
    found = re.findall(pattern, text, re.M | re.S)
    structs = []
    count = len(re.findall(derived, text))
    for doc, name, generic, body in _found("structs", found, count):
        found = re.findall(comment + r" +pub (\w+): ([^\n]*),\n", body, re.M)
        found = _found(f"fields of {name}", found, body.count("    pub "))
        fields = [(field, kind, _doc(about)) for about, field, kind in found]
        structs.append(Struct(name, bool(generic), _doc(doc), fields))

    table = _table(library, "sizes")
    found = re.findall(r"^    (\w+)(?:<(f\d\d)>)? = (\d+);$", table, re.M)
    sizes = {struct_name(n, s): int(b) for n, s, b in _found("sizes", found, table.count(";"))}

    signature = r'extern "C" fn (\w+)\((.*?)\) -> (.*?) \{'
    attribute = re.escape("#[unsafe(no_mangle)]")
    found = re.findall(comment + attribute + r"\npub " + signature, library, re.M | re.S)
    found = _found("functions", found, library.count("#[unsafe(no_mangle)]"))
    functions = [Function(n, _doc(d), _parameters(p), r) for d, n, p, r in found]

    # a method has its own name in Rust, and in C the type's name before it
    attribute = re.escape('#[unsafe(export_name = concat!("hgo_", stringify!($name), "_NAME"))]')
    attribute = r" +" + attribute.replace("NAME", r"(\w+)") + r"\n +unsafe "
    found = re.findall(comment + attribute + signature, library, re.M | re.S)
    found = _found("methods", found, library.count("#[unsafe(export_name"))
    if any(exported != name for _, exported, name, _, _ in found):
        raise LayoutError("a method is exported under another name than its own")
    methods = [Function("_" + n, _doc(d), _parameters(p), r) for d, _, n, p, r in found]

    table = _table(library, "observers")
    pattern = (
        r"^    (\w+?)(\d)_(f\d\d): \w+<(f\d\d), (\d)> from (\w+), "
        r"(\d+) bytes, (\d+) numbers;$"
    )
    observers = []
    for row in _found("observers", re.findall(pattern, table, re.M), table.count(";")):
        family, order, scalar, config, size, memory = row[0], row[1], row[2], *row[5:]
        if (order, scalar) != (row[4], row[3]) or family not in FAMILIES:
            raise LayoutError(f"{family}{order}_{scalar} is not what its name says")
        observers.append(Observer(family, scalar, int(order), config, int(size), int(memory)))
    return Interface(int(version[1]), codes, structs, sizes, functions, methods, observers)


def _table(text: str, macro: str) -> str:
    """The rows of `macro! { ... }`, without comments."""
    found = re.search(rf"^{macro}! \{{\n(.*?)^\}}", text, re.M | re.S)
    if found is None:
        raise LayoutError(f"no table {macro}")
    return re.sub(r"^ *//.*\n", "", found[1], flags=re.M)


def _type(kind: str, types: dict[str, str]) -> str:
    """A Rust type in C, ready for a name to follow."""
    pointer = re.fullmatch(r"\*(mut|const) (.*)", kind)
    if pointer:
        return ("const " if pointer[1] == "const" else "") + _type(pointer[2], types) + "*"
    if kind not in types:
        raise LayoutError(f"type {kind!r} has no name in C")
    return types[kind] + " "


def _prototype(function: Function, name: str, types: dict[str, str]) -> str:
    parameters = ", ".join(_type(t, types) + n for n, t in function.parameters) or "void"
    return _folded(f"{_type(function.result, types)}{name}({parameters});", "    ", ", ")


def _folded(line: str, indent: str, after: str = " ") -> str:
    """A line broken after this text where it is too long."""
    lines = []
    while len(line) > WIDTH:
        cut = line.rindex(after, 0, WIDTH + 1) + len(after)
        lines.append(line[:cut].rstrip())
        line = indent + line[cut:]
    return "\n".join([*lines, line])


def _comment(text: str, indent: str = "") -> str:
    head, tail = f"{indent}/* {text}".rsplit(" ", 1)
    whole = _folded(f"{head} {tail}\0*/", f"{indent} * ")
    return whole.replace("\0", " ")


def _struct(struct: Struct, interface: Interface, scalar: str) -> list[str]:
    name = struct_name(struct.name, scalar)
    types = NUMBERS | ({"T": SCALARS[scalar]} if scalar else {})
    lines = [_comment(struct.doc), "typedef struct {"]
    for field, kind, doc in struct.fields:
        array = re.fullmatch(r"\[(\w+); (\d+)\]", kind)
        suffix = f"[{array[2]}]" if array else ""
        lines += [_comment(doc, "    ")]
        lines += [f"    {_type(array[1] if array else kind, types)}{field}{suffix};"]
    return [*lines, f"}} {name};", f"HGO_ASSERT(sizeof({name}) == {interface.sizes[name]});", ""]


def header(interface: Interface) -> str:
    """The text of hgo.h."""
    out = [
        INTRODUCTION,
        "#ifndef HGO_H\n#define HGO_H\n",
        "#include <stddef.h>\n#include <stdint.h>\n",
        "#ifdef __cplusplus",
        '#define HGO_ASSERT(holds) static_assert(holds, "the layout of hgo.h and of libhgo.a")',
        'extern "C" {',
        "#else",
        '#define HGO_ASSERT(holds) _Static_assert(holds, "the layout of hgo.h and of libhgo.a")',
        "#endif\n",
        "/* Version of this header, for init. */",
        f"#define HGO_VERSION {interface.version}\n",
        "/* Codes: what became of a sample or a period, and what a function refused. */",
        "enum {",
        "    /* what a function that takes no sample or time returns when it has done its work */",
        "    HGO_OK = 0,",
    ]
    for name, value, text in interface.codes:
        out += [_comment(text, "    "), f"    HGO_{name} = {value},"]
    out += ["};", ""]
    plain = [s for s in interface.structs if not s.generic]
    generic = [s for s in interface.structs if s.generic]
    for struct in plain:
        out += _struct(struct, interface, "")
    for function in interface.functions:
        out += [_comment(function.doc), _prototype(function, function.name, NUMBERS), ""]
    out += ["/* --- Configurations ------------------------------------------------------- */", ""]
    for struct in generic:
        for scalar in SCALARS:
            out += _struct(struct, interface, scalar)
    out += [
        "/* --- Observers ------------------------------------------------------------",
        " *",
        " * Each type has these functions. HGO_..._SIZE is the size of its state in bytes, on",
        " * every processor; HGO_..._MEMORY is the length of its memory, whose last number is the",
        " * time that the next correct is for.",
        " *",
    ]
    for method in interface.methods:
        out += [_folded(f" * {method.name}: {method.doc}", " *     ")]
    out += [" */", ""]
    family = ""
    for observer in interface.observers:
        if observer.family != family:
            family = observer.family
            out += [f"/* {FAMILIES[family]}. */", ""]
        scalar, name = observer.scalar, f"hgo_{observer.name}"
        types = NUMBERS | {
            "$t": SCALARS[scalar],
            "State": name,
            "Config": struct_name(observer.config, scalar),
            **{s.name: struct_name(s.name) for s in plain},
        }
        upper, (word, length) = name.upper(), WORDS[scalar]
        out += [
            f"#define {upper}_SIZE {observer.size}",
            f"#define {upper}_MEMORY {observer.memory}",
            f"typedef struct {{ {word} opaque[{upper}_SIZE / {length}]; }} {name};",
            *(_prototype(method, name + method.name, types) for method in interface.methods),
            "",
        ]
    out += ["#ifdef __cplusplus", "}", "#endif", "#endif", ""]
    return "\n".join(out)


def is_current() -> bool:
    """Whether the header is what the source says."""
    return HEADER.is_file() and HEADER.read_text(encoding="utf-8") == header(read())


def main(arguments: list[str]) -> int:
    """Writes or checks the header; the exit status."""
    if arguments == ["--check"]:
        if not is_current():
            print(f"{HEADER.name} is not what the source says: run header.py", file=sys.stderr)
        return int(not is_current())
    if arguments:
        print(__doc__, file=sys.stderr)
        return 2
    HEADER.parent.mkdir(exist_ok=True)
    HEADER.write_text(header(read()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
