/* The elements that have times of their own: samples and delays. */
#include "elements.h"

#include <math.h>
#include <stddef.h>

/* Each operation rounds, as in kernel.c. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

/* Copy numbers, one after the other; 0 if one is not finite: a state may have been made up. */
static int move(double *data, const int64_t *target, const int64_t *source, int64_t n)
{
    int finite = 1;
    ONE_BY_ONE
    for (int64_t k = 0; k < n; k++) {
        const double value = data[source[k]];
        data[target[k]] = value;
        finite &= is_finite(value);
    }
    return finite;
}

/* The part of a period that a step is, and how much of a period is rounding. */
typedef struct {
    double part, slack;
} Tick;

static Tick make_tick(const Element *e, double step)
{
    const double part = step / e->time;
    return (Tick){part, 1e-6 * (part < 1.0 ? part : 1.0) + 1e-9};
}

/* A clock after a step: the part of a period since the last whole one. */
static double next_tick(double clock, Tick by)
{
    const double next = clock + by.part, left = next - floor(next + by.slack);
    return left > by.slack ? left : 0.0;
}

/* Whether a period ends before the end of the step, or just at its start. */
bool run_sample(Run *run, const Element *e)
{
    double *data = run->data;
    const Tick by = make_tick(e, run->core->step);
    const double clock = data[e->clock];
    int finite = 1;
    if (clock == 0.0 || clock + by.part > 1.0 + by.slack)
        finite = move(data, e->target, e->source, e->n);
    data[e->clock] = next_tick(clock, by);
    return finite & is_finite(data[e->clock]);
}

/* Whether a period ends after the start of the step, or just at its end. */
bool run_hold(Run *run, const Element *e)
{
    double *data = run->data;
    const Tick by = make_tick(e, run->core->step);
    const double clock = data[e->clock];
    if (clock + by.part >= 1.0 - by.slack)
        move(data, e->second, e->target, e->n);
    const int finite = move(data, e->target, e->second, e->n);
    data[e->clock] = next_tick(clock, by);
    return finite & is_finite(data[e->clock]);
}

static bool is_row(double row, int64_t rows)
{
    return row >= 0.0 && row < (double)rows;
}

/* How long before the end of the step the values of a delay were taken: at its end; of samples, at the last one, but not
   before the start.  `low`: periods since then where the clock is 0. */
static double find_age(const double *data, const Element *e, double step)
{
    if (e->source == NULL)
        return 0.0;
    const double clock = data[e->source[0]], since = (clock > 0.0 ? clock : e->low[0]) * e->high[0];
    return since < step ? since : step;
}

/* False: the ring is full, or kept numbers are impossible, as those of a state may be that was made up. */
bool run_delay(Run *run, const Element *e)
{
    const double step = run->core->step, slack = 1e-6 * step + 1e-9 * e->time;
    double *data = run->data, *kept = data + e->clock, *ring = kept + DELAY_RING;
    const int64_t rows = e->n_source, n = e->n, width = n + 1;
    if (!(is_row(kept[DELAY_NEWEST], rows) && is_row(kept[DELAY_OUT], rows)))
        return false;
    int64_t newest = (int64_t)kept[DELAY_NEWEST] + 1, out = (int64_t)kept[DELAY_OUT];
    newest = newest < rows ? newest : 0;
    bool full = newest == out; /* the newest row takes the place of the one put out so far */
    const double age = find_age(data, e, step);
    double *row = ring + newest * width, age_out = kept[DELAY_AGE] + step;
    run_keep(run, row - data, width);
    row[0] = step - age + kept[DELAY_NEWEST_AGE];
    for (int64_t k = 0; k < n; k++)
        row[k + 1] = data[e->target[k]];
    while (full || out != newest) {
        const int64_t next = out + 1 < rows ? out + 1 : 0;
        const double age_next = age_out - ring[next * width];
        if (!(age_next >= e->time - slack))
            break;
        out = next;
        age_out = age_next;
        full = false;
    }
    if (full)
        return false;
    const double *late = ring + out * width;
    int finite = is_finite(age_out) & is_finite(row[0]);
    for (int64_t k = 0; k < n; k++) {
        const double delayed = late[k + 1];
        data[e->target[k]] = delayed;
        finite &= is_finite(row[k + 1]) & is_finite(delayed);
    }
    kept[DELAY_NEWEST] = (double)newest;
    kept[DELAY_OUT] = (double)out;
    kept[DELAY_AGE] = age_out;
    kept[DELAY_NEWEST_AGE] = age;
    return finite;
}
