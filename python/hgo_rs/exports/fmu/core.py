"""C that FMI 2.0 and 3.0 share: what moves, how variables are told and set, a step."""

from __future__ import annotations

from string import Template

__all__ = ["CORE", "FUNCTIONS"]

CORE = Template("""\
/* $name as a functional mock-up unit: FMI $version, co-simulation. modelDescription.xml names its
 * variables; $name.c is the observer. A step of the unit takes the samples and inputs of its
 * beginning and moves over its length. */

#include "$name.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Functions have a prefix where several units are linked into one program. */
#ifdef FMI${major}_FUNCTION_PREFIX
#define GLUED(a, b) a##b
#define PREFIXED(a, b) GLUED(a, b)
#define FMI(word) PREFIXED(FMI${major}_FUNCTION_PREFIX, word)
#else
#define FMI(word) word
#endif
#ifdef FMI${major}_Export
#define EXPORTED FMI${major}_Export
#elif defined(FMI${major}_FUNCTION_PREFIX)
#define EXPORTED
#elif defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

/* Value references: numbers, then the status, then whether there are samples. */
enum { NUMBERS = $numbers, STATUS = NUMBERS, PRESENT = NUMBERS + 1, SAMPLES = $samples };

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } outcome;
typedef enum { CREATED, STARTING, STEPPING, ENDED } phase;

/* All that moves: what FMI calls the state of a unit. */
typedef struct {
    ${name}_state state;
    double number[NUMBERS];
    int present[SAMPLES];
    int status;
    phase mode;
} moving;

$declarations
typedef struct {
    moving now;
    logger sink;
    void *environment;
    char name[1]; /* as long as it is */
} unit;

static void report(const unit *of, outcome status, const char *told)
{
    if (of->sink != NULL) {
        const char *category = status == WARNING ? "logStatusWarning" : "logStatusError";
        of->sink(of->environment, $message);
    }
}

/* When a number may be set. */
enum { NEVER, BEFORE, ALWAYS };
static const unsigned char settable[NUMBERS] = {
    $settable
};

static void refuse(const unit *of, const char *told)
{
    report(of, ERROR, told);
}

/* Numbers that are told, to the state. */
static void load(moving *m)
{
$load
}

/* The state, to numbers that are told. */
static void unload(moving *m)
{
$unload
}

/* The estimates at the instant of a sample; before the first one they are those of the start. */
static void mirror(moving *m)
{
$mirror
}

static void begin(moving *m)
{
    int i;
    memset(m, 0, sizeof *m);
    ${name}_init(&m->state);
    for (i = 0; i < SAMPLES; ++i) {
        m->present[i] = 1;
    }
    m->status = ${up}_PREDICTED;
    m->mode = CREATED;
    unload(m);
    mirror(m);
}

static double sample(const moving *m, int i)
{
    return m->present[i] ? m->number[1 + i] : (double)NAN;
}

/* A step from time t [s] over the length dt [s]; what it made of its samples. */
static void advance(moving *m, double t, double dt)
{
    ${name}_state *const state = &m->state;
    load(m);
$advance
    unload(m);
    m->number[0] = t + dt;
}

static outcome stepped(unit *of, double t, double dt)
{
    moving *const m = &of->now;
    const int before = m->status;
    if (m->mode != STEPPING) {
        refuse(of, "a step before the end of initialisation, or after terminate");
        return ERROR;
    }
    if (!(isfinite(t) && isfinite(dt) && dt > 0.0)) {
        refuse(of, "a step that has no finite time, or no finite length > 0");
        return ERROR;
    }
$fixed    advance(m, t, dt);
    if (m->status == ${up}_UPDATED || m->status == ${up}_PREDICTED) {
        return OK;
    }
    if (m->status != before) {
        report(of, WARNING, m->status == ${up}_UNDEFINED
            ? "the model has no finite value here: the estimate is kept"
            : $other);
    }
    return WARNING;
}

static outcome get_numbers(const unit *of, const uint32_t *references, size_t count, double *values)
{
    size_t i;
    for (i = 0; i < count; ++i) {
        if (references[i] >= NUMBERS) {
            refuse(of, "a value reference that is no number's");
            return ERROR;
        }
        values[i] = of->now.number[references[i]];
    }
    return OK;
}

static outcome set_numbers(unit *of, const uint32_t *references, size_t count, const double *values)
{
    moving *const m = &of->now;
    size_t i;
    for (i = 0; i < count; ++i) {
        if (references[i] >= NUMBERS) {
            refuse(of, "a value reference that is no number's");
            return ERROR;
        }
        if (settable[references[i]] == NEVER
            || (settable[references[i]] == BEFORE && m->mode > STARTING)) {
            refuse(of, "a variable that is computed, or that is set before the first step only");
            return ERROR;
        }
        m->number[references[i]] = (double)($real)values[i];
    }
    if (m->mode <= STARTING) {
        mirror(m);
    }
    return OK;
}

static outcome get_status(const unit *of, const uint32_t *references, size_t count, int32_t *values)
{
    size_t i;
    for (i = 0; i < count; ++i) {
        if (references[i] != STATUS) {
            refuse(of, "a value reference that is no integer's");
            return ERROR;
        }
        values[i] = of->now.status;
    }
    return OK;
}

/* Where a Boolean is; SAMPLES for a value reference of none. */
static size_t place(const unit *of, uint32_t reference)
{
    if (reference < PRESENT || reference - PRESENT >= SAMPLES) {
        refuse(of, "a value reference that is no Boolean's");
        return SAMPLES;
    }
    return reference - PRESENT;
}

static moving *copied(const unit *of, moving *held)
{
    if (held == NULL) {
        held = (moving *)malloc(sizeof *held);
    }
    if (held == NULL) {
        refuse(of, "no memory for a copy of the state");
    } else {
        *held = of->now;
    }
    return held;
}

static unit *created(const char *name, const char *token)
{
    const size_t length = strlen(name) + 1;
    unit *of = NULL;
    if (token != NULL && strcmp(token, "$token") == 0) {
        of = (unit *)calloc(1, sizeof *of + length);
    }
    if (of != NULL) {
        memcpy(of->name, name, length);
        begin(&of->now);
    }
    return of;
}

static outcome entered(unit *of, double start)
{
    if (of->now.mode != CREATED) {
        refuse(of, "initialisation of a unit that is initialised: reset it first");
        return ERROR;
    }
    of->now.number[0] = start;
    of->now.mode = STARTING;
    return OK;
}

static outcome left(unit *of)
{
    if (of->now.mode != STARTING) {
        refuse(of, "the end of an initialisation that was not begun");
        return ERROR;
    }
    of->now.mode = STEPPING;
    return OK;
}

static outcome ended(unit *of)
{
    if (of->now.mode != STEPPING) {
        refuse(of, "terminate of a unit that does not step");
        return ERROR;
    }
    of->now.mode = ENDED;
    return OK;
}

""")

FUNCTIONS = Template("""\
/* --- the functions of FMI $version --- */

EXPORTED const char *FMI(${fmi}GetVersion)(void)
{
    return "$version";
}

EXPORTED void FMI(${fmi}FreeInstance)(unit *of)
{
    free(of);
}

EXPORTED outcome FMI(${fmi}SetDebugLogging)(unit *of, truth on, size_t count,
                                            const char *const *categories)
{
    (void)of;
    (void)on;
    (void)count;
    (void)categories;
    return OK;
}

EXPORTED outcome FMI(${fmi}ExitInitializationMode)(unit *of)
{
    return left(of);
}

EXPORTED outcome FMI(${fmi}Terminate)(unit *of)
{
    return ended(of);
}

EXPORTED outcome FMI(${fmi}Reset)(unit *of)
{
    begin(&of->now);
    return OK;
}

EXPORTED outcome FMI(${fmi}Get$number)(unit *of, const uint32_t *references, size_t count,
                                      double *values$size)
{$agree
    return get_numbers(of, references, count, values);
}

EXPORTED outcome FMI(${fmi}Set$number)(unit *of, const uint32_t *references, size_t count,
                                      const double *values$size)
{$agree
    return set_numbers(of, references, count, values);
}

EXPORTED outcome FMI(${fmi}Get$integer)(unit *of, const uint32_t *references, size_t count,
                                     int32_t *values$size)
{$agree
    return get_status(of, references, count, values);
}

EXPORTED outcome FMI(${fmi}GetBoolean)(unit *of, const uint32_t *references, size_t count,
                                     truth *values$size)
{
    size_t i;$agree
    for (i = 0; i < count; ++i) {
        const size_t at = place(of, references[i]);
        if (at == SAMPLES) {
            return ERROR;
        }
        values[i] = (truth)of->now.present[at];
    }
    return OK;
}

EXPORTED outcome FMI(${fmi}SetBoolean)(unit *of, const uint32_t *references, size_t count,
                                     const truth *values$size)
{
    size_t i;$agree
    for (i = 0; i < count; ++i) {
        const size_t at = place(of, references[i]);
        if (at == SAMPLES) {
            return ERROR;
        }
        of->now.present[at] = values[i] != 0;
    }
    return OK;
}

EXPORTED outcome FMI(${fmi}Get$state)(unit *of, moving **held)
{
    *held = copied(of, *held);
    return *held == NULL ? ERROR : OK;
}

EXPORTED outcome FMI(${fmi}Set$state)(unit *of, const moving *held)
{
    of->now = *held;
    return OK;
}

EXPORTED outcome FMI(${fmi}Free$state)(unit *of, moving **held)
{
    (void)of;
    free(*held);
    *held = NULL;
    return OK;
}

EXPORTED outcome FMI(${fmi}Serialized${state}Size)(unit *of, const moving *held, size_t *size)
{
    (void)of;
    *size = sizeof *held;
    return OK;
}

EXPORTED outcome FMI(${fmi}Serialize$state)(unit *of, const moving *held, void *bytes, size_t size)
{
    if (size < sizeof *held) {
        refuse(of, "room for fewer bytes than a state has");
        return ERROR;
    }
    memcpy(bytes, held, sizeof *held);
    return OK;
}

EXPORTED outcome FMI(${fmi}${de}erialize$state)(unit *of, const void *bytes, size_t size,
                                              moving **held)
{
    if (size != sizeof **held) {
        refuse(of, "bytes that are no state of this unit");
        return ERROR;
    }
    *held = copied(of, *held);
    if (*held == NULL) {
        return ERROR;
    }
    memcpy(*held, bytes, size);
    return OK;
}

""")
"""Functions that both versions have, under names of their own."""
