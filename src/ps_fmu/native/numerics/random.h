/* Normal numbers by Box and Muller. */

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

/* Pairs of normal numbers from pairs of numbers from 0 to below 1. */
INLINE void make_normal(const double *u, const double *v, int64_t n, double *cosines, double *sines)
{
    for (int64_t i = 0; i < n; i++) {
        double cosine, sine;
        const double radius = sqrt(-2.0 * logarithm(1.0 - u[i]));
        turn(v[i], &cosine, &sine);
        cosines[i] = radius * cosine;
        sines[i] = radius * sine;
    }
}

/* The terms of the lines from `first` to before `end`. */
INSTRUCTIONS static void draw_lines(const Lines *l, const double *draws, const double *factor, int64_t sources,
                                    double power, double *terms, int64_t first, int64_t end)
{
    double re[CHANNELS][PART], im[CHANNELS][PART];
    const int64_t together = CHANNELS / l->n_terms; /* channels of a group */
    for (; first < end; first += PART) {
        const int64_t m = end - first < PART ? end - first : PART;
        for (int64_t s = 0; s < sources; s++) {
            const double *u = draws + s * l->n + first, *v = u + sources * l->n;
            for (int64_t i = 0; i < m; i++) {
                double cosine, sine;
                const double size = sqrt(-power * logarithm(1.0 - u[i])) * l->share[s * l->n + first + i];
                turn(v[i], &cosine, &sine);
                re[s][i] = size * cosine;
                im[s][i] = size * sine;
            }
        }
        for (int64_t c = 0; c < CHANNELS; c++) {
            double a[PART] = {0.0}, b[PART] = {0.0};
            for (int64_t s = 0; s < sources; s++) {
                const double f = factor[c * sources + s];
                for (int64_t i = 0; i < m; i++) {
                    a[i] += f * re[s][i];
                    b[i] += f * im[s][i];
                }
            }
            for (int64_t t = 0; t < l->n_terms; t++) {
                const double *gain = l->gains + 2 * (t * l->n + first);
                double *term = terms + 2 * LANES * (c / together * l->n + first) + t * together + c % together;
                for (int64_t i = 0; i < m; i++) {
                    term[2 * LANES * i] = a[i] * gain[2 * i] - b[i] * gain[2 * i + 1];
                    term[2 * LANES * i + LANES] = a[i] * gain[2 * i + 1] + b[i] * gain[2 * i];
                }
            }
        }
    }
}
