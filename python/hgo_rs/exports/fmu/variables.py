"""The variables of an FMU: what the observer takes, gives, remembers and can be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hgo_rs.exports.names import Names
from hgo_rs.exports.program import Field, Program

__all__ = ["Variable", "Variables", "variables"]


@dataclass(frozen=True)
class Variable:
    """A variable as FMI describes it; its value reference is its place among all.

    All but the time and the parameters are discrete: samples are taken, inputs held and estimates
    given at communication points alone.
    """

    name: str
    meaning: str
    causality: str
    variability: str
    initial: str | None = None
    start: float | bool | None = None
    type: str = "real"
    """real, integer or boolean."""
    unit: str | None = None
    field: str | None = None
    """Where the exported state holds it."""

    @property
    def settable(self) -> str:
        """When its value may be set: never, before the first step, or always."""
        if self.causality in ("input", "parameter"):
            return "ALWAYS"
        return "BEFORE" if self.initial == "exact" else "NEVER"


@dataclass(frozen=True)
class Variables:
    """All of them, in the order of their value references: numbers, the status, Booleans."""

    time: Variable
    samples: tuple[Variable, ...]
    controls: tuple[Variable, ...]
    memory: tuple[Variable, ...]
    """The estimates, then what else the observer remembers."""
    corrected: tuple[Variable, ...]
    """The estimates at the instant of the sample; none with predictor timing."""
    parameters: tuple[Variable, ...]
    status: Variable
    present: tuple[Variable, ...]
    """Whether there is a sample."""

    @property
    def numbers(self) -> tuple[Variable, ...]:
        """The real ones."""
        moving = (*self.samples, *self.controls, *self.memory, *self.corrected)
        return (self.time, *moving, *self.parameters)

    @property
    def all(self) -> tuple[Variable, ...]:
        """Every variable."""
        return (*self.numbers, self.status, *self.present)

    def reference(self, variable: Variable) -> int:
        """The value reference of a variable."""
        return self.all.index(variable)


def variables(program: Program, n: int, units: Mapping[str, str]) -> Variables:
    """The variables of an observer of n states; `units` by the words of the source."""
    words = program.words
    names = Names((*words.samples, *words.controls, *words.memory, *words.parameters))
    time = names.local("time")

    def number(field: Field, name: str, causality: str, variability: str, meaning: str) -> Variable:
        return Variable(
            name,
            meaning,
            causality,
            variability,
            "exact",
            float(program.precision.real(field.value)),
            unit=units.get(field.name),
            field=field.name,
        )

    estimates = [
        number(field, names.local(f"{field.name}_hat"), "output", "discrete", field.meaning)
        for field in program.memory[:n]
    ]
    rest = [
        number(field, field.name, "local", "discrete", field.meaning)
        for field in program.memory[n:]
    ]
    corrected = [
        Variable(
            names.local(f"{field.name}_corrected"),
            f"{field.meaning} at the beginning of the last step, after its sample",
            "output",
            "discrete",
            "calculated",
            unit=units.get(field.name),
        )
        for field in program.memory[: n * program.is_current]
    ]
    statuses = ", ".join(f"{i} {told.lower()}" for i, told in enumerate(program.statuses))
    return Variables(
        Variable(time, "time", "independent", "continuous", unit="s"),
        tuple(
            Variable(
                word,
                "sample; missing if it is NaN or infinite",
                "input",
                "discrete",
                start=0.0,
                unit=units.get(word),
            )
            for word in words.samples
        ),
        tuple(
            Variable(word, "known input", "input", "discrete", start=0.0, unit=units.get(word))
            for word in words.controls
        ),
        (*estimates, *rest),
        tuple(corrected),
        tuple(
            number(field, field.name, "parameter", "tunable", field.meaning)
            for field in program.parameters
        ),
        Variable(
            names.local("sample_status"),
            f"what the last step made of its sample: {statuses}",
            "output",
            "discrete",
            "calculated",
            type="integer",
        ),
        tuple(
            Variable(
                names.local(f"{word}_present"),
                f"whether {word} is a sample; if not, it is missing",
                "input",
                "discrete",
                start=True,
                type="boolean",
            )
            for word in words.samples
        ),
    )
