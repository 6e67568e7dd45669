#include "effects.h"

#define EXPORTED __attribute__((visibility("default"))) /* for values that no exchange carries */

enum { BEGAN, LAST, FIRST }; /* places in the memory */

static double hold(const Effect *e, double number, int64_t step, int64_t row)
{
    double *memory = e->memory;
    if (memory[BEGAN] < 0.0) {
        memory[BEGAN] = (double)step;
        memory[FIRST] = number;
    } else if (e->samples && e->samples[row] == 0.0)
        memory[FIRST] = number;
    return memory[FIRST];
}

static double delay(const Effect *e, double number, int64_t step)
{
    double *memory = e->memory;
    const int64_t size = e->length + 1;
    if (memory[BEGAN] < 0.0)
        memory[BEGAN] = (double)step;
    if (memory[LAST] < (double)step) { /* no part of a step that is repeated in smaller ones */
        memory[LAST] = (double)step;
        memory[FIRST + step % size] = number;
    }
    const int64_t began = (int64_t)memory[BEGAN], from = step - e->length;
    return memory[FIRST + (from > began ? from : began) % size];
}

static double change(const Effect *e, double number, int64_t step, int64_t row)
{
    switch ((EffectKind)e->kind) {
    case OVERRIDE:
        return e->value;
    case BIAS:
        return number + e->value;
    case SCALE:
        return number * e->value;
    case ADD:
        return number + e->samples[row];
    case REPLACE_LOST:
        return e->samples[row] != 0.0 ? e->value : number;
    case HOLD:
        return hold(e, number, step, row);
    case DELAY:
        return delay(e, number, step);
    }
    return number;
}

static int to_int(double number)
{
    if (!(number > INT32_MIN)) /* or it is no number */
        return INT32_MIN;
    return number < INT32_MAX ? (int)number : INT32_MAX;
}

EXPORTED void change_doubles(Effects *group, double *inputs)
{
    for (const Effect *e = group->effects; e < group->effects + group->count; e++)
        inputs[e->place] = change(e, inputs[e->place], group->step, group->row);
    group->step++;
    group->row++;
}

EXPORTED void change_ints(Effects *group, int *inputs)
{
    for (const Effect *e = group->effects; e < group->effects + group->count; e++)
        inputs[e->place] = to_int(change(e, inputs[e->place], group->step, group->row));
    group->step++;
    group->row++;
}
