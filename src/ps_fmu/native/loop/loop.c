/* The steps of a plan (../plan.py), which ../compiled.py hands over as one list of operations.

   Each step carries out the operations in order and stores a row of outputs.  What a status means, Python decides: the
   loop returns at the first that is not fmi2OK, and goes on behind that operation when it is called again. */

#include <stdint.h>
#include <string.h>
#include <time.h>

#include "effects.h"
#include "fmi2FunctionTypes.h"
#include "lines.h"

typedef enum {
    TAKE_DOUBLES,
    TAKE_INTS,
    SET_REALS,
    SET_INTEGERS,
    DO_STEP,
    GET_REALS,
    GET_INTEGERS,
    DO_SPAN,
    EXTEND,
    SET_DERIVATIVES,
    CHANGE_DOUBLES,
    CHANGE_INTS,
    SCALE_DOUBLES,
    LOOK_UP_INTS,
    FEED_DOUBLES,
    FEED_INTS,
    ASK_PYTHON
} Kind;

/* What is done with `count` numbers.  TAKE: values[i] = outputs[places[i]].  SET, GET: `places` are value references.
   DO_SPAN: a step over another time; `places` are the two doubles
   that say how much later than the step it begins, and how long it is [s].  EXTEND: `component` is the Lines of the
   values.  SET_DERIVATIVES: `outputs` are the orders.  CHANGE: `component` is the Effects of faults on the values.
   SCALE: `outputs` are a factor and an offset for each of `places`.  LOOK_UP: `places` are lines of three ints: the place
   of an input, a value, and what takes its place; the lines of an input stand together.  FEED: `component` is the Feed of
   the values at `places`.  ASK_PYTHON: the loop returns, and Python does it.  INTS and INTEGERS are Booleans, too: both are int in FMI 2.0. */
typedef struct {
    int64_t kind;
    int64_t count;
    const void *places;
    const void *outputs;
    void *values;
    void *component;
    union {
        fmi2SetRealTYPE *set_reals;
        fmi2SetIntegerTYPE *set_integers;
        fmi2DoStepTYPE *do_step;
        fmi2GetRealTYPE *get_reals;
        fmi2GetIntegerTYPE *get_integers;
        fmi2SetRealInputDerivativesTYPE *set_derivatives;
    } function;
} Operation;

typedef struct {
    const Operation *operations;
    int64_t n_operations;
    const double *latest; /* the outputs, which are the next row */
    int64_t columns;
    double step; /* s */
    const int64_t *ends; /* behind the last operation of each step, where steps that differ come in turn */
    int64_t phases;      /* that many; without `ends` 0 or 1 */
    /* Where it is. */
    int64_t rows_done;
    int64_t next_operation;
    int64_t phase;
    int64_t is_led; /* by Python, through one of them after the other: they store no rows */
} Loop;

/* Numbers for some places, (steps, places); those of the next step are in `row`. */
typedef struct {
    const double *samples;
    int64_t row;
} Feed;

static int64_t now_ns(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC_COARSE, &time); /* a few ms fine; 3 ns a call, the exact one 22 */
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static void take_doubles(const Operation *o)
{
    const int64_t *sources = o->places;
    const double *outputs = o->outputs;
    double *inputs = o->values;
    for (int64_t i = 0; i < o->count; i++)
        inputs[i] = outputs[sources[i]];
}

static void take_ints(const Operation *o)
{
    const int64_t *sources = o->places;
    const int *outputs = o->outputs;
    int *inputs = o->values;
    for (int64_t i = 0; i < o->count; i++)
        inputs[i] = outputs[sources[i]];
}

static void scale_doubles(const Operation *o)
{
    const int64_t *places = o->places;
    const double *numbers = o->outputs;
    double *inputs = o->values;
    for (int64_t i = 0; i < o->count; i++)
        inputs[places[i]] = inputs[places[i]] * numbers[2 * i] + numbers[2 * i + 1];
}

static void look_up_ints(const Operation *o)
{
    const int *lines = o->places;
    int *inputs = o->values, changed = -1;
    for (const int *line = lines; line < lines + 3 * o->count; line += 3)
        if (line[0] != changed && inputs[line[0]] == line[1]) {
            inputs[line[0]] = line[2];
            changed = line[0];
        }
}

static void feed(const Operation *o, int is_int)
{
    Feed *f = o->component;
    const int64_t *places = o->places;
    const double *samples = f->samples + o->count * f->row++;
    for (int64_t i = 0; i < o->count; i++)
        if (is_int)
            ((int *)o->values)[places[i]] = (int)samples[i];
        else
            ((double *)o->values)[places[i]] = samples[i];
}

static int carry_out(const Operation *o, double time, double step)
{
    size_t n = (size_t)o->count;
    switch ((Kind)o->kind) {
    case TAKE_DOUBLES:
        take_doubles(o);
        return fmi2OK;
    case TAKE_INTS:
        take_ints(o);
        return fmi2OK;
    case SET_REALS:
        return (int)o->function.set_reals(o->component, o->places, n, o->values);
    case SET_INTEGERS:
        return (int)o->function.set_integers(o->component, o->places, n, o->values);
    case DO_STEP: /* fmi2True: as in wires.py */
        return (int)o->function.do_step(o->component, time, step, fmi2True);
    case GET_REALS:
        return (int)o->function.get_reals(o->component, o->places, n, o->values);
    case GET_INTEGERS:
        return (int)o->function.get_integers(o->component, o->places, n, o->values);
    case EXTEND:
        extend(o->component, time);
        return fmi2OK;
    case SET_DERIVATIVES:
        return (int)o->function.set_derivatives(o->component, o->places, n, o->outputs, o->values);
    case DO_SPAN: {
        const double *span = o->places;
        return (int)o->function.do_step(o->component, time + span[0], span[1], fmi2True);
    }
    case CHANGE_DOUBLES:
        change_doubles(o->component, o->values);
        return fmi2OK;
    case CHANGE_INTS:
        change_ints(o->component, o->values);
        return fmi2OK;
    case SCALE_DOUBLES:
        scale_doubles(o);
        return fmi2OK;
    case LOOK_UP_INTS:
        look_up_ints(o);
        return fmi2OK;
    case FEED_DOUBLES:
    case FEED_INTS:
        feed(o, o->kind == FEED_INTS);
        return fmi2OK;
    case ASK_PYTHON:
        return fmi2Pending;
    }
    return fmi2Fatal;
}

/* Have the cache fetch the lines of a row before they are written: what is written waits in order for those, and numbers
   that are read while they wait may have to wait, too. */
static inline void expect_row(const double *row, size_t bytes)
{
    enum { LINE = 64 };
    for (size_t k = 0; k < bytes; k += LINE)
        __builtin_prefetch((const char *)row + k, 1);
}

/* Where the time goes, by operation; the entry after the last operation is the whole step. */
typedef struct {
    int64_t *spent_ns;
    int64_t *longest_ns;
    double *longest_at; /* s, where the step with the longest began */
    int64_t steps;
    int64_t unfinished_ns; /* of the step in which the loop returned, until it goes on there */
} Timing;

static int64_t read_clock_ns(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static void note(Timing *timing, int64_t place, int64_t spent_ns, double at)
{
    timing->spent_ns[place] += spent_ns;
    if (spent_ns > timing->longest_ns[place]) {
        timing->longest_ns[place] = spent_ns;
        timing->longest_at[place] = at;
    }
}

/* As run_steps; with `timing` it also notes what each operation takes.  Inlined into both, so that steps which are not
   timed do not ask. */
static inline int run(
    Loop *loop, double *rows, const double *times, int64_t end, double budget, const volatile int *stop, Timing *timing)
{
    const size_t row_bytes = (size_t)loop->columns * sizeof(double);
    const int64_t until = now_ns() + (int64_t)(budget * 1e9);
    int64_t first = loop->phase > 0 ? loop->ends[loop->phase - 1] : 0;
    int64_t last = loop->phases > 1 ? loop->ends[loop->phase] : loop->n_operations;
    while (loop->rows_done < end) {
        if (loop->next_operation == first && (*stop || now_ns() > until))
            return fmi2OK;
        const double time = times[loop->rows_done];
        double *row = rows + loop->rows_done * loop->columns;
        expect_row(row, loop->is_led ? 0 : row_bytes);
        const int64_t began = timing ? read_clock_ns() : 0;
        int64_t before = began;
        if (timing && loop->next_operation == first)
            timing->unfinished_ns = 0;
        while (loop->next_operation < last) {
            const Operation *operation = &loop->operations[loop->next_operation++];
            int status = carry_out(operation, time, loop->step);
            if (timing) {
                int64_t after = read_clock_ns();
                note(timing, loop->next_operation - 1, after - before, time);
                before = after;
            }
            if (status != fmi2OK) {
                if (timing)
                    timing->unfinished_ns += before - began;
                return status;
            }
        }
        if (!loop->is_led)
            memcpy(row, loop->latest, row_bytes);
        if (loop->phases > 1) {
            first = loop->phase + 1 < loop->phases ? last : 0;
            loop->phase = loop->phase + 1 < loop->phases ? loop->phase + 1 : 0;
            last = loop->ends[loop->phase];
        }
        loop->next_operation = first;
        loop->rows_done++;
        if (timing && !loop->is_led) {
            note(timing, loop->n_operations, timing->unfinished_ns + read_clock_ns() - began, time);
            timing->steps++;
        }
    }
    return fmi2OK;
}

/* Run steps until `rows_done` is `end`; row i is that of the step from times[i].  Returns fmi2OK there, and early,
   between two steps, after `budget` seconds or once *stop is not zero; else the status of the operation before
   `next_operation`. */
__attribute__((visibility("default"))) int run_steps(
    Loop *loop, double *rows, const double *times, int64_t end, double budget, const volatile int *stop)
{
    return run(loop, rows, times, end, budget, stop, NULL);
}

/* The same, timed. */
__attribute__((visibility("default"))) int run_timed_steps(
    Loop *loop, double *rows, const double *times, int64_t end, double budget, const volatile int *stop, Timing *timing)
{
    return run(loop, rows, times, end, budget, stop, timing);
}
