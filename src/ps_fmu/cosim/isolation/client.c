/* FMI 2.0 as the master calls it, for an FMU that lives in a process of its own (guest.c).

   fmi2... functions return when the call has been carried out.  Those of the steps, later_..., put off what they can: to
   set values costs no exchange, and a step takes along the reads that followed the step before.  So a step is one
   exchange, and the FMUs of a Jacobi step run side by side.  A status then comes back with a later call than the one it
   belongs to; `get_outcome` tells whose it is. */

#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "channel.h"
#include "fmi2Functions.h"
#include "waiting.h"

enum { MOST_LEARNT = 32, SLICE_NS = 20000000 };

typedef enum { ALIVE, KILLED, EXITED, HANGS, INTERRUPTED } Fate;

/* A read that follows each step. */
typedef struct {
    Kind kind;
    size_t n;
    fmi2ValueReference *references;
    uint64_t values; /* where the guest puts them */
} Learnt;

typedef struct {
    /* Set by the master's Python, see guest_process.py. */
    Channel *channel;
    const char *library;
    uint64_t data_bytes;
    int64_t guest;              /* process */
    int64_t spin_ns;
    int64_t step_ns, life_ns;   /* how long to wait for the calls of a step, and for the others; 0: for ever */
    volatile int *interrupts; /* from two on, waiting ends, once */
    /* What became of the guest. */
    int64_t fate, fate_number;
    /* Own. */
    const fmi2CallbackFunctions *callbacks;
    fmi2String name;
    char *texts; /* strings that the last call returned */
    Operation sent[MOST_OPERATIONS];
    uint32_t n_sent, number;
    uint64_t used;
    fmi2Boolean under_way, complete;
    Learnt learnt[MOST_LEARNT];
    uint32_t n_learnt, n_read;
} Client;

static Client *next_client;

#define EXPORTED __attribute__((visibility("default")))

EXPORTED uint64_t channel_bytes(void) { return sizeof(Channel); }
EXPORTED uint64_t client_bytes(void) { return sizeof(Client); }

/* The instance that fmi2Instantiate makes next belongs to this client. */
EXPORTED void set_next_client(Client *client) { next_client = client; }

/* An operation of the last batch, as the master's Python reads it.  For fmi2DoStep `time` is where it begins [s]. */
typedef struct {
    int32_t kind, status;
    uint64_t count; /* of the value references, of a get or set function */
    const fmi2ValueReference *references;
    double time;
} Outcome;

/* False behind the last operation. */
EXPORTED int get_outcome(const Client *client, uint32_t k, Outcome *outcome)
{
    if (k >= client->n_sent)
        return 0;
    const Operation *o = &client->sent[k];
    outcome->kind = (int32_t)o->kind;
    outcome->status = client->channel->operations[k].status;
    outcome->count = o->count;
    outcome->references = (const void *)(client->channel->data + o->first);
    outcome->time = o->real[0];
    return 1;
}

/* Place of the operation during which the guest ended or was ended; and what the FMU changed. */
EXPORTED uint32_t get_last_begun(const Client *client) { return client->channel->doing; }
EXPORTED uint32_t get_change(const Client *client) { return client->channel->changed; }

/* ---- exchange -------------------------------------------------------------------------------------------------- */

static void pass_messages_on(Client *c)
{
    const uint32_t used = c->channel->log_used;
    if (used == 0)
        return;
    char *log = malloc(LOG_BYTES + 2); /* a copy: the guest may go on writing */
    const uint32_t bytes = used < LOG_BYTES ? used : LOG_BYTES;
    memcpy(log, c->channel->log, bytes);
    log[bytes] = log[bytes + 1] = '\0';
    c->channel->log_used = 0;
    for (const char *next = log; next + sizeof(int32_t) < log + bytes;) {
        int32_t status;
        memcpy(&status, next, sizeof status);
        const char *category = next + sizeof status, *text = category + strlen(category) + 1;
        if (text >= log + bytes)
            break;
        if (c->callbacks != NULL)
            c->callbacks->logger(c->callbacks->componentEnvironment, c->name, (fmi2Status)status, category, "%s", text);
        next = text + strlen(text) + 1;
    }
    free(log);
}

static int has_ended(Client *c)
{
    siginfo_t info;
    info.si_pid = 0;
    if (waitid(P_PID, (id_t)c->guest, &info, WEXITED | WNOHANG | WNOWAIT) != 0)
        info.si_pid = (pid_t)c->guest, info.si_code = CLD_EXITED, info.si_status = -1;
    if (info.si_pid == 0)
        return 0;
    c->fate = info.si_code == CLD_EXITED ? EXITED : KILLED;
    c->fate_number = info.si_status;
    return 1;
}

static void end_guest(Client *c, Fate fate)
{
    c->fate = fate;
    kill(-(pid_t)c->guest, SIGKILL); /* with the processes that it has started */
}

EXPORTED void interrupt_isolated(Client *c);

/* Whether the guest has carried out the batch. */
static int await(Client *c, int64_t patience_ns)
{
    uint32_t *done = &c->channel->done;
    if (spin(done, c->number, c->spin_ns))
        return 1;
    const int64_t until = now_ns() + patience_ns;
    for (;;) {
        const uint32_t now = __atomic_load_n(done, __ATOMIC_ACQUIRE);
        if (now == c->number)
            return 1;
        if (has_ended(c)) /* perhaps just after its work */
            return __atomic_load_n(done, __ATOMIC_ACQUIRE) == c->number && (c->fate = ALIVE, 1);
        if (c->interrupts != NULL && *c->interrupts > 1)
            return interrupt_isolated(c), 0;
        if (patience_ns > 0 && now_ns() > until)
            return end_guest(c, HANGS), 0;
        sleep_on(done, now, &c->channel->master_sleeps, SLICE_NS);
    }
}

static void post(Client *c)
{
    Channel *shared = c->channel;
    memcpy(shared->operations, c->sent, c->n_sent * sizeof *c->sent);
    shared->n_operations = c->n_sent;
    shared->doing = 0;
    c->under_way = 1;
    tell(&shared->posted, ++c->number, &shared->guest_sleeps);
}

/* The status of the batch under way: the first above fmi2Warning, or the highest. */
static int collect(Client *c, int64_t patience_ns)
{
    if (c->fate != ALIVE)
        return fmi2Fatal;
    c->under_way = 0;
    c->complete = 1;
    const int alive = await(c, patience_ns);
    pass_messages_on(c);
    if (!alive)
        return fmi2Fatal;
    int highest = fmi2OK;
    for (uint32_t k = 0; k < c->n_sent; k++) {
        const int status = c->channel->operations[k].status;
        if (status < fmi2OK || status > fmi2Warning)
            return status < fmi2OK && c->channel->changed != UNCHANGED ? fmi2Error : status;
        highest = status > highest ? status : highest;
    }
    return c->channel->changed != UNCHANGED ? fmi2Error : highest;
}

static int settle(Client *c)
{
    return c->under_way ? collect(c, c->step_ns) : fmi2OK;
}

/* ---- batches --------------------------------------------------------------------------------------------------- */

static uint64_t reserve(Client *c, uint64_t bytes)
{
    const uint64_t place = c->used;
    c->used += (bytes + 7) / 8 * 8;
    return place;
}

/* A place for the data of an operation; it is checked when the operation is complete. */
static void *at(Client *c, uint64_t place) { return c->channel->data + place; }

/* Room for an operation with so many bytes of data in the batch; NULL if there is none. */
static Operation *add(Client *c, Kind kind, uint64_t bytes)
{
    if (c->complete) {
        c->n_sent = 0;
        c->used = 0;
        c->complete = 0;
    }
    if (c->n_sent == MOST_OPERATIONS || bytes > c->data_bytes - c->used)
        return NULL;
    Operation *o = &c->sent[c->n_sent++];
    memset(o, 0, sizeof *o);
    o->kind = kind;
    o->status = -1;
    return o;
}

static int perform(Client *c, int64_t patience_ns)
{
    post(c);
    return collect(c, patience_ns);
}

/* As `add`; a full batch is carried out first. */
static Operation *begin(Client *c, Kind kind, uint64_t bytes, int *status)
{
    *status = c->fate == ALIVE ? settle(c) : fmi2Fatal;
    if (*status > fmi2Warning)
        return NULL;
    Operation *o = add(c, kind, bytes + 64);
    if (o != NULL)
        return o;
    if (c->n_sent > 0 && (*status = perform(c, c->step_ns)) > fmi2Warning)
        return NULL;
    o = add(c, kind, bytes + 64);
    if (o == NULL)
        *status = fmi2Error;
    return o;
}

static size_t width(Kind kind) { return kind == SET_REAL || kind == GET_REAL ? sizeof(double) : sizeof(int); }

static Operation *begin_access(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, int *status)
{
    Operation *o = begin(c, kind, n * (sizeof *references + width(kind)), status);
    if (o == NULL)
        return NULL;
    o->count = n;
    o->first = reserve(c, n * sizeof *references);
    o->second = reserve(c, n * width(kind));
    memcpy(at(c, o->first), references, n * sizeof *references);
    return o;
}

static int set(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, const void *values, int later)
{
    int status;
    Operation *o = begin_access(c, kind, references, n, &status);
    if (o == NULL)
        return status;
    memcpy(at(c, o->second), values, n * width(kind));
    return later ? status : perform(c, c->step_ns);
}

static int get(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, void *values, int64_t patience_ns)
{
    int status;
    Operation *o = begin_access(c, kind, references, n, &status);
    if (o == NULL)
        return status;
    const uint64_t place = o->second;
    status = perform(c, patience_ns);
    if (status <= fmi2Warning)
        memcpy(values, at(c, place), n * width(kind));
    return status;
}

/* ---- the calls of the steps ------------------------------------------------------------------------------------ */

static void forget_reads(Client *c)
{
    while (c->n_learnt > 0)
        free(c->learnt[--c->n_learnt].references);
}

static void learn(Client *c, Kind kind, const fmi2ValueReference *references, size_t n)
{
    if (c->n_learnt == MOST_LEARNT || c->n_read != c->n_learnt)
        return;
    Learnt *read = &c->learnt[c->n_learnt];
    if ((read->references = malloc(n * sizeof *references + 1)) == NULL)
        return;
    memcpy(read->references, references, n * sizeof *references);
    read->kind = kind;
    read->n = n;
    c->n_read = ++c->n_learnt;
}

static int later_get(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, void *values)
{
    const int status = settle(c);
    if (c->fate != ALIVE)
        return fmi2Fatal;
    if (status > fmi2Warning || status < fmi2OK)
        return status;
    const Learnt *read = &c->learnt[c->n_read];
    if (c->n_read < c->n_learnt && c->complete && read->kind == kind && read->n == n
        && memcmp(read->references, references, n * sizeof *references) == 0) {
        memcpy(values, at(c, read->values), n * width(kind));
        c->n_read++;
        return status;
    }
    const int answer = get(c, kind, references, n, values, c->step_ns);
    learn(c, kind, references, n);
    return answer;
}

EXPORTED int later_SetReal(Client *c, const fmi2ValueReference *r, size_t n, const double *v)
{
    return set(c, SET_REAL, r, n, v, 1);
}

EXPORTED int later_SetInteger(Client *c, const fmi2ValueReference *r, size_t n, const int *v)
{
    return set(c, SET_INTEGER, r, n, v, 1);
}

EXPORTED int later_SetBoolean(Client *c, const fmi2ValueReference *r, size_t n, const int *v)
{
    return set(c, SET_BOOLEAN, r, n, v, 1);
}

EXPORTED int later_GetReal(Client *c, const fmi2ValueReference *r, size_t n, double *v)
{
    return later_get(c, GET_REAL, r, n, v);
}

EXPORTED int later_GetInteger(Client *c, const fmi2ValueReference *r, size_t n, int *v)
{
    return later_get(c, GET_INTEGER, r, n, v);
}

EXPORTED int later_GetBoolean(Client *c, const fmi2ValueReference *r, size_t n, int *v)
{
    return later_get(c, GET_BOOLEAN, r, n, v);
}

EXPORTED int later_DoStep(Client *c, double time, double step, int only_forward)
{
    int status;
    Operation *o = begin(c, DO_STEP, 0, &status);
    if (o == NULL)
        return status;
    o->real[0] = time;
    o->real[1] = step;
    o->whole[0] = (uint64_t)only_forward;
    if (c->n_read != c->n_learnt) /* they were not read again: the master has another plan */
        forget_reads(c);
    c->n_read = 0;
    for (uint32_t k = 0; k < c->n_learnt; k++) {
        Learnt *read = &c->learnt[k];
        Operation *get = add(c, read->kind, read->n * (sizeof *read->references + width(read->kind)) + 64);
        if (get == NULL) { /* the others are read one by one */
            while (c->n_learnt > k)
                free(c->learnt[--c->n_learnt].references);
            break;
        }
        get->count = read->n;
        get->first = reserve(c, read->n * sizeof *read->references);
        get->second = read->values = reserve(c, read->n * width(read->kind));
        memcpy(at(c, get->first), read->references, read->n * sizeof *read->references);
    }
    post(c);
    return c->n_learnt > 0 ? status : collect(c, c->step_ns);
}

/* ---- FMI 2.0 --------------------------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static int call(Client *c, Kind kind)
{
    int status;
    return begin(c, kind, 0, &status) == NULL ? status : perform(c, c->life_ns);
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
    Client *c = next_client;
    int status;
    (void)type;
    next_client = NULL;
    if (c == NULL)
        return NULL;
    const fmi2String texts[] = {name, guid, location, c->library};
    Operation *o = begin(c, INSTANTIATE, count_bytes(texts, 4), &status);
    if (o == NULL)
        return NULL;
    c->callbacks = callbacks;
    c->name = name;
    o->first = put_texts(c, texts, 4);
    o->whole[0] = (uint64_t)visible;
    o->whole[1] = (uint64_t)logging;
    forget_reads(c);
    return perform(c, c->life_ns) == fmi2OK ? c : NULL;
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
    Operation *o = begin(component, SETUP_EXPERIMENT, 0, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->whole[0] = (uint64_t)has_tolerance, o->whole[1] = (uint64_t)has_stop;
    o->real[0] = tolerance, o->real[1] = start, o->real[2] = stop;
    return (fmi2Status)perform(component, ((Client *)component)->life_ns);
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    int status;
    Client *c = component;
    Operation *o = begin(c, SET_DEBUG_LOGGING, count_bytes(categories, n), &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->whole[0] = (uint64_t)on;
    o->first = put_texts(c, categories, n);
    return (fmi2Status)perform(c, c->life_ns);
}

#define ACCESS(Type, TYPE)                                                                                             \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##Type v[])            \
    {                                                                                                                  \
        return (fmi2Status)set(c, SET_##TYPE, r, n, v, 0);                                                             \
    }                                                                                                                  \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##Type v[])                  \
    {                                                                                                                  \
        return (fmi2Status)get(c, GET_##TYPE, r, n, v, ((Client *)c)->step_ns);                                        \
    }
ACCESS(Real, REAL)
ACCESS(Integer, INTEGER)
ACCESS(Boolean, BOOLEAN)

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference r[], size_t n, const fmi2String v[])
{
    int status;
    Client *c = component;
    Operation *o = begin(c, SET_STRING, n * sizeof *r + count_bytes(v, n), &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->first = reserve(c, n * sizeof *r);
    memcpy(at(c, o->first), r, n * sizeof *r);
    o->second = put_texts(c, v, n);
    return (fmi2Status)perform(c, c->life_ns);
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
    Operation *o = begin(c, GET_STRING, n * sizeof *r + TEXT_BYTES, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->first = reserve(c, n * sizeof *r);
    memcpy(at(c, o->first), r, n * sizeof *r);
    o->size = TEXT_BYTES;
    const uint64_t place = o->third = reserve(c, TEXT_BYTES);
    status = perform(c, c->life_ns);
    return (fmi2Status)(status > fmi2Warning ? status : take_strings(c, place, TEXT_BYTES, n, v) | status);
}

/* `state` goes to the guest and comes back. */
static int exchange_state(Client *c, Kind kind, fmi2FMUstate *state, size_t *size, fmi2Byte *bytes, size_t n)
{
    int status;
    Operation *o = begin(c, kind, n, &status);
    if (o == NULL)
        return status;
    const uint32_t k = c->n_sent - 1;
    const uint64_t place = o->first = reserve(c, n);
    o->whole[0] = (uint64_t)(uintptr_t)*state;
    o->size = n;
    if (kind == DESERIALIZE_STATE)
        memcpy(at(c, place), bytes, n);
    status = perform(c, c->life_ns);
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
    Operation *o = begin(c, DIRECTIONAL_DERIVATIVE, (n + n_known) * (sizeof *known + sizeof *seed), &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->count = n;
    o->size = n_known;
    o->first = reserve(c, n * sizeof *unknown);
    o->second = reserve(c, n_known * sizeof *known);
    const uint64_t place = o->third = reserve(c, (n + n_known) * sizeof *seed);
    memcpy(at(c, o->first), unknown, n * sizeof *unknown);
    memcpy(at(c, o->second), known, n_known * sizeof *known);
    memcpy(at(c, o->third), seed, n_known * sizeof *seed);
    status = perform(c, c->life_ns);
    if (status <= fmi2Warning)
        memcpy(result, at(c, place + n_known * sizeof *seed), n * sizeof *result);
    return (fmi2Status)status;
}

/* Derivatives of inputs, or of outputs; `orders` and `values` have one number for each reference. */
static int exchange_derivatives(Client *c, Kind kind, const fmi2ValueReference *r, size_t n, const int *orders,
                                double *values)
{
    int status;
    Operation *o = begin(c, kind, n * (sizeof *r + sizeof *orders + sizeof *values), &status);
    if (o == NULL)
        return status;
    o->count = n;
    o->first = reserve(c, n * sizeof *r);
    o->second = reserve(c, n * sizeof *orders);
    const uint64_t place = o->third = reserve(c, n * sizeof *values);
    memcpy(at(c, o->first), r, n * sizeof *r);
    memcpy(at(c, o->second), orders, n * sizeof *orders);
    memcpy(at(c, place), values, n * sizeof *values);
    status = perform(c, c->life_ns);
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
    Operation *o = begin(c, DO_STEP, 0, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->real[0] = time, o->real[1] = step;
    o->whole[0] = (uint64_t)only_forward;
    return (fmi2Status)perform(c, ((Client *)c)->step_ns);
}

static int ask(Client *c, Kind kind, fmi2StatusKind what, void *answer, size_t bytes)
{
    int status;
    Operation *o = begin(c, kind, sizeof(double), &status);
    if (o == NULL)
        return status;
    o->whole[0] = (uint64_t)what;
    const uint64_t place = o->first = reserve(c, sizeof(double));
    status = perform(c, c->life_ns);
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
    Operation *o = begin(c, GET_STRING_STATUS, TEXT_BYTES, &status);
    if (o == NULL)
        return (fmi2Status)status;
    o->whole[0] = (uint64_t)what;
    o->size = TEXT_BYTES;
    const uint64_t place = o->third = reserve(c, TEXT_BYTES);
    status = perform(c, c->life_ns);
    return (fmi2Status)(status > fmi2Warning ? status : take_strings(c, place, TEXT_BYTES, 1, value) | status);
}

/* ---- the end --------------------------------------------------------------------------------------------------- */

/* Waiting for the guest was left by a jump (guard.c), or is to end now. */
EXPORTED void interrupt_isolated(Client *c)
{
    if (c->interrupts != NULL)
        *c->interrupts = 1;
    if (c->fate == ALIVE)
        end_guest(c, INTERRUPTED);
}

/* The guest ends, with all that it has started; its process is waited for by who started it. */
EXPORTED void end_isolated(Client *c)
{
    if (c->fate == ALIVE && add(c, QUIT, 0) != NULL)
        post(c);
}

/* Give back the client's own memory. */
EXPORTED void clear_client(Client *c)
{
    forget_reads(c);
    free(c->texts);
    c->texts = NULL;
}
