"""An observer as a co-simulation FMU: FMI 2.0 or 3.0, sources and, with a C compiler, a binary.

The observer itself is the exported C, as it is; around it stand one file with FMI's functions and
the XML files that describe it.
"""

from __future__ import annotations

from collections.abc import Mapping

from hgo_rs.exports.c import files as c_files
from hgo_rs.exports.fmu.archive import archive
from hgo_rs.exports.fmu.description import build_description, model_description
from hgo_rs.exports.fmu.source import source
from hgo_rs.exports.fmu.units import checked
from hgo_rs.exports.fmu.variables import variables
from hgo_rs.exports.program import Program
from hgo_rs.observers import Observer

__all__ = ["archive", "files"]


def files(
    observer: Observer,
    program: Program,
    version: str,
    dt: float | None,
    units: Mapping[str, str] | None,
) -> dict[str, str]:
    """The texts in an FMU, by name; `version` of FMI is "2.0" or "3.0".

    Raises
    ------
    HgoError
        A unit of a name that is none of the observer's, or that is no text.
    """
    name = program.name
    listed = variables(program, observer.n, checked(units, observer, program))
    texts = c_files(program)
    inside = {f"sources/{name}.{end}": texts[f"{name}.{end}"] for end in ("h", "c")}
    unit = source(program, listed, version)
    inside[f"sources/{name}_fmu.c"] = unit.text
    if version == "3.0":
        inside["sources/buildDescription.xml"] = build_description(name)
    described = model_description(program, listed, version, dt, unit.token)
    return {"modelDescription.xml": described, **inside}
