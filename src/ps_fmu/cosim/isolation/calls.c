/* FMI 2.0 as the master calls it: each function returns when the guest has carried the call out. */

#include <stdlib.h>
#include <string.h>

#include "client.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static int call(Client *c, Kind kind)
{
    int status;
    return begin_operation(c, kind, 0, &status) == NULL ? status : perform_batch(c, c->life_ns);
}

static uint64_t put_text(Client *c, const char *text)
{
    const uint64_t place = c->used; /* texts follow each other without gaps */
    const size_t bytes = strlen(text) + 1;
    memcpy(at(c, place), text, bytes);
    c->used += bytes;
    return place;
}

static uint64_t put_texts(Client *c, const fmi2String *texts, size_t n)
{
    const uint64_t place = c->used;
    for (size_t k = 0; k < n; k++)
        put_text(c, texts[k] != NULL ? texts[k] : "");
    c->used = (c->used + 7) / 8 * 8;
    return place;
}

static size_t count_bytes(const fmi2String *texts, size_t n)
{
    size_t bytes = 0;
    for (size_t k = 0; k < n; k++)
        bytes += texts[k] != NULL ? strlen(texts[k]) + 1 : 1;
    return bytes;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Client *c = take_next_client();
    int status;
    (void)type;
    if (c == NULL)
        return NULL;
    const fmi2String texts[] = {name, guid, location, c->library};
    Operation *o = begin_operation(c, INSTANTIATE, count_bytes(texts, 4), &status);
    if (o == NULL)
        return NULL;
    c->callbacks = callbacks;
    c->name = name;
    o->first = put_texts(c, texts, 4);
    o->whole[0] = (uint64_t)visible;
    o->whole[1] = (uint64_t)logging;
    forget_reads(c);
    return perform_batch(c, c->life_ns) == fmi2OK ? c : NULL;
}

void fmi2FreeInstance(fmi2Component c) { call(c, FREE_INSTANCE); }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (fmi2Status)call(c, ENTER_INITIALIZATION); }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (fmi2Status)call(c, EXIT_INITIALIZATION); }
fmi2Status fmi2Terminate(fmi2Component c) { return (fmi2Status)call(c, TERMINATE); }
fmi2Status fmi2Reset(fmi2Component c) { return (fmi2Status)call(c, RESET); }
fmi2Status fmi2CancelStep(fmi2Component c) { return (fmi2Status)call(c, CANCEL_STEP); }

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, double tolerance, double start,
                               fmi2Boolean has_stop, double stop)
{
    int status;
    Operation *o = begin_operation(component, SETUP_EXPERIMENT, 0, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->whole[0] = (uint64_t)has_tolerance, o->whole[1] = (uint64_t)has_stop;
    o->real[0] = tolerance, o->real[1] = start, o->real[2] = stop;
    return (fmi2Status)perform_batch(component, ((Client *)component)->life_ns);
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    int status;
    Client *c = component;
    Operation *o = begin_operation(c, SET_DEBUG_LOGGING, count_bytes(categories, n), &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->whole[0] = (uint64_t)on;
    o->first = put_texts(c, categories, n);
    return (fmi2Status)perform_batch(c, c->life_ns);
}

#define ACCESS(Type, TYPE)                                                                                             \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##Type v[])            \
    {                                                                                                                  \
        return (fmi2Status)set_values(c, SET_##TYPE, r, n, v, 0);                                                      \
    }                                                                                                                  \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##Type v[])                  \
    {                                                                                                                  \
        return (fmi2Status)get_values(c, GET_##TYPE, r, n, v, ((Client *)c)->step_ns);                                 \
    }
ACCESS(Real, REAL)
ACCESS(Integer, INTEGER)
ACCESS(Boolean, BOOLEAN)

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference r[], size_t n, const fmi2String v[])
{
    int status;
    Client *c = component;
    Operation *o = begin_operation(c, SET_STRING, n * sizeof *r + count_bytes(v, n), &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->first = reserve_place(c, n * sizeof *r);
    memcpy(at(c, o->first), r, n * sizeof *r);
    o->second = put_texts(c, v, n);
    return (fmi2Status)perform_batch(c, c->life_ns);
}

/* Strings of the guest as the client's own. */
static int take_strings(Client *c, uint64_t place, uint64_t bytes, size_t n, fmi2String *strings)
{
    char *copy = realloc(c->texts, bytes + 1);
    if (copy == NULL)
        return fmi2Error;
    c->texts = copy;
    memcpy(copy, at(c, place), bytes);
    copy[bytes] = '\0';
    const char *text = copy;
    for (size_t k = 0; k < n; k++) {
        strings[k] = text;
        text += strlen(text) + 1;
        if (text > copy + bytes + 1)
            return fmi2Error;
        if (text > copy + bytes)
            text = copy + bytes;
    }
    return fmi2OK;
}

enum { TEXT_BYTES = 1 << 20 };

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference r[], size_t n, fmi2String v[])
{
    int status;
    Client *c = component;
    Operation *o = begin_operation(c, GET_STRING, n * sizeof *r + TEXT_BYTES, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->first = reserve_place(c, n * sizeof *r);
    memcpy(at(c, o->first), r, n * sizeof *r);
    o->size = TEXT_BYTES;
    const uint64_t place = o->third = reserve_place(c, TEXT_BYTES);
    status = perform_batch(c, c->life_ns);
    return (fmi2Status)(status > fmi2Warning ? status : take_strings(c, place, TEXT_BYTES, n, v) | status);
}

/* `state` goes to the guest and comes back. */
static int exchange_state(Client *c, Kind kind, fmi2FMUstate *state, size_t *size, fmi2Byte *bytes, size_t n)
{
    int status;
    Operation *o = begin_operation(c, kind, n, &status);
    if (o == NULL)
        return status;
    const uint32_t k = c->n_sent - 1;
    const uint64_t place = o->first = reserve_place(c, n);
    o->whole[0] = (uint64_t)(uintptr_t)*state;
    o->size = n;
    if (kind == DESERIALIZE_STATE)
        memcpy(at(c, place), bytes, n);
    status = perform_batch(c, c->life_ns);
    if (status > fmi2Warning)
        return status;
    if (kind == SERIALIZE_STATE)
        memcpy(bytes, at(c, place), n);
    *state = (fmi2FMUstate)(uintptr_t)c->channel->operations[k].whole[0];
    if (size != NULL)
        *size = c->channel->operations[k].whole[1];
    return status;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return (fmi2Status)exchange_state(c, GET_STATE, state, NULL, NULL, 0);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return (fmi2Status)exchange_state(c, SET_STATE, &state, NULL, NULL, 0);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return (fmi2Status)exchange_state(c, FREE_STATE, state, NULL, NULL, 0);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    return (fmi2Status)exchange_state(c, STATE_SIZE, &state, size, NULL, 0);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t n)
{
    return (fmi2Status)exchange_state(c, SERIALIZE_STATE, &state, NULL, bytes, n);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t n, fmi2FMUstate *state)
{
    return (fmi2Status)exchange_state(c, DESERIALIZE_STATE, state, NULL, (fmi2Byte *)bytes, n);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknown[], size_t n,
                                        const fmi2ValueReference known[], size_t n_known, const double seed[],
                                        double result[])
{
    int status;
    Client *c = component;
    Operation *o = begin_operation(c, DIRECTIONAL_DERIVATIVE, (n + n_known) * (sizeof *known + sizeof *seed), &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->size = n_known;
    o->first = reserve_place(c, n * sizeof *unknown);
    o->second = reserve_place(c, n_known * sizeof *known);
    const uint64_t place = o->third = reserve_place(c, (n + n_known) * sizeof *seed);
    memcpy(at(c, o->first), unknown, n * sizeof *unknown);
    memcpy(at(c, o->second), known, n_known * sizeof *known);
    memcpy(at(c, o->third), seed, n_known * sizeof *seed);
    status = perform_batch(c, c->life_ns);
    if (status <= fmi2Warning)
        memcpy(result, at(c, place + n_known * sizeof *seed), n * sizeof *result);
    return (fmi2Status)status;
}

/* Derivatives of inputs, or of outputs; `orders` and `values` have one number for each reference. */
static int exchange_derivatives(Client *c, Kind kind, const fmi2ValueReference *r, size_t n, const int *orders,
                                double *values)
{
    int status;
    Operation *o = begin_operation(c, kind, n * (sizeof *r + sizeof *orders + sizeof *values), &status);
    if (o == NULL)
        return status;
    o->count = n;
    o->first = reserve_place(c, n * sizeof *r);
    o->second = reserve_place(c, n * sizeof *orders);
    const uint64_t place = o->third = reserve_place(c, n * sizeof *values);
    memcpy(at(c, o->first), r, n * sizeof *r);
    memcpy(at(c, o->second), orders, n * sizeof *orders);
    memcpy(at(c, place), values, n * sizeof *values);
    status = perform_batch(c, c->life_ns);
    if (status <= fmi2Warning)
        memcpy(values, at(c, place), n * sizeof *values);
    return status;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const int orders[],
                                       const double values[])
{
    return (fmi2Status)exchange_derivatives(c, SET_INPUT_DERIVATIVES, r, n, orders, (double *)values);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const int orders[],
                                        double values[])
{
    return (fmi2Status)exchange_derivatives(c, GET_OUTPUT_DERIVATIVES, r, n, orders, values);
}

fmi2Status fmi2DoStep(fmi2Component c, double time, double step, fmi2Boolean only_forward)
{
    int status;
    Operation *o = begin_operation(c, DO_STEP, 0, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->real[0] = time, o->real[1] = step;
    o->whole[0] = (uint64_t)only_forward;
    return (fmi2Status)perform_batch(c, ((Client *)c)->step_ns);
}

static int ask(Client *c, Kind kind, fmi2StatusKind what, void *answer, size_t bytes)
{
    int status;
    Operation *o = begin_operation(c, kind, sizeof(double), &status);
    if (o == NULL)
        return status;
    o->whole[0] = (uint64_t)what;
    const uint64_t place = o->first = reserve_place(c, sizeof(double));
    status = perform_batch(c, c->life_ns);
    if (status <= fmi2Warning)
        memcpy(answer, at(c, place), bytes);
    return status;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind what, fmi2Status *value)
{
    return (fmi2Status)ask(c, GET_STATUS, what, value, sizeof *value);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind what, fmi2Real *value)
{
    return (fmi2Status)ask(c, GET_REAL_STATUS, what, value, sizeof *value);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind what, fmi2Integer *value)
{
    return (fmi2Status)ask(c, GET_INTEGER_STATUS, what, value, sizeof *value);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind what, fmi2Boolean *value)
{
    return (fmi2Status)ask(c, GET_BOOLEAN_STATUS, what, value, sizeof *value);
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind what, fmi2String *value)
{
    int status;
    Client *c = component;
    Operation *o = begin_operation(c, GET_STRING_STATUS, TEXT_BYTES, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->whole[0] = (uint64_t)what;
    o->size = TEXT_BYTES;
    const uint64_t place = o->third = reserve_place(c, TEXT_BYTES);
    status = perform_batch(c, c->life_ns);
    return (fmi2Status)(status > fmi2Warning ? status : take_strings(c, place, TEXT_BYTES, 1, value) | status);
}
