/* What turns with the multiples of an angle. */

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

/* Add the first sums at `n` angles, n <= PART, each multiplied by its sizes. */
INLINE void add_part(const Turning *t, const double *angle, int64_t n, const double *const *sizes, int64_t n_terms,
                     double *wrench)
{
    double turned[MULTIPLES][2][PART] __attribute__((aligned(64)));
    const double(*along)[2][CHANNELS] = (const double(*)[2][CHANNELS])t->along;
    for (int64_t start = 0; start < t->n; start += MULTIPLES) {
        const int64_t m = t->n - start < MULTIPLES ? t->n - start : MULTIPLES;
        for (int64_t k = 0; k < m; k++) {
            const double multiple = t->multiples[start + k];
            for (int64_t i = 0; i < n; i++)
                turn(multiple * angle[i], &turned[k][0][i], &turned[k][1][i]);
            for (int64_t i = n; i < PART; i++)
                turned[k][0][i] = turned[k][1][i] = 0.0;
        }
        for (int64_t term = 0; term < n_terms; term++) {
            for (int64_t i = 0; i < n; i += WIDTH) {
                Vector sums[CHANNELS];
                sum_up((const double(*)[2][PART])&turned[0][0][i], m, along + term * t->n + start, sums);
                for (int64_t l = 0; l < WIDTH && i + l < n; l++)
                    for (int c = 0; c < CHANNELS; c++)
                        wrench[(i + l) * CHANNELS + c] += sizes[term][i + l] * sums[c][l];
            }
        }
    }
}

INSTRUCTIONS static void add_turning(const Turning *t, const double *angle, int64_t n, const double *sizes,
                                     int64_t n_terms, double *wrench)
{
    for (int64_t first = 0; first < n; first += PART) {
        const double *const of_part[] = {sizes + first, sizes + n + first, sizes + 2 * n + first};
        add_part(t, angle + first, n - first < PART ? n - first : PART, of_part, n_terms, wrench + first * CHANNELS);
    }
}

INLINE double limit(double x, double upper)
{
    return x < 0.0 ? 0.0 : x > upper ? upper : x;
}

/* Speed and angle as SpeedProfile of speed.py, sizes as those of wheels.py; how many sums they need. */
INLINE int64_t follow(const Profile *p, const double *time, int64_t n, double *angle, double (*sizes)[PART])
{
    const double change = p->final - p->initial, rate = p->duration > 0.0 ? change / p->duration : 0.0;
    const double per_square = p->duration > 0.0 ? 0.5 / p->duration : 0.0;
    bool changing = false, bent = false;
    for (int64_t i = 0; i < n; i++) {
        const double t = time[i], since = t - p->start, within = limit(since, p->duration);
        const bool before = since < 0.0, after = since >= p->duration;
        const double beyond = after ? since - p->duration : 0.0;
        const double turned = within * within * per_square + (beyond > 0.0 ? beyond : 0.0);
        angle[i] = p->initial * t + (change != 0.0 ? change * turned : 0.0); /* it may be infinite */
        const double speed = before ? p->initial : after ? p->final : p->initial + rate * since;
        const double acceleration = before || after ? 0.0 : rate;
        /* The polynomials of smooth.py. */
        const double x = limit(t / p->rise_time, 1.0), x3 = x * x * x;
        const double value = ((((70.0 * x - 315.0) * x + 540.0) * x - 420.0) * x + 126.0) * (x3 * x * x);
        const double slope = ((((630.0 * x - 2520.0) * x + 3780.0) * x - 2520.0) * x + 630.0) * (x3 * x);
        const double bend = ((((5040.0 * x - 17640.0) * x + 22680.0) * x - 12600.0) * x + 2520.0) * x3;
        sizes[0][i] = value * speed * speed;
        sizes[1][i] = -(value * acceleration + 2.0 * speed * (slope / p->rise_time));
        sizes[2][i] = -bend / (p->rise_time * p->rise_time);
    }
    for (int64_t i = 0; i < n; i++) {
        changing = changing || sizes[1][i] != 0.0;
        bent = bent || sizes[2][i] != 0.0;
    }
    return bent ? 3 : changing ? 2 : 1;
}

INSTRUCTIONS static void add_wheel(const Turning *t, const Profile *profile, const double *time, int64_t n,
                                   double *wrench)
{
    double angle[PART], sizes[3][PART];
    const double *const all[] = {sizes[0], sizes[1], sizes[2]};
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        const int64_t n_terms = follow(profile, time + first, m, angle, sizes);
        add_part(t, angle, m, all, n_terms, wrench + first * CHANNELS);
    }
}
