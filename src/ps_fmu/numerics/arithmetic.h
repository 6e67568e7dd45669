/* The functions of numerics.h for one set of INSTRUCTIONS, with ARITHMETIC as the name of their table.

   Every result is rounded after each operation and summed in one order: the same bits with any instructions. */
#include "numerics.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* No fused multiply-add: each operation rounds. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#define INLINE INSTRUCTIONS static inline __attribute__((always_inline))

enum { PART = 64 /* numbers worked on together: they stay in the first cache */, LANES = 8, MULTIPLES = 32 };

static const double ROUND = 6755399441055744.0; /* 1.5 * 2^52: a sum with it is rounded to a whole number */

/* The nearest whole number of |x| < 2^51. */
INLINE double round_to_whole(double x)
{
    return (x + ROUND) - ROUND;
}

/* --- Tables -------------------------------------------------------------------------------------------------- */

static const double SNAP = 1e-6;     /* grid steps */
static const double FARTHEST = 1e15; /* grid steps; whole numbers up to there are rounded right */
static const double SCALE[NODES] = {1.0 / -120.0, 1.0 / 24.0, 1.0 / -12.0, 1.0 / 12.0, 1.0 / -24.0, 1.0 / 120.0};

/* Cells and weights (NODES, PART) of some times. */
INLINE void find_places(const Tables *t, const double *time, int64_t n, double *cell, double (*weights)[PART])
{
    double rest[PART];
    for (int64_t i = 0; i < n; i++) {
        const double position = (time[i] - t->start) * t->rate;
        const double nearest = round_to_whole(position);
        const double x = fabs(position - nearest) < SNAP ? nearest : position;
        cell[i] = fabs(x) < FARTHEST ? nearest - (nearest > x ? 1.0 : 0.0) : 0.0; /* also where it is no number */
        rest[i] = x - cell[i];
    }
    for (int64_t i = 0; i < n; i++) {
        double d[NODES], w[NODES];
        for (int k = 0; k < NODES; k++)
            d[k] = rest[i] - (k - 2);
        w[0] = 1.0;
        for (int k = 0; k < NODES - 1; k++)
            w[k + 1] = w[k] * d[k];
        double after = d[NODES - 1];
        for (int k = NODES - 2; k >= 0; k--) {
            w[k] = w[k] * after;
            after = after * d[k];
        }
        for (int k = 0; k < NODES; k++)
            weights[k][i] = w[k] * SCALE[k];
    }
}

INLINE int64_t wrap(int64_t row, int64_t n)
{
    row %= n;
    return row < 0 ? row + n : row;
}

/* Rows `cell` + 0 ... `n` - 1 of the sum of both tables, each with zeros up to LANES. */
INLINE void fetch(const Tables *t, int64_t cell, int n, double (*rows)[LANES])
{
    int64_t one = wrap(cell + t->shift_one, t->n), other = wrap(cell + t->shift_other, t->n);
    for (int k = 0; k < n; k++) {
        for (int c = 0; c < CHANNELS; c++)
            rows[k][c] = t->one[one * CHANNELS + c];
        one = one + 1 < t->n ? one + 1 : 0;
        if (t->other == NULL)
            continue;
        for (int c = 0; c < CHANNELS; c++)
            rows[k][c] += t->other[other * CHANNELS + c];
        other = other + 1 < t->n ? other + 1 : 0;
    }
}

INSTRUCTIONS static void add_rows(const Tables *t, const double *time, int64_t n, double *wrench)
{
    double cell[PART], weights[NODES][PART], rows[NODES][LANES] = {{0.0}};
    int64_t fetched = INT64_MIN;
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        find_places(t, time + first, m, cell, weights);
        for (int64_t i = 0; i < m; i++, wrench += CHANNELS) {
            const int64_t here = (int64_t)cell[i];
            double sums[LANES] = {0.0};
            if (weights[2][i] == 1.0) { /* on the grid: all other weights are 0 */
                fetch(t, here, 1, rows);
                fetched = INT64_MIN;
                for (int c = 0; c < CHANNELS; c++)
                    wrench[c] += rows[0][c];
                continue;
            }
            if (here != fetched)
                fetch(t, here - 2, NODES, rows);
            fetched = here;
            for (int k = 0; k < NODES; k++)
                for (int c = 0; c < LANES; c++)
                    sums[c] += rows[k][c] * weights[k][i];
            for (int c = 0; c < CHANNELS; c++)
                wrench[c] += sums[c];
        }
    }
}

/* --- Random numbers ------------------------------------------------------------------------------------------ */

INLINE double from_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

INLINE uint64_t to_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* log(x), 2^-1000 < x < 2^1000: x = 2^k (1 + f) around 1, log(1 + f) = 2 artanh(f / (2 + f)). */
INLINE double logarithm(double x)
{
    const uint64_t root = 0x3fe6a09e667f3bcdULL, one = 0x3ff0000000000000ULL, fraction = 0x000fffffffffffffULL;
    const uint64_t t = to_bits(x) + (one - root);
    const double k = from_bits(0x4330000000000000ULL | (t >> 52)) - (4503599627370496.0 + 1023.0);
    const double f = from_bits((t & fraction) + root) - 1.0;
    const double s = f / (2.0 + f), z = s * s;
    double sum = 1.0 / 21.0;
    for (int n = 19; n > 0; n -= 2) /* the next term is below 2e-17 */
        sum = sum * z + 1.0 / n;
    return k * 0.6931471805599453 + 2.0 * s * sum;
}

/* Cosine and sine of 2 pi v, |v| < 2^48: the nearest quarter of a turn, and the series of the rest. */
INLINE void turn(double v, double *cosine, double *sine)
{
    static const double COSINE[] = {1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
                                    1.0 / 40320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0};
    static const double SINE[] = {-1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0,
                                  -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0};
    const double shifted = 4.0 * v + ROUND;
    const uint64_t quarter = to_bits(shifted);
    const double rest = (v - 0.25 * (shifted - ROUND)) * 6.283185307179586, square = rest * rest;
    double c = COSINE[0], s = SINE[0];
    for (int n = 1; n < 9; n++)
        c = c * square + COSINE[n];
    for (int n = 1; n < 8; n++)
        s = s * square + SINE[n];
    s = s * rest;
    /* By each quarter, (c, s) becomes (-s, c). */
    const uint64_t swapped = -(quarter & 1);
    const uint64_t a = to_bits(c), b = to_bits(s), both = (a ^ b) & swapped;
    *cosine = from_bits((a ^ both) ^ (((quarter + 1) & 2) << 62));
    *sine = from_bits((b ^ both) ^ ((quarter & 2) << 62));
}

INSTRUCTIONS static void draw_normal(const double *numbers, int64_t rows, int64_t half, double *normal)
{
    for (; rows > 0; rows--, numbers += 2 * half, normal += 2 * half) {
        for (int64_t i = 0; i < half; i++) {
            double cosine, sine;
            const double radius = sqrt(-2.0 * logarithm(1.0 - numbers[i]));
            turn(numbers[half + i], &cosine, &sine);
            normal[i] = radius * cosine;
            normal[half + i] = radius * sine;
        }
    }
}

INSTRUCTIONS static void draw_lines(const Draws *d, int64_t first, int64_t end)
{
    double re[LANES][PART], im[LANES][PART];
    for (; first < end; first += PART) {
        const int64_t m = end - first < PART ? end - first : PART;
        for (int64_t s = 0; s < d->sources; s++) {
            const double *u = d->draws + s * d->lines + first, *v = u + d->sources * d->lines;
            for (int64_t i = 0; i < m; i++) {
                double cosine, sine;
                const double size = sqrt(-d->power * logarithm(1.0 - u[i])) * d->share[first + i];
                turn(v[i], &cosine, &sine);
                re[s][i] = size * cosine;
                im[s][i] = size * sine;
            }
        }
        for (int64_t c = 0; c < d->channels; c++) {
            double a[PART] = {0.0}, b[PART] = {0.0};
            for (int64_t s = 0; s < d->sources; s++) {
                const double f = d->factor[c * d->sources + s];
                for (int64_t i = 0; i < m; i++) {
                    a[i] += f * re[s][i];
                    b[i] += f * im[s][i];
                }
            }
            for (int64_t t = 0; t < d->n_terms; t++) {
                const double *gain = d->gains + 2 * (t * d->lines + first);
                double *term = d->terms + 2 * ((c * d->n_terms + t) * d->lines + first);
                for (int64_t i = 0; i < m; i++) {
                    term[2 * i] = a[i] * gain[2 * i] - b[i] * gain[2 * i + 1];
                    term[2 * i + 1] = a[i] * gain[2 * i + 1] + b[i] * gain[2 * i];
                }
            }
        }
    }
}

/* --- Samples ------------------------------------------------------------------------------------------------- */

INSTRUCTIONS static void fold(const double *terms, const double *turns, int64_t n_terms, int64_t lines,
                              const Run *runs, int64_t n_runs, double *spectra, int64_t bins)
{
    memset(spectra, 0, sizeof(double) * 2 * (size_t)(n_terms * bins));
    for (int64_t t = 0; t < n_terms; t++, terms += 2 * lines, spectra += 2 * bins) {
        for (const Run *run = runs; run < runs + n_runs; run++) {
            const double *a = terms + 2 * run->first, *b = turns + 2 * run->first;
            const int64_t n = run->end - run->first;
            double *to = spectra + 2 * run->bin;
            if (!run->mirrored) {
                for (int64_t i = 0; i < n; i++) {
                    to[2 * i] += a[2 * i] * b[2 * i] - a[2 * i + 1] * b[2 * i + 1];
                    to[2 * i + 1] += a[2 * i] * b[2 * i + 1] + a[2 * i + 1] * b[2 * i];
                }
            } else {
                for (int64_t i = 0; i < n; i++) {
                    to[-2 * i] += a[2 * i] * b[2 * i] - a[2 * i + 1] * b[2 * i + 1];
                    to[-2 * i + 1] -= a[2 * i] * b[2 * i + 1] + a[2 * i + 1] * b[2 * i];
                }
            }
        }
    }
}

INSTRUCTIONS static void weigh(const double *samples, const double *sizes, int64_t channels, int64_t n_terms,
                               int64_t points, double *rows, int64_t stride)
{
    double sums[LANES][PART];
    for (int64_t first = 0; first < points; first += PART) {
        const int64_t m = points - first < PART ? points - first : PART;
        for (int64_t c = 0; c < channels; c++) {
            const double *sample = samples + c * n_terms * points + first, *size = sizes + first;
            for (int64_t i = 0; i < m; i++)
                sums[c][i] = sample[i] * size[i];
            for (int64_t t = 1; t < n_terms; t++)
                for (int64_t i = 0; i < m; i++)
                    sums[c][i] += sample[t * points + i] * size[t * points + i];
        }
        for (int64_t i = 0; i < m; i++)
            for (int64_t c = 0; c < channels; c++)
                rows[(first + i) * stride + c] = sums[c][i];
    }
}

/* --- Turning ------------------------------------------------------------------------------------------------- */

typedef double Vector __attribute__((vector_size(8 * WIDTH)));

/* The sum over all multiples of cosine and sine times their coefficients, for WIDTH angles: a column of `turned`. */
INLINE void sum_up(const double (*turned)[2][PART], int64_t multiples, const double (*along)[2][CHANNELS], Vector *sums)
{
    for (int c = 0; c < CHANNELS; c++)
        sums[c] = (Vector){0.0};
    for (int64_t k = 0; k < multiples; k++) {
        const Vector cosine = *(const Vector *)turned[k][0], sine = *(const Vector *)turned[k][1];
        for (int c = 0; c < CHANNELS; c++)
            sums[c] += along[k][0][c] * cosine + along[k][1][c] * sine;
    }
}

INSTRUCTIONS static void add_turning(const Turning *t, const double *angle, int64_t n, const double *sizes,
                                     double *wrench)
{
    double turned[MULTIPLES][2][PART] __attribute__((aligned(64)));
    const double(*along)[2][CHANNELS] = (const double(*)[2][CHANNELS])t->along;
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t rows = n - first < PART ? n - first : PART;
        for (int64_t start = 0; start < t->n; start += MULTIPLES) {
            const int64_t m = t->n - start < MULTIPLES ? t->n - start : MULTIPLES;
            for (int64_t k = 0; k < m; k++) {
                const double multiple = t->multiples[start + k];
                for (int64_t i = 0; i < rows; i++)
                    turn(multiple * angle[first + i], &turned[k][0][i], &turned[k][1][i]);
                for (int64_t i = rows; i < PART; i++)
                    turned[k][0][i] = turned[k][1][i] = 0.0;
            }
            for (int64_t term = 0; term < t->n_terms; term++) {
                for (int64_t i = 0; i < rows; i += WIDTH) {
                    Vector sums[CHANNELS];
                    sum_up((const double(*)[2][PART])&turned[0][0][i], m, along + term * t->n + start, sums);
                    for (int64_t l = 0; l < WIDTH && i + l < rows; l++)
                        for (int c = 0; c < CHANNELS; c++)
                            wrench[(first + i + l) * CHANNELS + c] += sizes[term * n + first + i + l] * sums[c][l];
                }
            }
        }
    }
}

const Arithmetic ARITHMETIC = {NAME, add_rows, draw_lines, fold, weigh, draw_normal, add_turning};
