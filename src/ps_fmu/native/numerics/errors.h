/* Errors of sensors: white noise, and what drifts slowly. */

/* Values and slopes of the drift at some samples from number `first` on: where those of the first sensor are, and which
   share of the slope.  `drift` is the block with place `begin`, and those after it. */
INLINE void find_drift(const Errors *e, const double *const *drift, int64_t begin, int64_t first, int64_t n,
                       const double **place, double *share)
{
    const int64_t at = first / e->stride;
    const double *const *of = drift + (at / e->places - begin / e->places);
    int64_t k = at % e->places, rest = first % e->stride;
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

/* The errors of sensor s from white noise of unit variance; `rows` is at the first sample. */
INLINE void store_errors(const Errors *e, int64_t s, const double *const *place, const double *share,
                         const double *white, int64_t n, double *rows, int64_t width)
{
    const int64_t value = s * e->places, slope = (e->sensors + s) * e->places;
    rows += s;
    for (int64_t i = 0; i < n; i++, rows += width) {
        double error = white[i] * e->deviation;
        if (place != NULL) {
            error += place[i][value];
            error += share[i] * place[i][slope];
        }
        *rows = error;
    }
}

/* Blocks of errors into rows of `width` numbers, one block after the other. */
INSTRUCTIONS static void make_errors(const Errors *e, int64_t block, int64_t n_blocks, const double *const *drift,
                                     double *rows, int64_t width)
{
    const int64_t half = e->samples / 2, begin = block * e->samples / e->stride;
    for (const int64_t last = block + n_blocks; block < last; block++, rows += e->samples * width) {
        uint64_t key[2];
        const uint32_t words[] = {e->words[0], e->words[1], e->words[2], (uint32_t)block};
        find_key(words, 4, key);
        for (int64_t first = 0; first < half; first += PART) {
            const int64_t m = half - first < PART ? half - first : PART;
            const double *place[2][PART];
            double share[2][PART];
            for (int part = 0; part < 2 && drift != NULL; part++)
                find_drift(e, drift, begin, block * e->samples + first + part * half, m, place[part], share[part]);
            for (int64_t s = 0; s < e->sensors; s++) {
                double white[2][PART] = {{0.0}};
                if (e->deviation != 0.0)
                    draw_part(key, s, half, first, m, white[0], white[1]);
                for (int part = 0; part < 2; part++)
                    store_errors(e, s, drift == NULL ? NULL : place[part], share[part], white[part], m,
                                 rows + (first + part * half) * width, width);
            }
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
