/* What a slave and the launcher share: the words of one instance, in memory that the slave owns. */
#ifndef PS_FMU_CORE_H
#define PS_FMU_CORE_H

#include <stdint.h>

#define CORE_MAGIC 0x31302d65726f63ull /* "core-01" */

/* Asked for the String variable of this value reference, a slave answers with the address of its core, in decimal; 0: it
   wants none.  No model description lists it. */
#define CORE_REFERENCE 2147483647u

/* What may be done with a value reference. */
enum { CORE_REAL = 1, CORE_INTEGER = 2, CORE_BOOLEAN = 4, CORE_SET = 8, CORE_EVENT = 16 };

/* What a plain step is. */
enum { CORE_NOTHING, CORE_MAP, CORE_TABLE };

/* The same as the class Core in core.py; all arrays belong to the slave.  Between two calls of the host each word has
   one writer: who makes the call. */
typedef struct Core {
    uint64_t magic;
    uint64_t size; /* of this structure, bytes */

    /* Variables.  A value reference is a place in `data`; Booleans and Integers are doubles there. */
    double *data;
    const uint8_t *kinds;     /* of each reference */
    const double *low, *high; /* what may be set, both finite */
    int64_t n_references;

    /* A plain step: target <- matrix source, or the next row of the table; then the limits, on all or none. */
    int64_t plain;
    const double *source;
    double *target;
    double *work;             /* (stride) */
    int64_t n_source, n_target;
    const double *matrix;     /* column by column; each padded with zeros to `stride` and on a cache line */
    int64_t stride;           /* a multiple of 8 */
    const double *table;      /* n_rows x n_target */
    int64_t n_rows;
    const double *lower, *upper; /* of the first n_limited of target */
    int64_t n_limited;           /* 0: there are none */
    int64_t limit_flag;          /* place in target that becomes 1 where one was met; -1: none */

    /* When a step is a plain one. */
    int64_t stepping;         /* the phase */
    int64_t pending;          /* an event is due */
    int64_t finishing;        /* the slave has more to do after each step */
    double time, step;        /* that are expected, s */
    double time_slack, step_slack, last_start; /* step_slack < 0: no step is a plain one */
    int64_t count;            /* steps of this size */
    int64_t block;            /* value of `count` at the first row of the table */

    int64_t native_steps, python_steps; /* since the instance was made */
    void *kernel;             /* bool (*)(Core *), put here by the launcher: the plain step */
} Core;

#endif
