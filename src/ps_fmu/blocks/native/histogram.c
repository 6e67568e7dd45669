/* How many values lie in each bin of a histogram. */

#include <stdint.h>
#include <string.h>

/* log2(x) within 0.0002 for x above 0: the exponent, and a polynomial for the rest. */
static inline double estimate_log2(double x)
{
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    const int64_t exponent = (bits >> 52) - 1023;
    bits = (bits & 0xfffffffffffff) | 0x3ff0000000000000;
    double m; /* from 1 to 2 */
    memcpy(&m, &bits, sizeof m);
    const double u = m - 1.0;
    return (double)exponent + u * (1.438726 + u * (-0.677784 + u * (0.321188 - u * 0.082130)));
}

/* Counts each of n values, at least 0, in the first bin whose upper edge, in `unit`, is not below it.  The edges
   ascend, and the last one is infinite.  Between the others is the same ratio, with `per_octave` of them in an octave:
   up to 1000, so that the logarithm finds the bin or the one before it. */
__attribute__((visibility("default"))) void count_values(
    const double *values, int64_t n, double unit, const double *edges, int64_t bins, double per_octave, int64_t *counts)
{
    const double lowest = estimate_log2(edges[0]) - 0.6 / per_octave, last = (double)(bins - 1);
    for (int64_t i = 0; i < n; i++) {
        const double value = values[i] / unit;
        double place = (estimate_log2(value) - lowest) * per_octave;
        place = place > 0.0 ? place : 0.0;
        const int64_t bin = (int64_t)(place < last ? place : last);
        counts[bin + (value > edges[bin])]++;
    }
}
