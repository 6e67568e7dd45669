/* What the FMUs in C have in common: states, of all that changes in an instance, and functions that nobody calls.

   Whoever includes it has defined KEPT(c), the address of what changes in the instance `c`. */
#include <stdlib.h>
#include <string.h>

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state == NULL)
        *state = malloc(sizeof *KEPT(c));
    memcpy(*state, KEPT(c), sizeof *KEPT(c));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(KEPT(c), state, sizeof *KEPT(c));
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
    *size = sizeof *KEPT(c);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)c;
    if (size != sizeof *KEPT(c))
        return fmi2Error;
    memcpy(bytes, state, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    (void)c;
    if (size != sizeof *KEPT(c) || (*state = malloc(size)) == NULL)
        return fmi2Error;
    memcpy(*state, bytes, size);
    return fmi2OK;
}

/* Not used, but section 2.3 wants all functions. */
#define ABSENT(name, ...) fmi2Status fmi2##name(fmi2Component c, __VA_ARGS__) { (void)c; return fmi2Error; }
#pragma GCC diagnostic ignored "-Wunused-parameter"
ABSENT(SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String names[])
ABSENT(GetRealOutputDerivatives, const fmi2ValueReference r[], size_t n, const int o[], double v[])
ABSENT(GetStatus, const fmi2StatusKind what, fmi2Status *value)
ABSENT(GetIntegerStatus, const fmi2StatusKind what, int *value)
ABSENT(GetStringStatus, const fmi2StatusKind what, fmi2String *value)
fmi2Status fmi2CancelStep(fmi2Component c) { (void)c; return fmi2Error; }
