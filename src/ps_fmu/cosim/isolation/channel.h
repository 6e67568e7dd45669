/* What the master (client.c) and the process of one FMU (guest.c) share: memory, and two numbers to wait for.

   The master writes a batch of operations and counts `posted` up; the guest carries them out up to the first that fails,
   and makes `done` equal.  A batch is one exchange, however many calls of FMI it holds.

   The guest may write anything here.  The master reads statuses, values of a size that it knows, and texts that it ends
   itself; it keeps all counts and offsets in memory of its own. */
#ifndef CHANNEL_H
#define CHANNEL_H

#include <stdint.h>

enum { MOST_OPERATIONS = 64, LOG_BYTES = 1 << 15, LINE = 64 };

typedef enum {
    INSTANTIATE, FREE_INSTANCE, SET_DEBUG_LOGGING, SETUP_EXPERIMENT, ENTER_INITIALIZATION, EXIT_INITIALIZATION, TERMINATE,
    RESET, SET_REAL, SET_INTEGER, SET_BOOLEAN, SET_STRING, GET_REAL, GET_INTEGER, GET_BOOLEAN, GET_STRING, DO_STEP,
    CANCEL_STEP, GET_STATE, SET_STATE, FREE_STATE, STATE_SIZE, SERIALIZE_STATE, DESERIALIZE_STATE, DIRECTIONAL_DERIVATIVE,
    SET_INPUT_DERIVATIVES, GET_OUTPUT_DERIVATIVES, GET_STATUS, GET_REAL_STATUS, GET_INTEGER_STATUS, GET_BOOLEAN_STATUS,
    GET_STRING_STATUS, QUIT, N_KINDS
} Kind;

/* A call of FMI.  The arrays of its arguments lie in `data`, each at a multiple of 8 bytes. */
typedef struct {
    uint32_t kind;
    int32_t status;       /* fmi2Status; of one that has not been carried out, -1 */
    uint64_t count, size; /* of values; of the second array or a buffer */
    uint64_t first, second, third; /* where the arrays begin in `data` */
    double real[3];
    uint64_t whole[3];
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
