"""The XML files of an FMU: its variables for tools, and how to build its sources."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from hgo_rs._version import __version__
from hgo_rs.exports.fmu.units import dimension
from hgo_rs.exports.fmu.variables import Variable, Variables
from hgo_rs.exports.program import Program

__all__ = ["build_description", "model_description"]


def model_description(
    program: Program, variables: Variables, version: str, dt: float | None, token: str
) -> str:
    """modelDescription.xml."""
    second = version == "2.0"
    root = Xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": program.name,
            "guid" if second else "instantiationToken": token,
            "description": program.description.splitlines()[0],
            "generationTool": f"hgo_rs {__version__}",
            "variableNamingConvention": "flat",
        },
    )
    state = "state" if second else "State"
    can = {
        "canHandleVariableCommunicationStepSize": program.periods is None and program.fixed is None,
        f"canGetAndSetFMU{state}": True,
        f"canSerializeFMU{state}": True,
        "canNotUseMemoryManagementFunctions": True,
    }
    if not second:
        del can["canNotUseMemoryManagementFunctions"]
    told = {word: _text(value) for word, value in can.items()}
    unit = Xml.SubElement(root, "CoSimulation", {"modelIdentifier": program.name, **told})
    if second:
        files = Xml.SubElement(unit, "SourceFiles")
        for file in _sources(program.name):
            Xml.SubElement(files, "File", name=file)
    _define_units(root, variables)
    period = program.fixed or dt
    experiment = {"startTime": "0"} | ({} if period is None else {"stepSize": repr(float(period))})
    Xml.SubElement(root, "DefaultExperiment", experiment)
    described = Xml.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables.all):
        (_second if second else _third)(described, variable, reference)
    _structure(Xml.SubElement(root, "ModelStructure"), variables, second)
    return _written(root)


def build_description(name: str) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    build = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    sources = Xml.SubElement(build, "SourceFileSet", language="C99")
    for file in _sources(name):
        Xml.SubElement(sources, "SourceFile", name=file)
    return _written(root)


def _sources(name: str) -> tuple[str, str]:
    return (f"{name}.c", f"{name}_fmu.c")


def _written(root: Xml.Element) -> str:
    Xml.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'


def _text(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _define_units(root: Xml.Element, variables: Variables) -> None:
    names = dict.fromkeys(v.unit for v in variables.all if v.unit is not None)
    defined = Xml.SubElement(root, "UnitDefinitions") if names else root
    for name in names:
        unit, base = Xml.SubElement(defined, "Unit", name=name), dimension(name)
        if base is not None:
            Xml.SubElement(unit, "BaseUnit", base.attributes)


def _attributes(variable: Variable, reference: int) -> dict[str, str]:
    """What both versions say of a variable in the same words."""
    told = {
        "name": variable.name,
        "valueReference": str(reference),
        # a name of the user's may have characters that XML has not
        "description": "".join(c if c.isprintable() else " " for c in variable.meaning),
        "causality": variable.causality,
        "variability": variable.variability,
    }
    return told | ({"initial": variable.initial} if variable.initial is not None else {})


def _typed(variable: Variable) -> dict[str, str]:
    """What it says of its type."""
    told = {"unit": variable.unit} if variable.unit is not None else {}
    return told | ({"start": _text(variable.start)} if variable.start is not None else {})


def _second(parent: Xml.Element, variable: Variable, reference: int) -> None:
    outer = Xml.SubElement(parent, "ScalarVariable", _attributes(variable, reference))
    names = {"real": "Real", "integer": "Integer", "boolean": "Boolean"}
    Xml.SubElement(outer, names[variable.type], _typed(variable))


def _third(parent: Xml.Element, variable: Variable, reference: int) -> None:
    names = {"real": "Float64", "integer": "Int32", "boolean": "Boolean"}
    told = _attributes(variable, reference) | _typed(variable)
    Xml.SubElement(parent, names[variable.type], told)


def _structure(structure: Xml.Element, variables: Variables, second: bool) -> None:
    """Outputs, which follow no input of the same instant, and what is computed at the start."""
    outputs = [(i, v) for i, v in enumerate(variables.all) if v.causality == "output"]
    first = [(i, v) for i, v in outputs if v.initial == "calculated"]
    if second:
        parents = [Xml.SubElement(structure, group) for group in ("Outputs", "InitialUnknowns")]
        for parent, group in zip(parents, (outputs, first), strict=True):
            for i, _ in group:
                told = {"dependencies": ""} if group is outputs else {}
                Xml.SubElement(parent, "Unknown", {"index": str(i + 1), **told})
        return
    for i, _ in outputs:
        Xml.SubElement(structure, "Output", valueReference=str(i), dependencies="")
    for i, _ in first:
        Xml.SubElement(structure, "InitialUnknown", valueReference=str(i))
