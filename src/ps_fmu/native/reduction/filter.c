/* A low-pass on the columns of rows, of which it keeps each m-th: y[k] = sum_j h[j] x[k m + j].

   A column whose numbers do not change comes out as one number, too: it is computed once.  In the default system that is
   nearly half of them. */

#include <stdint.h>
#include <string.h>

#include "../processor.h"

/* No fused multiply-add: each operation rounds. */
#pragma STDC FP_CONTRACT OFF

/* Rows that come out together, so that a row which goes in is fetched once for them; bytes of the rows that the passes
   go over in turn, so that they stay in the second cache. */
enum { OUTPUTS = 4, TILE_BYTES = 1 << 18 };

typedef struct {
    int64_t columns;
    int64_t factor; /* m */
    int64_t length; /* of h */
    const double *taps; /* h[0]; before it and behind the last one are (OUTPUTS - 1) m zeros */
    int64_t *room; /* 2 columns */
} Lowpass;

/* Fewer columns than a vector has places: one after the other. */
static void narrow(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    for (int64_t k = 0; k < count; k++)
        for (int64_t column = 0; column < columns; column++) {
            double sum = 0.0;
            for (int64_t j = 0; j < filter->length; j++)
                sum += rows[k * step + j * columns + column] * filter->taps[j];
            result[k * columns + column] = sum;
        }
}

/* Sums of a panel, its columns and a tap fit into the registers, 16, or 32 of AVX-512; so do the vectors of columns that
   are compared together: the more, the fewer times the rows are gone over. */
#define INSTRUCTIONS
#define WIDTH 2
#define VECTORS 2
#define COMPARED 6
#include "filter.h"

#define INSTRUCTIONS __attribute__((target("avx2")))
#define WIDTH 4
#define VECTORS 2
#define COMPARED 6
#include "filter.h"

#define INSTRUCTIONS __attribute__((target("avx512f")))
#define WIDTH 8
#define VECTORS 4
#define COMPARED 12
#include "filter.h"

typedef void Run(const Lowpass *filter, const double *rows, int64_t count, double *result);

static Run *const runs[] = {[SSE2] = filter2, [AVX2] = filter4, [AVX512] = filter8};
static Run *best = filter2;

__attribute__((constructor)) static void choose_best(void)
{
    best = runs[find_instructions()];
}

/* `count` rows into `result` (count, columns), from `rows`: at least (count - 1) m + length of them. */
__attribute__((visibility("default"))) void filter_rows(
    const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    best(filter, rows, count, result);
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
        best(filter, rows, count, result);
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
__attribute__((visibility("default"))) int64_t thin_rows(
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
