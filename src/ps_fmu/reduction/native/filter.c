/* A low-pass on the columns of rows, of which it keeps each m-th: y[k] = sum_j h[j] x[k m + j].

   A column whose numbers do not change comes out as one number, too: it is computed once.  In the default system that is
   nearly half of them. */

#include <stdint.h>

#include "../../processor.h"

/* No fused multiply-add: each operation rounds. */
#pragma STDC FP_CONTRACT OFF

/* Rows that come out together, so that a row which goes in is fetched once for them; vectors of columns that are
   compared together, so that none waits; bytes of the rows that the passes go over in turn, so that they stay in the
   second cache. */
enum { OUTPUTS = 4, COMPARED = 6, TILE_BYTES = 1 << 18 };

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

/* Sums of a panel, its columns and a tap fit into the registers: 16, or 32 of AVX-512. */
#define INSTRUCTIONS
#define WIDTH 2
#define VECTORS 2
#include "filter.h"

#define INSTRUCTIONS __attribute__((target("avx2")))
#define WIDTH 4
#define VECTORS 2
#include "filter.h"

#define INSTRUCTIONS __attribute__((target("avx512f")))
#define WIDTH 8
#define VECTORS 4
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
