/* Columns out of rows, and the largest magnitude in them. */

#include <math.h>
#include <stdint.h>

#include "../../processor.h"

/* Rows that fill a line of the cache with each column, so that few lines are in use at a time; sums side by side, so
   that none waits. */
enum { ROWS = 8, LANES = 32 };

/* `count` rows, `stride` doubles apart: n columns at `places`, each side by side into `result`, `room` doubles apart. */
__attribute__((visibility("default"))) void copy_columns(
    const double *rows, int64_t count, int64_t stride, const int64_t *places, int64_t n, double *result, int64_t room)
{
    for (int64_t first = 0; first < count; first += ROWS, rows += ROWS * stride) {
        const int64_t some = count - first < ROWS ? count - first : ROWS;
        for (int64_t k = 0; k < n; k++) {
            const double *from = rows + places[k];
            double *to = result + k * room + first;
            if (some == ROWS)
                for (int row = 0; row < ROWS; row++)
                    to[row] = from[row * stride];
            else
                for (int64_t row = 0; row < some; row++)
                    to[row] = from[row * stride];
        }
    }
}

static inline __attribute__((always_inline)) double find(const double *values, int64_t n)
{
    double peaks[LANES] = {0.0}, faults[LANES] = {0.0};
    int64_t i = 0;
    for (; n - i >= LANES; i += LANES)
        for (int lane = 0; lane < LANES; lane++) {
            const double value = values[i + lane], size = fabs(value);
            peaks[lane] = size > peaks[lane] ? size : peaks[lane];
            faults[lane] += value - value; /* 0, or not a number */
        }
    double peak = 0.0, fault = 0.0;
    for (int lane = 0; lane < LANES; lane++) {
        peak = peaks[lane] > peak ? peaks[lane] : peak;
        fault += faults[lane];
    }
    for (; i < n; i++) {
        const double size = fabs(values[i]);
        peak = size > peak ? size : peak;
        fault += values[i] - values[i];
    }
    return peak + fault;
}

typedef double Find(const double *values, int64_t n);

#define DEFINE(name, instructions)                                                                                     \
    instructions static double name(const double *values, int64_t n)                                                   \
    {                                                                                                                  \
        return find(values, n);                                                                                        \
    }

DEFINE(find2, )
DEFINE(find4, __attribute__((target("avx2"))))
DEFINE(find8, __attribute__((target("avx512f"))))

static Find *best = find2;

__attribute__((constructor)) static void choose_best(void)
{
    Find *const all[] = {[SSE2] = find2, [AVX2] = find4, [AVX512] = find8};
    best = all[find_instructions()];
}

/* The largest magnitude of n values; not a number, if one of them is infinite or none. */
__attribute__((visibility("default"))) double find_peak(const double *values, int64_t n)
{
    return best(values, n);
}
