/* What Python calls, by the instructions that this processor does best. */
#include "../processor.h"
#include "reduction.h"

#include <string.h>

#define EXPORT __attribute__((visibility("default")))

enum { ROWS = 8 }; /* that fill a line of the cache with each column, so that few lines are in use at a time */

static const Functions *best = &functions_sse2;

__attribute__((constructor)) static void choose_best(void)
{
#ifdef __x86_64__
    const Functions *const known[] = {[SSE2] = &functions_sse2, [AVX2] = &functions_avx2, [AVX512] = &functions_avx512};
    best = known[find_instructions()];
#endif
}

/* `count` rows, `stride` doubles apart: n columns at `places`, each side by side into `result`, `room` doubles apart. */
EXPORT void copy_columns(
    const double *rows, int64_t count, int64_t stride, const int64_t *places, int64_t n, double *result, int64_t room)
{
    for (int64_t first = 0; first < count; first += ROWS, rows += ROWS * stride) {
        const int64_t some = count - first < ROWS ? count - first : ROWS;
        for (int64_t k = 0; k < n; k++) {
            const double *from = rows + places[k];
            double *to = result + k * room + first;
            __builtin_prefetch(to + 2 * ROWS, 1); /* of many columns, where they go is seldom in the cache */
            if (some == ROWS)
                for (int row = 0; row < ROWS; row++)
                    to[row] = from[row * stride];
            else
                for (int64_t row = 0; row < some; row++)
                    to[row] = from[row * stride];
        }
    }
}

EXPORT double find_peak(const double *values, int64_t n)
{
    return best->find_peak(values, n);
}

EXPORT double complete_rows(double *rows, int64_t count, int64_t columns, int64_t reals)
{
    return best->complete_rows(rows, count, columns, reals);
}

EXPORT void add_values(
    const double *values, int64_t n, double unit, const Bins *histogram, int64_t *counts, Totals *totals)
{
    best->add_values(values, n, unit, histogram, counts, totals);
}

/* Of each of `signals`, `room` doubles apart. */
EXPORT void find_moments(const double *samples, int64_t signals, int64_t n, int64_t room, Moments *found)
{
    for (int64_t k = 0; k < signals; k++)
        best->find_moments(samples + k * room, n, found + k);
}

EXPORT void widen_bins(const double *values, int64_t bins, int64_t width, double *low, double *high)
{
    best->widen_bins(values, bins, width, low, high);
}

EXPORT void weigh_hann(const double *phases, int64_t n, double *weights)
{
    best->weigh_hann(phases, n, weights);
}

/* `count` rows into `result` (count, columns), from `rows`: at least (count - 1) m + length of them. */
EXPORT void filter_rows(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    best->filter_rows(filter, rows, count, result);
}

/* A low-pass on rows that come in parts. */
typedef struct {
    const Lowpass *filter;
    const int64_t *sampled; /* columns that are not filtered: what lies in the middle of a window comes out */
    int64_t n_sampled;
    double *waiting; /* rows from the begin of the next window on, fewer than `length`; room for 2 length + m */
    int64_t count; /* of them */
} Thinning;

static void filter_and_sample(const Thinning *thinning, const double *rows, int64_t count, double *result)
{
    const Lowpass *filter = thinning->filter;
    const int64_t columns = filter->columns;
    if (count > 0)
        best->filter_rows(filter, rows, count, result);
    for (int64_t k = 0; k < count; k++)
        for (int64_t i = 0; i < thinning->n_sampled; i++) {
            const int64_t column = thinning->sampled[i];
            result[k * columns + column] = rows[(filter->length / 2 + k * filter->factor) * columns + column];
        }
}

static void keep(Thinning *thinning, const double *rows, int64_t count)
{
    const int64_t columns = thinning->filter->columns;
    memcpy(thinning->waiting + thinning->count * columns, rows, (size_t)(count * columns) * sizeof *rows);
    thinning->count += count;
}

/* Takes the next `count` rows; those that come out go into `result`, and their number is returned.  Windows that lie in
   these rows are filtered where they are. */
EXPORT int64_t thin_rows(
    Thinning *thinning, const double *rows, int64_t count, double *result)
{
    const Lowpass *filter = thinning->filter;
    const int64_t m = filter->factor, columns = filter->columns, before = thinning->count, all = before + count;
    const int64_t done = all < filter->length ? 0 : (all - filter->length) / m + 1;
    const int64_t begun = (before + m - 1) / m; /* windows that begin with rows that wait */
    if (done <= begun) {
        keep(thinning, rows, count);
        filter_and_sample(thinning, thinning->waiting, done, result);
        thinning->count = all - done * m;
        memmove(
            thinning->waiting, thinning->waiting + done * m * columns,
            (size_t)(thinning->count * columns) * sizeof *rows);
        return done;
    }
    if (begun > 0) {
        keep(thinning, rows, (begun - 1) * m + filter->length - before);
        filter_and_sample(thinning, thinning->waiting, begun, result);
    }
    filter_and_sample(thinning, rows + (begun * m - before) * columns, done - begun, result + begun * columns);
    thinning->count = 0;
    keep(thinning, rows + (done * m - before) * columns, all - done * m);
    return done;
}
