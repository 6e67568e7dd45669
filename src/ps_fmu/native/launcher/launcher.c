/* The library of an FMU that hosts load: it has Python running, and passes calls on to pythonfmu's own library.

   What it adds: hosts need not be prepared for Python; faults that pythonfmu calls fatal are errors, after which the
   instance can be reset or freed; arguments that would crash pythonfmu's library are refused; log messages have a
   category; what needs no Python is done without it (native.h).  Texts that come from Python are safe as printf formats already (see guard.py and slave.py); those made
   here become so in instance.c. */
#include "native.h"
#include "python.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST_BYTES ((size_t)1 << 28) /* in a state; see fault_of_values */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String uri,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *m = calloc(1, sizeof *m);
    char *copy = strdup(name != NULL ? name : "");
    if (m == NULL || copy == NULL) {
        free(copy);
        free(m);
        return NULL;
    }
    m->name = copy;
    m->logging = logging != fmi2False;
    if (functions != NULL)
        m->host = *functions;
    Text why = {0};
    if (copy[0] == '\0' || !is_utf8(copy))
        text_add(&why, "the instance name is empty or not UTF-8");
    else if (type != fmi2CoSimulation)
        text_add(&why, "this FMU is for co-simulation only");
    else if (instance_begin(m, guid, uri, visible, &why)) {
        native_bind(m);
        return m;
    }
    if (why.used > 0)
        instance_refuse(m, "fmi2Instantiate", why.data);
    text_free(&why);
    instance_end(m);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL)
        instance_end(c);
}

/* --- Calls ------------------------------------------------------------------------------------------------------ */

static Instance *enter(fmi2Component c, const char *function)
{
    Instance *m = c;
    if (m == NULL) {
        fprintf(stderr, "%s: called without an instance\n", function);
        return NULL;
    }
    if (!python_enter(m->generation)) {
        if (m->generation != python_generation()) /* otherwise the process is ending, and an error has no reader */
            instance_refuse(m, function, "not possible any more: the host has finalised Python");
        return NULL;
    }
    return m;
}

/* pythonfmu takes every exception for fatal; guard.py has put right what makes them so. */
static fmi2Status leave(fmi2Status status)
{
    python_leave();
    return status == fmi2Fatal ? fmi2Error : status;
}

/* The instance as `m`, with Python's lock, until `leave`. */
#define ENTER(c, function)                                                                                             \
    Instance *m = enter(c, function);                                                                                  \
    if (m == NULL)                                                                                                     \
        return fmi2Error

#define CALL(inner_call)                                                                                               \
    ENTER(c, __func__);                                                                                                \
    return leave(wrapper.inner_call)

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
    ENTER(c, __func__);
    fmi2Status status = leave(wrapper.SetupExperiment(m->inner, has_tolerance, tolerance, start, has_stop, stop));
    if (status == fmi2OK)
        m->time = start;
    return status;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    CALL(EnterInitializationMode(m->inner));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    CALL(ExitInitializationMode(m->inner));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    CALL(Terminate(m->inner));
}

/* In Python a reset instance is a new object. */
fmi2Status fmi2Reset(fmi2Component c)
{
    ENTER(c, __func__);
    m->core = NULL;
    fmi2Status status = wrapper.Reset(m->inner);
    if (status == fmi2OK) {
        native_bind(m);
        m->time = 0.0;
    }
    return leave(status);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state)
{
    if (native_step(c, time, step))
        return fmi2OK;
    ENTER(c, __func__);
    fmi2Status status = leave(wrapper.DoStep(m->inner, time, step, no_set_state));
    if (status == fmi2OK)
        m->time = time + step;
    return status;
}

static const char *fault_of_texts(size_t n, const fmi2String texts[])
{
    for (size_t i = 0; i < n; i++)
        if (texts[i] == NULL || !is_utf8(texts[i]))
            return "a text is NULL or not UTF-8";
    return NULL;
}

#define ACCESS(name, type, done)                                                                                       \
    fmi2Status fmi2##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[])                      \
    {                                                                                                                  \
        const char *fault = fault_of_values(n, vr, value);                                                             \
        if (fault == NULL && (done))                                                                                   \
            return fmi2OK;                                                                                             \
        ENTER(c, "fmi2" #name);                                                                                        \
        return leave(fault != NULL ? instance_refuse(m, "fmi2" #name, fault) : wrapper.name(m->inner, vr, n, value));  \
    }

ACCESS(GetReal, fmi2Real, native_GetReal(c, vr, n, value))
ACCESS(GetInteger, fmi2Integer, native_GetInteger(c, vr, n, value))
ACCESS(GetBoolean, fmi2Boolean, native_GetBoolean(c, vr, n, value))
ACCESS(SetReal, const fmi2Real, native_SetReal(c, vr, n, value))
ACCESS(SetInteger, const fmi2Integer, native_SetInteger(c, vr, n, value))
ACCESS(SetBoolean, const fmi2Boolean, native_SetBoolean(c, vr, n, value))

/* Python renews the linear model, unless it is always the same. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real direction[],
                                        fmi2Real result[])
{
    static const fmi2ValueReference reference = LINEAR_REFERENCE;
    const char *fault = fault_of_values(n_unknown, unknown, result);
    if (fault == NULL)
        fault = fault_of_values(n_known, known, direction);
    if (fault == NULL && c != NULL && native_needs_linear(c)) {
        ENTER(c, __func__);
        fmi2String answer = NULL;
        fmi2Status status = m->core != NULL ? wrapper.GetString(m->inner, &reference, 1, &answer) : fmi2OK;
        if (status == fmi2OK && answer != NULL && answer[0] != '\0') { /* why there is no linear model now */
            instance_tell(m, fmi2Discard, answer);
            status = fmi2Discard;
        }
        leave(status);
        if (status != fmi2OK)
            return status == fmi2Fatal ? fmi2Error : status;
    }
    if (fault == NULL)
        fault = native_differentiate(c, unknown, n_unknown, known, n_known, direction, result);
    if (fault == NULL)
        return fmi2OK;
    if (fault == NOT_PROVIDED) {
        instance_tell(c, fmi2Discard, fault);
        return fmi2Discard;
    }
    return c != NULL ? instance_refuse(c, __func__, fault) : fmi2Error;
}

static const char *fault_of_references(size_t n, const fmi2ValueReference vr[])
{
    for (size_t i = 0; i < n; i++)
        if (vr[i] == CORE_REFERENCE || vr[i] == LINEAR_REFERENCE)
            return "there is no variable with value references from 2147483646 on";
    return NULL;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    ENTER(c, __func__);
    const char *fault = fault_of_values(n, vr, value);
    if (fault == NULL)
        fault = fault_of_references(n, vr);
    return leave(fault != NULL ? instance_refuse(m, __func__, fault) : wrapper.GetString(m->inner, vr, n, value));
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    ENTER(c, __func__);
    const char *fault = fault_of_values(n, vr, value);
    if (fault == NULL)
        fault = fault_of_texts(n, value);
    return leave(fault != NULL ? instance_refuse(m, __func__, fault) : wrapper.SetString(m->inner, vr, n, value));
}

/* --- FMU states ------------------------------------------------------------------------------------------------- */

/* The place of a state in the list; n_states for a foreign one.  Hosts mostly want the newest, at the end. */
static size_t place_of(const Instance *m, fmi2FMUstate state)
{
    for (size_t i = m->n_states; i > 0; i--)
        if (m->states[i - 1] == state)
            return i - 1;
    return m->n_states;
}

static bool is_state(const Instance *m, fmi2FMUstate state)
{
    return state != NULL && place_of(m, state) < m->n_states;
}

static void free_state(Instance *m, fmi2FMUstate state)
{
    m->states[place_of(m, state)] = m->states[m->n_states - 1];
    m->n_states--;
    wrapper.FreeFMUstate(m->inner, &state);
}

/* Give a new state to the host, in place of the one that it passed. */
static fmi2Status hand_out(Instance *m, fmi2FMUstate *place, fmi2FMUstate state)
{
    fmi2FMUstate *states = realloc(m->states, (m->n_states + 1) * sizeof *states);
    if (states == NULL) {
        wrapper.FreeFMUstate(m->inner, &state);
        return instance_refuse(m, "FMU state", "out of memory");
    }
    m->states = states;
    m->states[m->n_states++] = state;
    if (is_state(m, *place) && *place != state)
        free_state(m, *place);
    *place = state;
    return fmi2OK;
}

static const char NO_STATE[] = "this is no FMU state of this instance";

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    ENTER(c, __func__);
    if (state == NULL)
        return leave(instance_refuse(m, __func__, "no place for the state"));
    fmi2FMUstate new = NULL;
    fmi2Status status = wrapper.GetFMUstate(m->inner, &new);
    return leave(status == fmi2OK ? hand_out(m, state, new) : status);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    ENTER(c, __func__);
    if (!is_state(m, state))
        return leave(instance_refuse(m, __func__, NO_STATE));
    fmi2Status status = leave(wrapper.SetFMUstate(m->inner, state));
    if (status == fmi2OK)
        m->time = NAN;
    return status;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    ENTER(c, __func__);
    if (state == NULL || *state == NULL)
        return leave(fmi2OK);
    if (!is_state(m, *state))
        return leave(instance_refuse(m, __func__, NO_STATE));
    free_state(m, *state);
    *state = NULL;
    return leave(fmi2OK);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    ENTER(c, __func__);
    if (!is_state(m, state) || size == NULL)
        return leave(instance_refuse(m, __func__, NO_STATE));
    return leave(wrapper.SerializedFMUstateSize(m->inner, state, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    ENTER(c, __func__);
    if (!is_state(m, state) || bytes == NULL)
        return leave(instance_refuse(m, __func__, NO_STATE));
    size_t needed = 0; /* pythonfmu copies as many bytes as the host asks for, even beyond the end */
    fmi2Status status = wrapper.SerializedFMUstateSize(m->inner, state, &needed);
    if (status == fmi2OK && size < needed)
        return leave(instance_refuse(m, __func__, "less room than fmi2SerializedFMUstateSize asks for"));
    return leave(status == fmi2OK ? wrapper.SerializeFMUstate(m->inner, state, bytes, needed) : status);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    ENTER(c, __func__);
    if (state == NULL || bytes == NULL || size > MOST_BYTES)
        return leave(instance_refuse(m, __func__, "no bytes, or no place for the state"));
    fmi2FMUstate new = NULL;
    size_t length = 0;
    fmi2Status status = wrapper.DeSerializeFMUstate(m->inner, bytes, size, &new);
    if (status == fmi2OK) {
        status = wrapper.SerializedFMUstateSize(m->inner, new, &length);
        if (status == fmi2OK && length == 0) /* unreadable, see state.py: the instance says why */
            status = wrapper.SetFMUstate(m->inner, new);
        if (status != fmi2OK)
            wrapper.FreeFMUstate(m->inner, &new);
    }
    return leave(status == fmi2OK ? hand_out(m, state, new) : status);
}
