/* The exchange with an FMU that lives in a process of its own (guest.c): batches of operations, the wait for them, and
   what became of the guest. */

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "client.h"

enum { SLICE_NS = 20000000 };

EXPORTED uint64_t channel_bytes(void) { return sizeof(Channel); }
EXPORTED uint64_t client_bytes(void) { return sizeof(Client); }

/* An operation of the last batch, as the master's Python reads it.  For fmi2DoStep `time` is where it begins [s]. */
typedef struct {
    int32_t kind, status;
    uint64_t count; /* of the value references */
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
    outcome->references = (const void *)(client->channel->data + o->references);
    outcome->time = o->time;
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

EXPORTED void end_guest(Client *c, int fate)
{
    c->fate = fate;
    kill(-(pid_t)c->guest, SIGKILL); /* with the processes that it has started */
}

/* In the main thread Python handles signals now. */
static int is_interrupted(const Python *python)
{
    const int state = python->lock();
    const int raised = python->check_signals() != 0;
    if (raised)
        python->clear();
    python->unlock(state);
    return raised;
}

/* Whether the guest has carried out the batch. */
static int await(Client *c, int64_t patience_ns)
{
    uint32_t *done = &c->channel->done;
    if (spin(done, c->number, c->spin_ns, &c->patience))
        return 1;
    const int64_t until = now_ns() + patience_ns;
    for (int slices = 0;; slices++) {
        const uint32_t now = __atomic_load_n(done, __ATOMIC_ACQUIRE);
        if (now == c->number)
            return 1;
        if (has_ended(c)) /* perhaps just after its work */
            return __atomic_load_n(done, __ATOMIC_ACQUIRE) == c->number && (c->fate = ALIVE, 1);
        if (slices > 0 && is_interrupted(&c->python))
            return end_guest(c, INTERRUPTED), 0;
        if (patience_ns > 0 && now_ns() > until)
            return end_guest(c, HANGS), 0;
        sleep_on(done, now, &c->channel->master_sleeps, SLICE_NS);
    }
}

void post_batch(Client *c)
{
    Channel *shared = c->channel;
    memcpy(shared->operations, c->sent, c->n_sent * sizeof *c->sent);
    shared->n_operations = c->n_sent;
    shared->doing = 0;
    c->under_way = 1;
    tell(&shared->posted, ++c->number, &shared->guest_sleeps);
}

int collect_batch(Client *c, int64_t patience_ns)
{
    c->under_way = 0;
    c->complete = 1;
    const int alive = c->fate == ALIVE && await(c, patience_ns);
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

int settle_batch(Client *c)
{
    return c->under_way ? collect_batch(c, c->step_ns) : fmi2OK;
}

/* ---- batches --------------------------------------------------------------------------------------------------- */

Operation *add_operation(Client *c, Kind kind, uint64_t bytes)
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

int perform_batch(Client *c, int64_t patience_ns)
{
    post_batch(c);
    return collect_batch(c, patience_ns);
}

Operation *begin_operation(Client *c, Kind kind, uint64_t bytes, int *status)
{
    *status = c->fate == ALIVE ? settle_batch(c) : fmi2Fatal;
    if (*status > fmi2Warning)
        return NULL;
    Operation *o = add_operation(c, kind, bytes + 64);
    if (o != NULL)
        return o;
    if (c->n_sent > 0 && (*status = perform_batch(c, c->step_ns)) > fmi2Warning)
        return NULL;
    o = add_operation(c, kind, bytes + 64);
    if (o == NULL)
        *status = fmi2Error;
    return o;
}

static Operation *begin_access(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, int *status)
{
    Operation *o = begin_operation(c, kind, n * (sizeof *references + width(kind)), status);
    if (o == NULL)
        return NULL;
    o->count = n;
    o->references = reserve_place(c, n * sizeof *references);
    o->values = reserve_place(c, n * width(kind));
    memcpy(at(c, o->references), references, n * sizeof *references);
    return o;
}

int set_values(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, const void *values)
{
    int status;
    Operation *o = begin_access(c, kind, references, n, &status);
    if (o != NULL)
        memcpy(at(c, o->values), values, n * width(kind));
    return status;
}

int get_values(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, void *values)
{
    int status;
    Operation *o = begin_access(c, kind, references, n, &status);
    if (o == NULL)
        return status;
    const uint64_t place = o->values;
    status = perform_batch(c, c->step_ns);
    if (status <= fmi2Warning)
        memcpy(values, at(c, place), n * width(kind));
    return status;
}

/* ---- calls by the pipe ----------------------------------------------------------------------------------------- */

/* Carry out what is put off; returns the status of that. */
EXPORTED int flush_batch(Client *c)
{
    if (c->fate != ALIVE)
        return fmi2Fatal;
    if (c->under_way)
        return settle_batch(c);
    return c->complete || c->n_sent == 0 ? fmi2OK : perform_batch(c, c->step_ns);
}

/* The guest looks at the pipe; collect_batch waits for the call.  Nothing is put off. */
EXPORTED void begin_call(Client *c)
{
    if (c->n_read != c->n_learnt) { /* what the guest has read ahead may change now */
        forget_reads(c);
        c->n_read = 0;
    }
    add_operation(c, CALL, 0);
    post_batch(c);
}
