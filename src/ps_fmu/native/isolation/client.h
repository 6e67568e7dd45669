/* The master's side of an isolated FMU, for the files that share it: client.c (the exchange) and later.c (the calls of
   the steps).

   An operation is added to the batch with `begin_operation`, its data are put into places of `reserve_place`, and the
   batch is carried out by `perform_batch`. */
#ifndef CLIENT_H
#define CLIENT_H

#include <stdint.h>

#include "channel.h"
#include "fmi2FunctionTypes.h"
#include "waiting.h"

enum { MOST_LEARNT = 32 };

typedef enum { ALIVE, KILLED, EXITED, HANGS, INTERRUPTED } Fate;

/* A read that follows each step. */
typedef struct {
    Kind kind;
    size_t n;
    fmi2ValueReference *references;
    uint64_t values; /* where the guest puts them */
} Learnt;

/* Functions of the interpreter, to see whether Ctrl-C ends waiting: the first has been taken by the master. */
typedef struct {
    int (*lock)(void);
    void (*unlock)(int state);
    int (*check_signals)(void); /* -1: what handles a signal has raised an exception */
    void (*clear)(void);        /* which is forgotten */
} Python;

typedef struct {
    /* Set by the master's Python, see guest_process.py. */
    Channel *channel;
    uint64_t data_bytes;
    int64_t guest;              /* process */
    int64_t spin_ns;
    int64_t step_ns;            /* how long to wait for the calls of a step; 0: for ever */
    Python python;
    const fmi2CallbackFunctions *callbacks;
    fmi2String name;
    /* What became of the guest. */
    int64_t fate, fate_number;
    /* Own. */
    Operation sent[MOST_OPERATIONS];
    uint32_t n_sent, number;
    Patience patience;
    uint64_t used;
    fmi2Boolean under_way, complete;
    Learnt learnt[MOST_LEARNT];
    uint32_t n_learnt, n_read;
} Client;

#define EXPORTED __attribute__((visibility("default")))

/* ---- client.c -------------------------------------------------------------------------------------------------- */

/* Wait for the batch under way; its status: the first above fmi2Warning, or the highest. */
EXPORTED int collect_batch(Client *c, int64_t patience_ns);

/* Wait for the batch under way, if there is one. */
int settle_batch(Client *c);

/* Hand the batch to the guest, without waiting for it. */
void post_batch(Client *c);

/* Hand the batch to the guest, and wait for it. */
int perform_batch(Client *c, int64_t patience_ns);

/* Room for an operation with so many bytes of data in the batch; NULL if there is none. */
Operation *add_operation(Client *c, Kind kind, uint64_t bytes);

/* As `add_operation`; a full batch is carried out first. */
Operation *begin_operation(Client *c, Kind kind, uint64_t bytes, int *status);

/* Set values with the next operation that is carried out. */
int set_values(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, const void *values);

int get_values(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, void *values);

static inline uint64_t reserve_place(Client *c, uint64_t bytes)
{
    const uint64_t place = c->used;
    c->used += (bytes + 7) / 8 * 8;
    return place;
}

/* A place for the data of an operation; it is checked when the operation is complete. */
static inline void *at(Client *c, uint64_t place) { return c->channel->data + place; }

static inline size_t width(Kind kind)
{
    return kind == SET_REAL || kind == GET_REAL || kind == SET_DERIVATIVES ? sizeof(double) : sizeof(int);
}

/* ---- later.c --------------------------------------------------------------------------------------------------- */

/* Forget which reads follow a step; so all of the client's own memory is given back. */
EXPORTED void forget_reads(Client *c);

#endif
