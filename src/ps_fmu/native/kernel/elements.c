#include "elements.h"

#include <math.h>
#include <stddef.h>

/* Each operation rounds, as in kernel.c. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

void run_keep(Run *run, int64_t place, int64_t n)
{
    *run->kept++ = (Span){place, n};
    copy(run->kept_value, run->data + place, n);
    run->kept_value += n;
}

void run_undo(Run *run)
{
    while (run->kept > run->core->kept_spans) {
        const Span *span = --run->kept;
        run->kept_value -= span->n;
        copy(run->data + span->place, run->kept_value, span->n);
    }
}

/* target[k] <- an expression in k, one after the other; false if a result is not finite. */
#define PUT_EACH(expression)                                                                                           \
    do {                                                                                                               \
        const int64_t *target = e->target;                                                                             \
        int finite = 1;                                                                                                \
        ONE_BY_ONE                                                                                                     \
        for (int64_t k = 0, n = e->n; k < n; k++) {                                                                    \
            const double result = (expression);                                                                        \
            data[target[k]] = result;                                                                                  \
            finite &= is_finite(result);                                                                               \
        }                                                                                                              \
        return finite;                                                                                                 \
    } while (0)

static double clip(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

static bool ramp(double *data, const Element *e, double step)
{
    const int64_t *source = e->source, *second = e->second;
    const double *low = e->low, *high = e->high;
    PUT_EACH(clip((data[source[k]] - data[second[k]]) / step, low[k], high[k]));
}

static bool product(double *data, const Element *e)
{
    const int64_t *source = e->source, *second = e->second;
    PUT_EACH(data[source[k]] * data[second[k]]);
}

static bool linear(Run *run, const Element *e)
{
    double *data = run->data, *w = run->core->scratch, *x = w + e->stride;
    ONE_BY_ONE
    for (int64_t j = 0; j < e->n_source; j++)
        x[j] = data[e->source[j]];
    if (!run->by->product(e->matrix, e->stride, x, e->n_source, w))
        return false;
    ONE_BY_ONE
    for (int64_t k = 0; k < e->n; k++)
        data[e->target[k]] = w[k];
    return true;
}

/* The sums of n rows of as many terms each, a number that the compiler knows. */
static inline __attribute__((always_inline)) int add_terms(const double *data, const Element *e, double *w,
                                                           const int64_t terms)
{
    const int64_t *source = e->source;
    const double *factor = e->matrix;
    int finite = 1;
    ONE_BY_ONE
    for (int64_t k = 0, n = e->n; k < n; k++, source += terms, factor += terms) {
        double sum = 0.0;
        for (int64_t j = 0; j < terms; j++)
            sum += factor[j] * data[source[j]];
        w[k] = sum;
        finite &= is_finite(sum);
    }
    return finite;
}

/* As `linear`, of the places alone whose factors are not zero, and of others with zeros up to as many in each row. */
static bool sparse(const Run *run, const Element *e)
{
    double *data = run->data, *w = run->core->scratch;
    int finite;
    switch (e->n_source) {
    case 1:
        finite = add_terms(data, e, w, 1);
        break;
    case 2:
        finite = add_terms(data, e, w, 2);
        break;
    case 3:
        finite = add_terms(data, e, w, 3);
        break;
    case 4:
        finite = add_terms(data, e, w, 4);
        break;
    default:
        finite = add_terms(data, e, w, e->n_source);
    }
    ONE_BY_ONE
    for (int64_t k = 0; k < e->n; k++)
        data[e->target[k]] = w[k];
    return finite;
}

static bool clip_values(double *data, const Element *e)
{
    bool met = false;
    int finite = 1;
    ONE_BY_ONE
    for (int64_t k = 0; k < e->n; k++) {
        double value = data[e->target[k]];
        if (value < e->low[k] || value > e->high[k]) {
            met = true;
            value = clip(value, e->low[k], e->high[k]);
            data[e->target[k]] = value;
            finite &= is_finite(value);
        }
    }
    if (met && e->clock >= 0)
        data[e->clock] = 1.0;
    return finite;
}

static double compute_excess(double value, double low, double high)
{
    double above = value - high, below = value - low;
    return (above > 0.0 ? above : 0.0) + (below < 0.0 ? below : 0.0);
}

static bool excess(double *data, const Element *e)
{
    const int64_t *source = e->source;
    const double *low = e->low, *high = e->high;
    PUT_EACH(compute_excess(data[source[k]], low[k], high[k]));
}

static bool sine(double *data, const Element *e)
{
    PUT_EACH(sin(e->low[k] * data[e->source[k]] + e->high[k]));
}

/* The nearest whole number, of two the even one, as rint, without a call: from 2^52 on, doubles are whole. */
static double find_nearest(double value)
{
    const double whole = copysign(4503599627370496.0, value);
    return fabs(value) < 4503599627370496.0 ? copysign((value + whole) - whole, value) : value;
}

static const Pair LARGE = {4503599627370496.0, 4503599627370496.0}; /* 2^52: from there on, doubles are whole */

/* find_nearest of two numbers. */
static inline Pair find_nearest_pair(Pair value)
{
    const PairBits all = {INT64_MAX, INT64_MAX}, bits = (PairBits)value, sign = bits & ~all;
    const Pair whole = (Pair)((PairBits)LARGE | sign), rounded = (value + whole) - whole;
    const PairBits small = (PairBits)((Pair)(bits & all) < LARGE);
    return (Pair)(((((PairBits)rounded & all) | sign) & small) | (bits & ~small));
}

/* Of numbers that lie side by side, with resolutions above 0. */
NOT_INLINE static bool quantise_neighbours(double *values, const double *resolution, int64_t n)
{
    int64_t k = 0;
    for (; k + 2 <= n; k += 2) {
        const Pair by = *(const Pair *)(resolution + k);
        *(Pair *)(values + k) = find_nearest_pair(*(const Pair *)(values + k) / by) * by;
    }
    if (k < n)
        values[k] = find_nearest(values[k] / resolution[k]) * resolution[k];
    return are_finite(values, n);
}

static bool quantise(double *data, const Element *e)
{
    if (e->n_source == NEIGHBOURS)
        return quantise_neighbours(data + e->target[0], e->low, e->n);
    const int64_t *target = e->target;
    const double *resolution = e->low;
    int finite = 1;
    for (int64_t k = 0; k < e->n; k++)
        if (resolution[k] != 0.0) {
            double result = find_nearest(data[target[k]] / resolution[k]) * resolution[k];
            data[target[k]] = result;
            finite &= is_finite(result);
        }
    return finite;
}

/* As is_far, of values and places that lie side by side. */
NOT_INLINE static bool are_neighbours_far(const double *value, const double *place, const double *high, int64_t n)
{
    const PairBits all = {INT64_MAX, INT64_MAX};
    PairBits far = {0, 0};
    int64_t k = 0;
    for (; k + 2 <= n; k += 2) {
        const Pair off = *(const Pair *)(value + k) - *(const Pair *)(place + k);
        far |= (PairBits)((Pair)((PairBits)off & all) > *(const Pair *)(high + k));
    }
    return (far[0] | far[1]) != 0 || (k < n && fabs(value[k] - place[k]) > high[k]);
}

/* Whether a value is farther from its place than its upper bound. */
static bool is_far(const double *data, const Element *e)
{
    if (e->n_source == NEIGHBOURS)
        return are_neighbours_far(data + e->source[0], data + e->second[0], e->high, e->n);
    const int64_t *source = e->source, *second = e->second;
    const double *high = e->high;
    int far = 0;
    ONE_BY_ONE
    for (int64_t k = 0, n = e->n; k < n; k++)
        far |= fabs(data[source[k]] - data[second[k]]) > high[k];
    return far;
}

/* Whether all values are as in the step before, which `target` keeps, and one is farther from its place than its lower
   bound; -1: one is not finite. */
static int rests_apart(double *data, const Element *e)
{
    const int64_t *source = e->source, *second = e->second, *target = e->target;
    const double *low = e->low;
    int apart = 0, resting = 1, finite = 1;
    ONE_BY_ONE
    for (int64_t k = 0, n = e->n; k < n; k++) {
        const double value = data[source[k]];
        apart |= fabs(value - data[second[k]]) > low[k];
        resting &= value == data[target[k]];
        data[target[k]] = value;
        finite &= is_finite(value);
    }
    return finite ? resting & apart : -1;
}

/* `target` is there if values that rest are to be looked at more closely. */
static bool watch(Run *run, const Element *e)
{
    const bool far = is_far(run->data, e);
    const int apart = e->target == NULL ? 0 : rests_apart(run->data, e);
    run->due = run->due || far || apart == 1;
    return apart >= 0;
}

/* `second` holds n times whether the value was above, then n counts. */
static bool count(double *data, const Element *e)
{
    const bool each = e->n_source == e->n;
    int finite = 1;
    double sum = 0.0;
    for (int64_t k = 0; k < e->n; k++) {
        const int64_t was = e->second[k], counted = e->second[e->n + k];
        const bool above = fabs(data[e->source[k]]) > e->high[k];
        if (above && data[was] == 0.0)
            data[counted] += 1.0;
        data[was] = above ? 1.0 : 0.0;
        finite &= is_finite(data[counted]);
        sum += data[counted];
        if (each)
            data[e->target[k]] = data[counted];
    }
    if (each)
        return finite;
    data[e->target[0]] = sum;
    return is_finite(sum);
}

/* The kernel looks at what the function has written. */
static bool call(Run *run, const Element *e)
{
    const int64_t done = e->function(e->arguments, run->core);
    int finite = 1;
    for (int64_t k = 0; k < e->n; k++)
        finite &= is_finite(run->data[e->target[k]]);
    run->finished = done == CALL_FINISHED;
    return finite && done != CALL_REFUSED;
}

static bool run_element(Run *run, const Element *e)
{
    double *data = run->data;
    switch (e->kind) {
    case ELEMENT_SAMPLE:
        return run_sample(run, e);
    case ELEMENT_RAMP:
        return ramp(data, e, run->core->step);
    case ELEMENT_PRODUCT:
        return product(data, e);
    case ELEMENT_LINEAR:
        return linear(run, e);
    case ELEMENT_CLIP:
        return clip_values(data, e);
    case ELEMENT_EXCESS:
        return excess(data, e);
    case ELEMENT_SINE:
        return sine(data, e);
    case ELEMENT_QUANTISE:
        return quantise(data, e);
    case ELEMENT_HOLD:
        return run_hold(run, e);
    case ELEMENT_DELAY:
        return run_delay(run, e);
    case ELEMENT_WATCH:
        return watch(run, e);
    case ELEMENT_COUNT:
        return count(data, e);
    case ELEMENT_SPARSE:
        return sparse(run, e);
    case ELEMENT_CALL:
        return call(run, e);
    default:
        return false;
    }
}

bool run_elements(Run *run, const Element *elements, int64_t n)
{
    for (int64_t i = 0; i < n && !run->finished; i++)
        if (!run_element(run, &elements[i]))
            return false;
    return true;
}
