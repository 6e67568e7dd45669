/* Inputs that go on along lines within a step (../schemes/history.py). */
#ifndef LINES_H
#define LINES_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* Some inputs of a component, in a part of its step.  Times are in s. */
typedef struct {
    int64_t count;
    int64_t smoothed;    /* lines begin where the last ones ended */
    double start, step;  /* of the simulation; the base step */
    double length;       /* of the component's step */
    double offset, part; /* where the part begins, and how long it is */
    const int64_t *places;
    const int64_t *held; /* 1: the input keeps the gathered value */
    const int64_t *periods, *ahead; /* base steps between two values of the source; 1: it has made this one already */
    double *values;                 /* all gathered inputs; those at `places` are replaced */
    double *slopes;                 /* for FMUs that interpolate; NULL: they get the mean */
    double *memory; /* by rows: time and value of the last sample but one, of the last, and where the last line ended */
    const double *first; /* values where the first step begins */
    double *begin, *slope;
} Lines;

/* Find the lines of the step from `now` on. */
static void look(const Lines *l, double now)
{
    const int64_t n = l->count, index = (int64_t)nearbyint((now - l->start) / l->step);
    double *before = l->memory, *earlier = before + n, *last = earlier + n, *latest = last + n, *end = latest + n;
    for (int64_t k = 0; k < n; k++) {
        const int64_t period = l->periods[k];
        const double time = l->start + (double)(period * ((index + l->ahead[k]) / period)) * l->step;
        if (isnan(last[k])) {
            last[k] = now;
            latest[k] = l->first[k];
        }
        if (time > last[k] + 0.25 * l->step) {
            before[k] = last[k];
            earlier[k] = latest[k];
            last[k] = time;
        }
        latest[k] = l->values[l->places[k]];
        l->slope[k] = isnan(before[k]) ? 0.0 : (latest[k] - earlier[k]) / (last[k] - before[k]);
        l->begin[k] = latest[k] + l->slope[k] * (now - last[k]);
        if (l->smoothed) {
            const double goal = l->begin[k] + l->slope[k] * l->length;
            if (!isnan(end[k]))
                l->begin[k] = end[k];
            l->slope[k] = (goal - l->begin[k]) / l->length;
            end[k] = goal;
        }
    }
}

/* Replace the gathered values, which are those of the sources now.  A call of its own: the loop stays as small as it is
   for inputs that are held. */
static __attribute__((noinline)) void extend(const Lines *l, double now)
{
    double shift = l->offset;
    if (shift == 0.0)
        look(l, now);
    if (l->slopes == NULL)
        shift += 0.5 * l->part;
    for (int64_t k = 0; k < l->count; k++) {
        if (!l->held[k])
            l->values[l->places[k]] = l->begin[k] + shift * l->slope[k];
        if (l->slopes != NULL)
            l->slopes[k] = l->held[k] ? 0.0 : l->slope[k];
    }
}

#endif
