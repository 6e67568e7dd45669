/* Rows as numbers, columns out of them, and the largest magnitude in them. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "../processor.h"

/* Rows that fill a line of the cache with each column, so that few lines are in use at a time; sums side by side, so
   that none waits; bytes of rows that stay in the first cache. */
enum { ROWS = 8, LANES = 32, PART_BYTES = 1 << 14 };

/* `count` rows, `stride` doubles apart: n columns at `places`, each side by side into `result`, `room` doubles apart. */
__attribute__((visibility("default"))) void copy_columns(
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

/* `count` C ints become as many doubles: the last one first, for they lie in the places of the doubles. */
static inline __attribute__((always_inline)) void widen(double *places, int64_t count)
{
    for (int64_t k = count - 1; k >= 0; k--) {
        int32_t number;
        memcpy(&number, (const char *)places + k * (int64_t)sizeof number, sizeof number);
        places[k] = number;
    }
}

static inline __attribute__((always_inline)) double complete(double *rows, int64_t count, int64_t columns, int64_t reals)
{
    const int64_t part = PART_BYTES / (8 * columns) > 1 ? PART_BYTES / (8 * columns) : 1;
    double peak = 0.0, fault = 0.0;
    for (int64_t end = count; end > 0; end -= part) {
        const int64_t some = end < part ? end : part;
        double *begin = rows + (end - some) * columns;
        for (int64_t row = 0; row < some; row++)
            widen(begin + row * columns + reals, columns - reals);
        const double size = find(begin, some * columns);
        peak = size > peak ? size : peak;
        fault += size - size; /* 0, or not a number */
    }
    return peak + fault;
}

typedef double Find(const double *values, int64_t n);
typedef double Complete(double *rows, int64_t count, int64_t columns, int64_t reals);

#define DEFINE(width, instructions)                                                                                    \
    instructions static double find##width(const double *values, int64_t n)                                            \
    {                                                                                                                  \
        return find(values, n);                                                                                        \
    }                                                                                                                  \
    instructions static double complete##width(double *rows, int64_t count, int64_t columns, int64_t reals)            \
    {                                                                                                                  \
        return complete(rows, count, columns, reals);                                                                  \
    }

DEFINE(2, )
DEFINE(4, __attribute__((target("avx2"))))
DEFINE(8, __attribute__((target("avx512f"))))

static Find *best = find2;
static Complete *best_complete = complete2;

__attribute__((constructor)) static void choose_best(void)
{
    Find *const finds[] = {[SSE2] = find2, [AVX2] = find4, [AVX512] = find8};
    Complete *const completes[] = {[SSE2] = complete2, [AVX2] = complete4, [AVX512] = complete8};
    best = finds[find_instructions()];
    best_complete = completes[find_instructions()];
}

/* The largest magnitude of n values; not a number, if one of them is infinite or none. */
__attribute__((visibility("default"))) double find_peak(const double *values, int64_t n)
{
    return best(values, n);
}

/* `count` rows of numbers, each `reals` doubles and then C ints: these become doubles, too, in the places that they have
   as such.  What find_peak says of all numbers is returned.  From the last row, which was written last, to the first: the
   second cache has not room for all of a usual block, and who looks at them next begins with the first. */
__attribute__((visibility("default"))) double complete_rows(
    double *rows, int64_t count, int64_t columns, int64_t reals)
{
    return best_complete(rows, count, columns, reals);
}
