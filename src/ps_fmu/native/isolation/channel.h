/* What the master (client.c) and the process of one FMU (guest.c) share: memory, and two numbers to wait for.

   The master writes a batch of operations and counts `posted` up; the guest carries them out up to the first that fails,
   and makes `done` equal.  A batch is one exchange, however many calls of FMI it holds.  CALL is alone in its batch: a
   call that is not of a step, whose arguments and results go by a pipe (guest.py).

   The guest may write anything here.  The master reads statuses, values of a size that it knows, and texts that it ends
   itself; it keeps all counts and offsets in memory of its own. */
#ifndef CHANNEL_H
#define CHANNEL_H

#include <stdint.h>

enum { MOST_OPERATIONS = 64, LOG_BYTES = 1 << 15, LINE = 64 };

typedef enum {
    SET_REAL, SET_INTEGER, SET_BOOLEAN, GET_REAL, GET_INTEGER, GET_BOOLEAN, SET_DERIVATIVES, DO_STEP, CALL
} Kind;

/* A call of FMI.  The arrays of its arguments lie in `data`, each at a multiple of 8 bytes. */
typedef struct {
    uint32_t kind;
    int32_t status;  /* fmi2Status; of one that has not been carried out, -1 */
    uint64_t count;  /* of value references */
    uint64_t references, values, orders; /* where the arrays begin in `data` */
    double time, step;
    uint64_t only_forward;
} Operation;

/* What an FMU did to its process that no FMU may do. */
typedef enum { UNCHANGED, ROUNDING, DESCRIPTORS } Change;

typedef struct {
    uint32_t posted; /* by the master */
    char apart_1[LINE - sizeof(uint32_t)]; /* numbers that two processors write lie in lines of the cache of their own */
    uint32_t done; /* by the guest */
    char apart_2[LINE - sizeof(uint32_t)];
    uint32_t guest_sleeps, master_sleeps;
    uint32_t n_operations;
    uint32_t doing;    /* the operation under way */
    uint32_t changed;  /* a Change */
    uint32_t log_used; /* bytes of complete messages; each is its status, and the category and text as C strings */
    Operation operations[MOST_OPERATIONS];
    char log[LOG_BYTES];
    _Alignas(64) unsigned char data[];
} Channel;

#endif
