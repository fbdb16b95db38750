"""What FMI 3.0 asks of a unit of co-simulation beside what both versions do: in C."""

from __future__ import annotations

from hgo_rs.exports.fmu.absent import absent

__all__ = ["DECLARATIONS", "OWN", "WORDS"]

WORDS = {
    "fmi": "fmi3",
    "number": "Float64",
    "integer": "Int32",
    "state": "FMUState",
    "message": "status, category, told",
    "de": "Des",
    "size": ", size_t size",
    "agree": """
    if (count != size) {
        refuse(of, "another number of values than of value references");
        return ERROR;
    }""",
}
"""What the shared functions are called, and what they take."""

DECLARATIONS = """\
/* What FMI 3.0 declares, as far as it is used. */
typedef bool truth;
typedef void (*logger)(void *environment, outcome status, const char *category,
                       const char *message);
"""

_USED = """\
EXPORTED unit *FMI(fmi3InstantiateCoSimulation)(
    const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const uint32_t *required, size_t count, void *environment,
    logger log, void (*update)(void *, double, bool, bool, bool, bool, bool *, double *))
{
    unit *of;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)early;
    (void)required;
    (void)count;
    (void)update;
    if (name == NULL || events) {
        return NULL;
    }
    of = created(name, token);
    if (of == NULL && log != NULL) {
        log(environment, ERROR, "logStatusError",
            "the token is of another modelDescription.xml, or no memory is left");
    }
    if (of != NULL) {
        of->sink = log;
        of->environment = environment;
    }
    return of;
}

EXPORTED outcome FMI(fmi3EnterInitializationMode)(unit *of, bool tolerant, double tolerance,
                                                  double start, bool stops, double stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)stops;
    (void)stop;
    return entered(of, start);
}

EXPORTED outcome FMI(fmi3DoStep)(unit *of, double t, double dt, bool final, bool *event,
                                 bool *terminate, bool *early, double *last)
{
    const outcome made = stepped(of, t, dt);
    (void)final;
    *event = false;
    *terminate = false;
    *early = false;
    *last = of->now.number[0];
    return made;
}

"""

_KINDS = {
    "Float32": "float",
    **{
        f"{sign}Int{width}": f"{sign.lower()}int{width}_t"
        for width in (8, 16, 32, 64)
        for sign in ("", "U")
    },
    "String": "char *",
}
_REFERENCES = "unit *of, const uint32_t *references, size_t count"
_TYPES = absent(
    "fmi3",
    [
        f"{verb}{kind}({_REFERENCES}, {of} *values, size_t size)"
        for kind, value in _KINDS.items()
        for verb, of in (("Get", value), ("Set", f"const {value}"))
        if verb + kind != "GetInt32"
    ]
    + [
        f"{verb}Binary({_REFERENCES}, {of}size_t *sizes, {kept}*values, size_t size)"
        for verb, of, kept in (
            ("Get", "", "const uint8_t *"),
            ("Set", "const ", "const uint8_t *const "),
        )
    ]
    + [
        f"{verb}Clock({_REFERENCES}, {of}bool *values)"
        for verb, of in (("Get", ""), ("Set", "const "))
    ],
    unless="count == 0",
)

_DECIMAL = f"{_REFERENCES}, double *values"
_FRACTION = f"{_REFERENCES}, uint64_t *counters, uint64_t *resolutions"
_PARTIAL = (
    "unit *of, const uint32_t *unknowns, size_t rows, const uint32_t *known, size_t columns, "
    "const double *seed, size_t seeds, double *values, size_t size"
)
_OTHERS = absent(
    "fmi3",
    [
        "EnterEventMode(unit *of)",
        "EnterStepMode(unit *of)",
        "EnterConfigurationMode(unit *of)",
        "ExitConfigurationMode(unit *of)",
        "EvaluateDiscreteStates(unit *of)",
        "UpdateDiscreteStates(unit *of, bool *update, bool *terminate, bool *nominals, "
        "bool *states, bool *defined, double *next)",
        "GetNumberOfVariableDependencies(unit *of, uint32_t reference, size_t *count)",
        "GetVariableDependencies(unit *of, uint32_t dependent, size_t *elements, "
        "uint32_t *independents, size_t *their_elements, int *kinds, size_t count)",
        f"GetDirectionalDerivative({_PARTIAL})",
        f"GetAdjointDerivative({_PARTIAL})",
        f"GetIntervalDecimal({_DECIMAL}, int *qualifiers)",
        f"GetIntervalFraction({_FRACTION}, int *qualifiers)",
        f"GetShiftDecimal({_DECIMAL})",
        f"GetShiftFraction({_FRACTION})",
        f"SetIntervalDecimal({_DECIMAL})",
        f"SetIntervalFraction({_FRACTION})",
        f"SetShiftDecimal({_DECIMAL})",
        f"SetShiftFraction({_FRACTION})",
        f"GetOutputDerivatives({_REFERENCES}, const int32_t *orders, double *values, size_t size)",
        "ActivateModelPartition(unit *of, uint32_t reference, double time)",
        # of model exchange: tools look for these too
        "EnterContinuousTimeMode(unit *of)",
        "CompletedIntegratorStep(unit *of, bool final, bool *event, bool *terminate)",
        "SetTime(unit *of, double time)",
        "SetContinuousStates(unit *of, const double *states, size_t count)",
        "GetContinuousStateDerivatives(unit *of, double *rates, size_t count)",
        "GetEventIndicators(unit *of, double *values, size_t count)",
        "GetContinuousStates(unit *of, double *states, size_t count)",
        "GetNominalsOfContinuousStates(unit *of, double *nominals, size_t count)",
        "GetNumberOfEventIndicators(unit *of, size_t *count)",
        "GetNumberOfContinuousStates(unit *of, size_t *count)",
    ],
)

_CREATED = (
    "const char *name, const char *token, const char *resources, bool visible, bool logging, "
    "void *environment, logger log"
)
_KINDS_OF_UNITS = absent(
    "fmi3",
    [
        f"InstantiateModelExchange({_CREATED})",
        f"InstantiateScheduledExecution({_CREATED}, logger update, logger lock, logger unlock)",
    ],
    gives="unit *",
)

OWN = _USED + _TYPES + _OTHERS + _KINDS_OF_UNITS
"""Functions that this version alone has, or has in its own way."""
