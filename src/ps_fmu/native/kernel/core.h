/* What a slave and the launcher share: the words of one instance, in memory that the slave owns. */
#ifndef PS_FMU_CORE_H
#define PS_FMU_CORE_H

#include <stdint.h>

#define CORE_MAGIC 0x30312d65726f63ull /* "core-10" */

/* A function or table that Python finds in a library by its name. */
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Asked for the String variable of this value reference, a slave answers with the address of its core, in decimal; 0: it
   wants none.  No model description lists it. */
#define CORE_REFERENCE 2147483647u

/* Asked for this String, a slave renews the linear model in its core. */
#define LINEAR_REFERENCE 2147483646u

/* What may be done with a value reference. */
enum { CORE_REAL = 1, CORE_INTEGER = 2, CORE_BOOLEAN = 4, CORE_SET = 8, CORE_EVENT = 16 };

/* An event is due: by a call of the host or of the slave, or because an element has found it before the map. */
enum { CORE_DUE = 1, CORE_FOUND_DUE = 2 };

/* What a plain step is. */
enum { CORE_NOTHING, CORE_MAP };

/* What an element of a step does; elements.py says it in full. */
enum {
    ELEMENT_SAMPLE = 1,
    ELEMENT_RAMP,
    ELEMENT_PRODUCT,
    ELEMENT_LINEAR,
    ELEMENT_CLIP,
    ELEMENT_EXCESS,
    ELEMENT_SINE,
    ELEMENT_QUANTISE,
    ELEMENT_HOLD,
    ELEMENT_DELAY,
    ELEMENT_WATCH,
    ELEMENT_COUNT,
    ELEMENT_SPARSE,
    ELEMENT_CALL
};

/* `n_source` of a WATCH whose sources, and seconds, lie side by side; of a QUANTISE whose targets do, if no resolution
   is 0. */
enum { NEIGHBOURS = 1 };

/* What a DELAY keeps, from its `clock` on: the newest row of its ring; the row that it puts out; how long ago that one's
   values were taken, and the newest ones, s.  Then its `n_source` rows: how long after the last row's values its own were
   taken, s, and the n values. */
enum { DELAY_NEWEST, DELAY_OUT, DELAY_AGE, DELAY_NEWEST_AGE, DELAY_RING };

typedef struct Core Core;

/* What a function returns that is an element of a step: the step is refused, and changes nothing; it goes on; it is
   complete: neither maps nor further elements follow, but the limits still hold. */
enum { CALL_REFUSED, CALL_DONE, CALL_FINISHED };

/* A step as a function.  It reads `data` and the words of the core for the time, and writes those of its places in `data`
   that are its element's targets; the kernel asks whether they are finite.  `arguments`: constants, and caches that
   are functions of constants and of `data`.  It may leave a message (write_message). */
typedef int64_t Function(void *arguments, Core *core);

/* What a message is. */
enum { MESSAGE_NONE, MESSAGE_WARNING, MESSAGE_REFUSAL = 3 };

/* The same as the class Instruction in instructions.py.  Lists of places are places in `data`. */
typedef struct Element {
    int64_t kind, n;          /* n: length of `target`, and of the lists that go with it element by element */
    const int64_t *source, *second, *target;
    const double *low, *high; /* constants, n each */
    const double *matrix;     /* n_source columns of `stride`, as that of the map; SPARSE: n rows of n_source */
    int64_t stride, n_source;
    int64_t clock;            /* place of a clock, a flag, or what a DELAY keeps */
    double time;              /* period or delay, s */
    Function *function;       /* CALL */
    void *arguments;
} Element;

/* Numbers side by side in `data`. */
typedef struct Span {
    int64_t place, n;
} Span;

/* Rows of a matrix, from `row` on, with the columns in which any of them is not zero.  blocks.py chooses them. */
typedef struct Block {
    int64_t row, n_rows;       /* n_rows: a multiple of 8; those beyond the matrix are zero */
    int64_t column, n_columns; /* its part of the map's `columns` */
    int64_t number;            /* its part of the map's `numbers`: column by column, n_rows each */
} Block;

/* target <- matrix source.  The blocks cover all rows, once. */
typedef struct Map {
    const double *source;
    double *target, *work;     /* work: (n_target), padded as the blocks are */
    int64_t n_target, n_blocks;
    const Block *blocks;
    const int32_t *columns;    /* places in `source`; rising in each block */
    const double *numbers;     /* on a cache line */
} Map;

enum { MOST_MAPS = 2 };

/* The same as the class Core in core.py; all arrays belong to the slave.  Between two calls of the host each word has
   one writer: who makes the call. */
struct Core {
    uint64_t magic;
    uint64_t size; /* of this structure, bytes */

    /* Variables.  A value reference is a place in `data`; Booleans and Integers are doubles there. */
    double *data;
    const uint8_t *kinds;     /* of each reference */
    const double *low, *high; /* what may be set, both finite */
    int64_t n_references;

    /* A plain step: the elements before the map; the maps, one after the other (each reads what those before it have
       written); the elements after it; then the limits, on all or none. */
    int64_t plain;
    double *target;
    int64_t n_target;
    Map maps[MOST_MAPS];
    int64_t n_maps;
    const Element *before, *after;
    int64_t n_before, n_after;
    const Span *spans;        /* what the elements write, but for `target` and rings */
    int64_t n_spans;
    Span *kept_spans;         /* room for all that a step writes, to undo it: where, and what was there */
    double *kept_values;
    double *scratch;          /* for the largest LINEAR: its result, then its operand; for the result of a SPARSE */
    const double *lower, *upper; /* of the first n_limited of target */
    int64_t n_limited;           /* 0: there are none */
    int64_t limit_flag;          /* place in target that becomes 1 where one was met; -1: none */

    /* When a step is a plain one. */
    int64_t stepping;         /* the phase */
    int64_t pending;          /* an event is due; 0: none is */
    int64_t watching;         /* a WATCH before the map calls for an event; 0: it has just been */
    double time, step;        /* that are expected, s */
    double time_slack, step_slack, last_start; /* step_slack < 0: no step is a plain one */
    int64_t count;            /* steps of this size */

    int64_t native_steps, python_steps; /* since the instance was made */

    /* For steps of any size. */
    int64_t any_step;         /* elements and maps are the same for each size: another one needs no Python */
    double origin, stop;      /* where steps of this size began, and the stop time, s */

    /* From a CALL of the step to the host: a warning, or why a step is refused. */
    int64_t message_status;
    char message[512];        /* UTF-8 */
    const char *label;        /* of the instance, before its messages */

    /* For directional derivatives: the matrix [A B; C D] by columns, of n_rates + n_outputs numbers each.  States are the first
       n_rates places behind the outputs, which begin at 0; their rates are the value references from `first_rate` on. */
    const double *linear;     /* NULL: there is none */
    int64_t linear_holds;     /* it is the same whatever the state is */
    int64_t n_rates, first_rate, n_outputs, first_input, n_inputs;
};

/* Two statements of one size of steps differ by no more than this, relatively: hosts form them as differences. */
#define SAME_STEP 1e-6

#endif
