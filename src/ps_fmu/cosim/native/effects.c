#include "effects.h"

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

static double hold_line(const Effect *e, double number, double *slope, const Effects *group)
{
    double *memory = e->memory;
    const int comes = e->samples && e->samples[group->row] == 0.0, begins = memory[BEGAN] < 0.0;
    if (begins)
        memory[BEGAN] = (double)group->step;
    if (comes) {
        memory[FIRST] = *slope != 0.0 ? number + *slope * group->length : number;
        return number;
    }
    if (begins)
        memory[FIRST] = number;
    *slope = 0.0;
    return memory[FIRST];
}

static double delay_line(const Effect *e, double number, double *slope, const Effects *group)
{
    double *memory = e->memory, *values = memory + FIRST, *slopes = values + e->length + 1;
    const int64_t size = e->length + 1, step = group->step, from = step - e->length;
    if (memory[BEGAN] < 0.0)
        memory[BEGAN] = (double)step;
    if (memory[LAST] < (double)step) { /* no part of a step that is made again */
        memory[LAST] = (double)step;
        values[step % size] = number;
        slopes[step % size] = *slope;
    }
    if ((double)from < memory[BEGAN]) {
        *slope = 0.0;
        return values[(int64_t)memory[BEGAN] % size];
    }
    *slope = slopes[from % size];
    return group->begin != 0.0 ? values[from % size] + *slope * group->begin : values[from % size];
}

static double change_line(const Effect *e, double number, double *slope, const Effects *group)
{
    if (e->kind == HOLD)
        return hold_line(e, number, slope, group);
    if (e->kind == DELAY)
        return delay_line(e, number, slope, group);
    if (e->kind == SCALE)
        *slope *= e->value;
    else if (e->kind == OVERRIDE || (e->kind == REPLACE_LOST && e->samples[group->row] != 0.0))
        *slope = 0.0;
    return change(e, number, group->step, group->row);
}

static int to_int(double number)
{
    if (!(number > INT32_MIN)) /* or it is no number */
        return INT32_MIN;
    return number < INT32_MAX ? (int)number : INT32_MAX;
}

void change_doubles(Effects *group, double *inputs)
{
    for (const Effect *e = group->effects; e < group->effects + group->count; e++)
        inputs[e->place] = change(e, inputs[e->place], group->step, group->row);
    group->step++;
    group->row++;
}

void change_ints(Effects *group, int *inputs)
{
    for (const Effect *e = group->effects; e < group->effects + group->count; e++)
        inputs[e->place] = to_int(change(e, inputs[e->place], group->step, group->row));
    group->step++;
    group->row++;
}

void change_lines(Effects *group, double *inputs)
{
    for (const Effect *e = group->effects; e < group->effects + group->count; e++)
        inputs[e->place] = change_line(e, inputs[e->place], &group->slopes[e->place], group);
    group->step++;
    group->row++;
}
