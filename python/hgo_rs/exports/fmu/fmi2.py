"""What FMI 2.0 asks of a unit of co-simulation beside what both versions do: in C."""

from __future__ import annotations

from hgo_rs.exports.fmu.absent import absent

__all__ = ["DECLARATIONS", "OWN", "WORDS"]

WORDS = {
    "fmi": "fmi2",
    "number": "Real",
    "integer": "Integer",
    "state": "FMUstate",
    "message": 'of->name, status, category, "%s", told',
    "de": "DeS",
    "size": "",
    "agree": "",
}
"""What the shared functions are called, and what they take."""

DECLARATIONS = """\
/* What FMI 2.0 declares, as far as it is used. */
typedef int truth;
typedef void (*logger)(void *environment, const char *name, outcome status, const char *category,
                       const char *message, ...);

typedef struct {
    logger sink;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, outcome status);
    void *environment;
} callbacks;
"""

_USED = """\
EXPORTED const char *FMI(fmi2GetTypesPlatform)(void)
{
    return "default";
}

EXPORTED unit *FMI(fmi2Instantiate)(const char *name, int type, const char *guid,
                                    const char *resources, const callbacks *functions, int visible,
                                    int logging)
{
    unit *of;
    (void)resources;
    (void)visible;
    (void)logging;
    if (name == NULL || type != 1) { /* 1: co-simulation */
        return NULL;
    }
    of = created(name, guid);
    if (of == NULL && functions != NULL && functions->sink != NULL) {
        functions->sink(functions->environment, name, ERROR, "logStatusError", "%s",
                          "the guid is of another modelDescription.xml, or no memory is left");
    }
    if (of != NULL && functions != NULL) {
        of->sink = functions->sink;
        of->environment = functions->environment;
    }
    return of;
}

EXPORTED outcome FMI(fmi2SetupExperiment)(unit *of, int tolerant, double tolerance, double start,
                                          int stops, double stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)stops;
    (void)stop;
    of->now.number[0] = start;
    return OK;
}

EXPORTED outcome FMI(fmi2EnterInitializationMode)(unit *of)
{
    return entered(of, of->now.number[0]);
}

EXPORTED outcome FMI(fmi2DoStep)(unit *of, double t, double dt, int final)
{
    (void)final;
    return stepped(of, t, dt);
}

"""

_TYPES = absent(
    "fmi2",
    [
        "SetInteger(unit *of, const uint32_t *references, size_t count, const int *values)",
        "GetString(unit *of, const uint32_t *references, size_t count, const char **values)",
        "SetString(unit *of, const uint32_t *references, size_t count, const char *const *values)",
    ],
    unless="count == 0",
)

_OTHERS = absent(
    "fmi2",
    [
        "GetDirectionalDerivative(unit *of, const uint32_t *unknowns, size_t rows, "
        "const uint32_t *known, size_t columns, const double *seed, double *values)",
        "SetRealInputDerivatives(unit *of, const uint32_t *references, size_t count, "
        "const int *order, const double *values)",
        "GetRealOutputDerivatives(unit *of, const uint32_t *references, size_t count, "
        "const int *order, double *values)",
        "CancelStep(unit *of)",
        "GetStatus(unit *of, int kind, outcome *value)",
        "GetRealStatus(unit *of, int kind, double *value)",
        "GetIntegerStatus(unit *of, int kind, int *value)",
        "GetBooleanStatus(unit *of, int kind, int *value)",
        "GetStringStatus(unit *of, int kind, const char **value)",
    ],
)

OWN = _USED + _TYPES + _OTHERS
"""Functions that this version alone has, or has in its own way."""
