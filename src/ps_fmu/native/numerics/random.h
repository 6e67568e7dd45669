/* Normal numbers by Box and Muller. */

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
