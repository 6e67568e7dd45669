/* Sums over a signal, its extremes in bins, weights of a Hann window, and which points lie outside of a polygon. */

/* (pi^2)^k (-1)^k / (2 k + 1)!: sin(pi x) / (pi x) in powers of x^2, within 1e-17 for |x| <= 1/2. */
static const double SINE[] = {
    1.0,
    -1.6449340668482264,
    0.8117424252833536,
    -0.19075182412208422,
    0.0261478478176548,
    -0.0023460810354558235,
    0.000148428793031071,
    -6.975873661656381e-06,
    2.5312174041370274e-07,
    -7.304711822217775e-09,
    1.7165384749821432e-10,
};
enum { TERMS = sizeof SINE / sizeof *SINE };

INLINE double add_up(const double *lanes)
{
    double sums[LANES];
    for (int lane = 0; lane < LANES; lane++)
        sums[lane] = lanes[lane];
    for (int half = LANES / 2; half; half /= 2)
        for (int lane = 0; lane < half; lane++)
            sums[lane] += sums[lane + half];
    return sums[0];
}

/* Of n >= 1 finite values. */
INSTRUCTIONS static void find_moments(const double *values, int64_t n, Moments *found)
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

/* 1 - cos(2 pi p) of n phases, as 2 sin(pi p)^2. */
INSTRUCTIONS static void weigh_hann(const double *phases, int64_t n, double *weights)
{
    for (int64_t i = 0; i < n; i++) {
        const double whole = (phases[i] + 0x1.8p52) - 0x1.8p52, x = phases[i] - whole; /* rounded to the nearest */
        const double square = x * x;
        double sum = SINE[TERMS - 1];
        for (int k = TERMS - 2; k >= 0; k--)
            sum = sum * square + SINE[k];
        const double sine = sum * (3.141592653589793 * x);
        weights[i] = 2.0 * (sine * sine);
    }
}

/* Each pair of n values becomes one; not in place, or else vectors could not do it. */
INLINE void join_pairs(
    const double *restrict from_low, const double *restrict from_high, int64_t n, double *restrict low,
    double *restrict high)
{
    for (int64_t i = 0; i < n / 2; i++) {
        const double a = from_low[2 * i], b = from_low[2 * i + 1], c = from_high[2 * i], d = from_high[2 * i + 1];
        low[i] = a < b ? a : b;
        high[i] = c > d ? c : d;
    }
}

/* The smallest and the largest of `width` finite values, a power of two, in each of `bins`, and of `low` and `high`
   before. */
INSTRUCTIONS static void widen_bins(
    const double *values, int64_t bins, int64_t width, double *low, double *high)
{
    const int64_t most = CHUNK / width > 1 ? CHUNK / width : 1, part = width < CHUNK ? width : CHUNK;
    double rooms[2][2][CHUNK];
    for (int64_t first = 0; first < bins; first += most) {
        const int64_t some = bins - first < most ? bins - first : most;
        for (int64_t begin = 0; begin < width; begin += part) { /* a bin wider than a chunk: piece by piece */
            const double *lows = values + first * width + begin, *highs = lows;
            int room = 0;
            for (int64_t n = some * part; n > some; n /= 2, room = !room) {
                join_pairs(lows, highs, n, rooms[room][0], rooms[room][1]);
                lows = rooms[room][0];
                highs = rooms[room][1];
            }
            for (int64_t i = 0; i < some; i++) {
                low[first + i] = low[first + i] < lows[i] ? low[first + i] : lows[i];
                high[first + i] = high[first + i] > highs[i] ? high[first + i] : highs[i];
            }
        }
    }
}
