/* Sums over a signal, and which points lie outside of an ellipse. */

#include <math.h>
#include <stdint.h>

#include "../../processor.h"

/* No fused multiply-add: each operation rounds. */
#pragma STDC FP_CONTRACT OFF

/* Sums are of each 32nd number, so that vectors of any width give the same bits, and none waits for another. */
enum { LANES = 32 };

typedef struct {
    double mean;
    double squares; /* sum of the squared deviations from the mean */
    double peak; /* magnitude */
} Moments;

typedef struct {
    double x, y; /* centre */
    double a, b, c; /* inside is (a x)^2 + (b x + c y)^2 <= 1, about the centre */
} Ellipse;

static inline __attribute__((always_inline)) double add_up(const double *lanes)
{
    double sums[LANES];
    for (int lane = 0; lane < LANES; lane++)
        sums[lane] = lanes[lane];
    for (int half = LANES / 2; half; half /= 2)
        for (int lane = 0; lane < half; lane++)
            sums[lane] += sums[lane + half];
    return sums[0];
}

static inline __attribute__((always_inline)) void find(const double *values, int64_t n, Moments *found)
{
    const int64_t whole = n / LANES * LANES;
    double sums[LANES] = {0.0}, squares[LANES] = {0.0}, peaks[LANES] = {0.0}, peak = 0.0;
    for (int64_t i = 0; i < whole; i += LANES)
        for (int lane = 0; lane < LANES; lane++) {
            const double value = values[i + lane], size = fabs(value);
            sums[lane] += value;
            peaks[lane] = size > peaks[lane] ? size : peaks[lane];
        }
    for (int64_t i = whole; i < n; i++) {
        const double size = fabs(values[i]);
        sums[i - whole] += values[i];
        peaks[i - whole] = size > peaks[i - whole] ? size : peaks[i - whole];
    }
    const double mean = add_up(sums) / (double)n;
    for (int lane = 0; lane < LANES; lane++) {
        sums[lane] = 0.0;
        peak = peaks[lane] > peak ? peaks[lane] : peak;
    }
    for (int64_t i = 0; i < whole; i += LANES)
        for (int lane = 0; lane < LANES; lane++) {
            const double deviation = values[i + lane] - mean;
            sums[lane] += deviation;
            squares[lane] += deviation * deviation;
        }
    for (int64_t i = whole; i < n; i++) {
        const double deviation = values[i] - mean;
        sums[i - whole] += deviation;
        squares[i - whole] += deviation * deviation;
    }
    /* The second term removes the rounding error of the mean. */
    const double rest = add_up(sums);
    *found = (Moments){mean, add_up(squares) - rest * rest / (double)n, peak};
}

static inline __attribute__((always_inline)) int64_t find_outer(
    const double *x, const double *y, int64_t n, const Ellipse *ellipse, int64_t *places)
{
    const double x_0 = ellipse->x, y_0 = ellipse->y, a = ellipse->a, b = ellipse->b, c = ellipse->c;
    int64_t count = 0;
    for (int64_t first = 0; first < n; first += LANES) {
        double sizes[LANES] = {0.0}, largest = 0.0;
        const int64_t some = n - first < LANES ? n - first : LANES;
        for (int64_t k = 0; k < some; k++) {
            const double from_x = x[first + k] - x_0, from_y = y[first + k] - y_0;
            const double u = a * from_x, v = b * from_x + c * from_y;
            sizes[k] = u * u + v * v;
        }
        for (int k = 0; k < LANES; k++)
            largest = sizes[k] > largest ? sizes[k] : largest;
        if (largest > 1.0) /* seldom */
            for (int k = 0; k < LANES; k++)
                if (sizes[k] > 1.0)
                    places[count++] = first + k;
    }
    return count;
}

typedef void Find(const double *values, int64_t n, Moments *found);
typedef int64_t FindOuter(const double *x, const double *y, int64_t n, const Ellipse *ellipse, int64_t *places);

#define DEFINE(width, instructions)                                                                                    \
    instructions static void find##width(const double *values, int64_t n, Moments *found)                              \
    {                                                                                                                  \
        find(values, n, found);                                                                                        \
    }                                                                                                                  \
    instructions static int64_t find_outer##width(                                                                     \
        const double *x, const double *y, int64_t n, const Ellipse *ellipse, int64_t *places)                          \
    {                                                                                                                  \
        return find_outer(x, y, n, ellipse, places);                                                                   \
    }

DEFINE(2, )
DEFINE(4, __attribute__((target("avx2"))))
DEFINE(8, __attribute__((target("avx512f"))))

static Find *best_find = find2;
static FindOuter *best_find_outer = find_outer2;

__attribute__((constructor)) static void choose_best(void)
{
    Find *const finds[] = {[SSE2] = find2, [AVX2] = find4, [AVX512] = find8};
    FindOuter *const outers[] = {[SSE2] = find_outer2, [AVX2] = find_outer4, [AVX512] = find_outer8};
    best_find = finds[find_instructions()];
    best_find_outer = outers[find_instructions()];
}

/* Of each of `signals`, of n >= 1 finite values, `room` doubles apart. */
__attribute__((visibility("default"))) void find_moments(
    const double *samples, int64_t signals, int64_t n, int64_t room, Moments *found)
{
    for (int64_t k = 0; k < signals; k++)
        best_find(samples + k * room, n, found + k);
}

/* The places of those of n points that lie outside of an ellipse, into `places` (n); how many there are is returned. */
__attribute__((visibility("default"))) int64_t find_points_outside(
    const double *x, const double *y, int64_t n, const Ellipse *ellipse, int64_t *places)
{
    return best_find_outer(x, y, n, ellipse, places);
}
