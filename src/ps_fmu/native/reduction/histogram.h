/* How many values lie in each bin of a histogram, with their sums and the largest. */

enum { SUMS = 8 }; /* of each eighth number, so that vectors of any width give the same bits */

INLINE int64_t get_bits(double x)
{
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

INLINE double from_bits(int64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* log2(x) within 0.0002 for x >= 0: the exponent, and a polynomial for the rest.  The exponent becomes a double as the
   last bits of 2^52: few processors convert 64 bits by vectors. */
INLINE double estimate_log2(double x)
{
    const int64_t bits = get_bits(x);
    const double exponent = from_bits((int64_t)((uint64_t)bits >> 52) | 0x4330000000000000) - (0x1p52 + 1023.0);
    const double u = from_bits((bits & 0xfffffffffffff) | 0x3ff0000000000000) - 1.0;
    return exponent + u * (1.438726 + u * (-0.677784 + u * (0.321188 - u * 0.082130)));
}

INLINE double smaller(double a, double b)
{
    return a < b ? a : b;
}

INLINE double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Adds n finite values to `totals`, and counts each in the first bin whose upper edge is not below its magnitude. */
INSTRUCTIONS static void add_values(
    const double *values, int64_t n, double unit, const Bins *histogram, int64_t *counts, Totals *totals)
{
    const double *edges = histogram->edges, per_octave = histogram->per_octave;
    /* Estimates are too low by 0.4 bins, so that they are those of the bin or of the one before it. */
    const double lowest = estimate_log2(edges[0]) - 0.6 / per_octave, last = (double)(histogram->bins - 1);
    double sums[SUMS] = {0.0}, squares[SUMS] = {0.0}, peaks[SUMS] = {0.0};
    for (int64_t first = 0; first < n; first += CHUNK) {
        double chunk[CHUNK], shares[CHUNK];
        int32_t places[CHUNK];
        const int64_t count = n - first < CHUNK ? n - first : CHUNK, filled = (count + SUMS - 1) / SUMS * SUMS;
        memcpy(chunk, values + first, (size_t)count * sizeof(double));
        memset(chunk + count, 0, (size_t)(filled - count) * sizeof(double));
        for (int64_t i = 0; i < filled; i += SUMS)
            for (int lane = 0; lane < SUMS; lane++) {
                const double value = chunk[i + lane], size = fabs(value), share = size / unit;
                sums[lane] += value;
                squares[lane] += share * share;
                peaks[lane] = larger(size, peaks[lane]);
                shares[i + lane] = share;
                const double place = (estimate_log2(share) - lowest) * per_octave;
                places[i + lane] = (int32_t)smaller(larger(place, 0.0), last);
            }
        for (int64_t i = 0; i < count; i++)
            counts[places[i] + (shares[i] > edges[places[i]])]++;
    }
    for (int lane = 0; lane < SUMS; lane++) {
        totals->sum += sums[lane];
        totals->squares += squares[lane];
        totals->peak = larger(peaks[lane], totals->peak);
    }
}
