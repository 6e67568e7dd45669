/* What the reduction of recorded rows works on, and its functions for one set of instructions. */
#ifndef REDUCTION_H
#define REDUCTION_H

#include <stdint.h>

typedef struct {
    int64_t columns;
    int64_t factor; /* m */
    int64_t length; /* of h */
    const double *taps; /* h[0]; before it and behind the last one are (OUTPUTS - 1) m zeros */
    int64_t *room; /* 2 columns */
} Lowpass;

typedef struct {
    double mean;
    double squares; /* sum of the squared deviations from the mean */
    double peak; /* magnitude */
} Moments;

typedef struct {
    double sum;
    double squares; /* in unit^2 */
    double peak; /* magnitude */
} Totals;

typedef struct {
    const double *edges; /* upper ones, ascending, in units, the last one infinite */
    int64_t bins;
    double per_octave; /* bins, up to 1000 */
} Bins;

typedef struct {
    void (*filter_rows)(const Lowpass *filter, const double *rows, int64_t count, double *result);
    double (*find_peak)(const double *values, int64_t n);
    double (*complete_rows)(double *rows, int64_t count, int64_t columns, int64_t reals);
    void (*add_values)(
        const double *values, int64_t n, double unit, const Bins *histogram, int64_t *counts, Totals *totals);
    void (*find_moments)(const double *values, int64_t n, Moments *found);
    void (*widen_bins)(const double *values, int64_t bins, int64_t width, double *low, double *high);
    void (*weigh_hann)(const double *phases, int64_t n, double *weights);
} Functions;

extern const Functions functions_sse2, functions_avx2, functions_avx512;

#endif
