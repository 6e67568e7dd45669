/* Errors of sensors: white noise, and what drifts slowly. */

/* Values and slopes of the drift at PART samples from number `first` on: where those of the first sensor are, and which
   share of the slope. */
INLINE void find_drift(const Errors *e, int64_t block, const double *const *drift, int64_t first, int64_t n,
                       const double **place, double *share)
{
    const int64_t begin = block * e->samples / e->stride / e->places; /* the first of `drift` */
    int64_t at = first / e->stride, rest = first % e->stride;
    int64_t k = at % e->places;
    const double *const *of = drift + (at / e->places - begin);
    for (int64_t i = 0; i < n; i++) {
        place[i] = *of + k;
        share[i] = (double)rest / (double)e->stride;
        if (++rest == e->stride) {
            rest = 0;
            if (++k == e->places) {
                k = 0;
                of++;
            }
        }
    }
}

/* The errors of sensor s of a block, from white noise of unit variance; `rows` is at the first sample. */
INLINE void store_errors(const Errors *e, int64_t s, const double *const *place, const double *share,
                         const double *white, int64_t n, double *rows)
{
    const int64_t value = s * e->places, slope = (e->sensors + s) * e->places;
    rows += s;
    for (int64_t i = 0; i < n; i++) {
        double error = white[i] * e->deviation;
        if (place != NULL) {
            error += place[i][value];
            error += share[i] * place[i][slope];
        }
        rows[i * e->width] = error;
    }
}

INSTRUCTIONS static void make_errors(const Errors *e, const uint32_t *words, int64_t n_words, int64_t block,
                                     const double *const *drift, double *rows)
{
    uint64_t key[2];
    const int64_t half = e->samples / 2;
    find_key(words, n_words, key);
    for (int64_t first = 0; first < half; first += PART) {
        const int64_t m = half - first < PART ? half - first : PART;
        const double *place[2][PART];
        double share[2][PART];
        for (int part = 0; part < 2 && drift != NULL; part++)
            find_drift(e, block, drift, block * e->samples + first + part * half, m, place[part], share[part]);
        for (int64_t s = 0; s < e->sensors; s++) {
            double white[2][PART] = {{0.0}};
            if (e->deviation != 0.0)
                draw_part(key, s, half, first, m, white[0], white[1]);
            for (int part = 0; part < 2; part++)
                store_errors(e, s, drift == NULL ? NULL : place[part], share[part], white[part], m,
                             rows + (first + part * half) * e->width);
        }
    }
}

/* Processes x' = decay x + kick w from `first`, then moved so that they end at `last`. */
INSTRUCTIONS static void connect(const Bridge *b, const double *first, const double *last, const double *normal,
                                 double *path)
{
    const int64_t row = b->processes * b->sensors;
    memcpy(path, first, sizeof *path * (size_t)row);
    for (int64_t k = 0; k < b->steps; k++)
        for (int64_t p = 0; p < b->processes; p++)
            for (int64_t s = 0; s < b->sensors; s++) {
                double *x = path + k * row + p * b->sensors + s;
                x[row] = b->kick[p] * normal[(s * b->processes + p) * b->steps + k] + b->decay[p] * *x;
            }
    for (int64_t i = 0; i < row; i++) {
        const double missing = last[i] - path[b->steps * row + i];
        for (int64_t k = 0; k < b->steps; k++)
            path[(k + 1) * row + i] += b->weight[k * b->processes + i / b->sensors] * missing;
    }
}
