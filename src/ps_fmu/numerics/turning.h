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
