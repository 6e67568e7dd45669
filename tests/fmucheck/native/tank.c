/* An FMU in C, as other makers' are: a tank that fills.  Its GUID chooses a mistake; "{right}" is without. */
#include <fenv.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#ifdef WITHOUT_STEP
#undef fmi2DoStep
#define fmi2DoStep under_another_name
fmi2DoStepTYPE fmi2DoStep;
#endif

enum { LEVEL = 1, INFLOW, STEPS, FULL, NAME };

typedef struct {
    double level, inflow;
    int steps;
} State;

typedef struct {
    State now;
    char fault[32];
    const fmi2CallbackFunctions *host;
} Tank;

static int shared;     /* over all instances, where that is the mistake */
static int dies_at_end;

static int has(const Tank *tank, const char *fault)
{
    return strcmp(tank->fault, fault) == 0;
}

static void start(Tank *tank)
{
    const State begin = {0.0, has(tank, "{other start}") ? 3.0 : 2.0, 0};
    tank->now = begin;
}

__attribute__((destructor)) static void end(void)
{
    if (dies_at_end)
        abort();
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)visible, (void)logging, (void)type;
    Tank *tank = calloc(1, sizeof *tank);
    tank->host = host;
    strncpy(tank->fault, guid, sizeof tank->fault - 1);
    if (has(tank, "{slashes}") && strncmp(resources, "file:///", 8) != 0) {
        host->logger(NULL, name, fmi2Error, "logStatusError", "100 %% of URIs have three slashes: %s", resources);
        return NULL;
    }
    if (has(tank, "{handler}"))
        signal(SIGINT, SIG_IGN);
    if (has(tank, "{rounding}"))
        fesetround(FE_UPWARD);
    dies_at_end = has(tank, "{unload}");
    start(tank);
    return tank;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real begin,
                               fmi2Boolean end_defined, fmi2Real end_time)
{
    (void)c, (void)tolerance_defined, (void)tolerance, (void)begin, (void)end_defined, (void)end_time;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return (void)c, fmi2OK; }

fmi2Status fmi2Reset(fmi2Component c)
{
    Tank *tank = c;
    if (!has(tank, "{reset}"))
        start(tank);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[])
{
    const Tank *tank = c;
    for (size_t k = 0; k < n; k++)
        values[k] = r[k] == LEVEL ? tank->now.level / (has(tank, "{not finite}") ? 0.0 : 1.0) : tank->now.inflow;
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer values[])
{
    const Tank *tank = c;
    for (size_t k = 0; k < n; k++)
        values[k] = r[k] == STEPS ? (has(tank, "{shared}") ? shared : tank->now.steps) : 0;
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean values[])
{
    const Tank *tank = c;
    for (size_t k = 0; k < n; k++)
        values[k] = r[k] == FULL && tank->now.level > 1.0;
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String values[])
{
    (void)c, (void)r;
    for (size_t k = 0; k < n; k++)
        values[k] = "tank";
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[])
{
    Tank *tank = c;
    for (size_t k = 0; k < n && r[k] == INFLOW; k++)
        tank->now.inflow = values[k];
    return fmi2OK;
}

#define REFUSED(function, type)                                                                                        \
    fmi2Status function(fmi2Component c, const fmi2ValueReference r[], size_t n, const type values[])                  \
    {                                                                                                                  \
        return (void)c, (void)r, (void)n, (void)values, fmi2Error;                                                     \
    }
REFUSED(fmi2SetInteger, fmi2Integer)
REFUSED(fmi2SetBoolean, fmi2Boolean)
REFUSED(fmi2SetString, fmi2String)

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_back)
{
    Tank *tank = c;
    (void)time, (void)no_set_back;
    if (has(tank, "{discard}"))
        return fmi2Discard;
    if (has(tank, "{crash}") && tank->now.steps == 5)
        *(volatile int *)NULL = 1;
    while (has(tank, "{endless}"))
        ;
    tank->now.level += step * tank->now.inflow;
    tank->now.steps++;
    shared++;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    const Tank *tank = c;
    if (*state == NULL)
        *state = malloc(sizeof(State));
    memcpy(*state, &tank->now, sizeof tank->now);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Tank *tank = c;
    if (has(tank, "{state}"))
        tank->now.level = ((State *)state)->level; /* and the number of steps? */
    else
        memcpy(&tank->now, state, sizeof tank->now);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(State) + sizeof(Tank *);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)size;
    memcpy(bytes, state, sizeof(State));
    memcpy(bytes + sizeof(State), &c, sizeof c);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    (void)size;
    if (has(c, "{moved}") && memcmp(bytes + sizeof(State), &c, sizeof c) != 0)
        return fmi2Error; /* knows only what it wrote itself */
    *state = malloc(sizeof(State));
    memcpy(*state, bytes, sizeof(State));
    return fmi2OK;
}

#ifndef WITHOUT_STATUS
#define STATUS(function, type)                                                                                         \
    fmi2Status function(fmi2Component c, const fmi2StatusKind kind, type *value)                                       \
    {                                                                                                                  \
        return (void)c, (void)kind, (void)value, fmi2Error;                                                            \
    }
STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetRealStatus, fmi2Real)
STATUS(fmi2GetIntegerStatus, fmi2Integer)
STATUS(fmi2GetBooleanStatus, fmi2Boolean)
STATUS(fmi2GetStringStatus, fmi2String)
#endif

fmi2Status fmi2CancelStep(fmi2Component c) { return (void)c, fmi2Error; }

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real values[])
{
    return (void)c, (void)r, (void)n, (void)order, (void)values, fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real values[])
{
    return (void)c, (void)r, (void)n, (void)order, (void)values, fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seeds[],
                                        fmi2Real values[])
{
    (void)unknowns, (void)knowns, (void)n_knowns, (void)seeds;
    for (size_t k = 0; k < n_unknowns; k++) /* a tank takes its time to fill */
        values[k] = has(c, "{derivative}") ? 0.125 : has(c, "{no number}") ? nan("") : 0.0;
    return has(c, "{refused}") ? fmi2Error : has(c, "{not provided}") ? fmi2Discard : fmi2OK;
}
