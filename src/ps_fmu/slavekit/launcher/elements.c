#include "elements.h"

#include <math.h>
#include <stddef.h>

/* Each operation rounds, as in kernel.c. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

void run_put(Run *run, int64_t place, double value)
{
    const int64_t n = run->n_undo++;
    run->places[n] = place;
    run->values[n] = run->data[place];
    run->data[place] = value;
}

void run_undo(Run *run, int64_t n)
{
    while (run->n_undo > n) {
        run->n_undo--;
        run->data[run->places[run->n_undo]] = run->values[run->n_undo];
    }
}

/* Write the result k of an element; not finite: false. */
static bool put(Run *run, int64_t place, double value)
{
    run_put(run, place, value);
    return isfinite(value);
}

/* Do one thing for each k; the step is refused where a result is not finite. */
#define FOR_EACH(n, expression)                                                                                        \
    for (int64_t k = 0; k < (n); k++)                                                                                  \
        if (!(expression))                                                                                             \
    return false

static double clip(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* A clock that begins again after `steps`. */
static double next_tick(double clock, int64_t steps)
{
    double next = clock + 1.0;
    return next > (double)steps - 0.5 ? 0.0 : next;
}

static bool sample(Run *run, const Element *e)
{
    double *data = run->data;
    if (data[e->clock] == 0.0)
        FOR_EACH(e->n, put(run, e->target[k], data[e->source[k]]));
    return put(run, e->clock, next_tick(data[e->clock], e->steps));
}

static bool hold(Run *run, const Element *e)
{
    double *data = run->data;
    double clock = next_tick(data[e->clock], e->steps);
    if (clock == 0.0)
        FOR_EACH(e->n, put(run, e->second[k], data[e->target[k]]));
    FOR_EACH(e->n, put(run, e->target[k], data[e->second[k]]));
    return put(run, e->clock, clock);
}

static bool ramp(Run *run, const Element *e)
{
    double *data = run->data;
    FOR_EACH(e->n, put(run, e->target[k],
                       clip((data[e->source[k]] - data[e->second[k]]) / run->core->step, e->low[k], e->high[k])));
    return true;
}

static bool linear(Run *run, const Element *e)
{
    double *data = run->data, *w = run->core->scratch, *x = w + e->stride;
    for (int64_t j = 0; j < e->n_source; j++)
        x[j] = data[e->source[j]];
    if (!run->by->product(e->matrix, e->stride, x, e->n_source, w))
        return false;
    FOR_EACH(e->n, put(run, e->target[k], w[k]));
    return true;
}

static bool clip_values(Run *run, const Element *e)
{
    double *data = run->data;
    bool met = false;
    for (int64_t k = 0; k < e->n; k++) {
        double value = data[e->target[k]];
        if (value < e->low[k] || value > e->high[k]) {
            met = true;
            if (!put(run, e->target[k], clip(value, e->low[k], e->high[k])))
                return false;
        }
    }
    return !met || e->clock < 0 || put(run, e->clock, 1.0);
}

static double excess(double value, double low, double high)
{
    double above = value - high, below = value - low;
    return (above > 0.0 ? above : 0.0) + (below < 0.0 ? below : 0.0);
}

/* `clock` is the place of the next row of the ring.  It comes from a state that may have been made up. */
static bool delay(Run *run, const Element *e)
{
    double *data = run->data, next = data[e->clock];
    int64_t rows = e->n_source, ring = e->second[0];
    if (!(next >= 0.0 && next < (double)rows))
        return false;
    int64_t row = (int64_t)next, old = (row - e->steps + rows) % rows;
    for (int64_t k = 0; k < e->n; k++) {
        double value = data[e->target[k]], delayed = e->steps > 0 ? data[ring + old * e->n + k] : value;
        if (!put(run, ring + row * e->n + k, value) || !put(run, e->target[k], delayed))
            return false;
    }
    return put(run, e->clock, (double)((row + 1) % rows));
}

/* `target`, where there is one, keeps the values of the step before. */
static bool watch(Run *run, const Element *e)
{
    double *data = run->data;
    bool far = false, apart = false, resting = e->target != NULL;
    for (int64_t k = 0; k < e->n; k++) {
        double value = data[e->source[k]], distance = fabs(value - data[e->second[k]]);
        far = far || distance > e->high[k];
        apart = apart || distance > e->low[k];
        if (e->target != NULL) {
            resting = resting && value == data[e->target[k]];
            if (!put(run, e->target[k], value))
                return false;
        }
    }
    run->due = run->due || far || (resting && apart);
    return true;
}

/* `second` holds n times whether the value was above, then n counts. */
static bool count(Run *run, const Element *e)
{
    double *data = run->data, sum = 0.0;
    for (int64_t k = 0; k < e->n; k++) {
        int64_t was = e->second[k], counted = e->second[e->n + k];
        bool above = fabs(data[e->source[k]]) > e->high[k];
        if (above && data[was] == 0.0 && !put(run, counted, data[counted] + 1.0))
            return false;
        if (!put(run, was, above ? 1.0 : 0.0))
            return false;
        sum += data[counted];
        if (e->n_source == e->n && !put(run, e->target[k], data[counted]))
            return false;
    }
    return e->n_source == e->n || put(run, e->target[0], sum);
}

static bool run_element(Run *run, const Element *e)
{
    double *data = run->data;
    switch (e->kind) {
    case ELEMENT_SAMPLE:
        return sample(run, e);
    case ELEMENT_RAMP:
        return ramp(run, e);
    case ELEMENT_PRODUCT:
        FOR_EACH(e->n, put(run, e->target[k], data[e->source[k]] * data[e->second[k]]));
        return true;
    case ELEMENT_LINEAR:
        return linear(run, e);
    case ELEMENT_CLIP:
        return clip_values(run, e);
    case ELEMENT_EXCESS:
        FOR_EACH(e->n, put(run, e->target[k], excess(data[e->source[k]], e->low[k], e->high[k])));
        return true;
    case ELEMENT_SINE:
        FOR_EACH(e->n, put(run, e->target[k], sin(e->low[k] * data[e->source[k]] + e->high[k])));
        return true;
    case ELEMENT_QUANTISE:
        for (int64_t k = 0; k < e->n; k++)
            if (e->low[k] != 0.0 && !put(run, e->target[k], rint(data[e->target[k]] / e->low[k]) * e->low[k]))
                return false;
        return true;
    case ELEMENT_HOLD:
        return hold(run, e);
    case ELEMENT_DELAY:
        return delay(run, e);
    case ELEMENT_WATCH:
        return watch(run, e);
    case ELEMENT_COUNT:
        return count(run, e);
    default:
        return false;
    }
}

bool run_elements(Run *run, const Element *elements, int64_t n)
{
    for (int64_t i = 0; i < n; i++)
        if (!run_element(run, &elements[i]))
            return false;
    return true;
}
