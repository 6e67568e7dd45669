/* Random errors of sensors (errors.py): white noise, and a drift on grids of places. */

/* The constants of one grid of the drift for samples at an interval, s. */
INLINE void set_grid(const Errors *e, Bridge *b, double interval)
{
    for (int p = 0; p < PROCESSES; p++) {
        const bool walks = p == PROCESSES - 1;
        const double decay = walks ? 1.0 : exponential(-interval / e->correlation_times[p]);
        double power = 1.0, grown = 0.0;
        b->decay[p] = decay;
        b->kick[p] = walks ? e->walk * sqrt(interval) : e->slow * sqrt(1.0 - decay * decay);
        for (int k = 0; k < PLACES; k++) { /* variance of a path from 0, over kick^2 */
            grown += power * power;
            power *= decay;
            b->weight[k][p] = grown;
        }
        b->power[p] = power;
        b->total[p] = sqrt(grown);
        power = 1.0;
        for (int k = PLACES - 1; k >= 0; k--) { /* covariance with the end of the path, over the variance of the end */
            b->weight[k][p] = power * b->weight[k][p] / grown;
            power *= decay;
        }
    }
}

INLINE void forget_drift(ErrorStream *s)
{
    for (int grid = 0; grid < GRIDS; grid++)
        for (int place = 0; place < 2; place++)
            s->number[grid][place] = NONE;
}

/* Samples at an interval from now on. */
INSTRUCTIONS static void set_interval(const Errors *e, ErrorStream *s, double interval)
{
    const double most = 9007199254740992.0, wanted = e->drift_interval / interval;
    const double stride = !(wanted < most) ? most : wanted < 1.0 ? 1.0 : wanted < 1e15 ? round_to_whole(wanted) : floor(wanted);
    s->interval = interval;
    s->deviation = e->density / sqrt(2.0 * interval);
    s->stride = (int64_t)stride;
    s->block = NONE;
    forget_drift(s);
    double wide = stride * interval;
    for (int grid = 0; grid < GRIDS && e->drifts; grid++, wide *= PLACES)
        set_grid(e, &s->grids[grid], wide);
}

/* Of the stream of an interval.  Several are kept, for hosts whose steps alternate. */
INSTRUCTIONS static ErrorStream *find_stream(Errors *e, double interval)
{
    for (int64_t k = 0; k < e->n_streams; k++)
        if (e->streams[k].interval == interval)
            return &e->streams[k];
    ErrorStream *s = &e->streams[e->oldest];
    e->oldest = (e->oldest + 1) % e->n_streams;
    set_interval(e, s, interval);
    return s;
}

/* White noise, AT_ONCE samples of each half of a block. */
INSTRUCTIONS static void draw_white(const Errors *e, ErrorStream *s, int64_t group)
{
    const uint32_t words[] = {e->white_words[0], e->white_words[1], e->white_words[2], (uint32_t)s->block};
    const int64_t half = WHITE / 2, first = group * AT_ONCE;
    uint64_t key[2];
    find_key(words, 4, key);
    for (int64_t k = 0; k < e->sensors; k++)
        draw_part(key, k, half, first, AT_ONCE, s->white + k * WHITE + first, s->white + k * WHITE + half + first);
    s->drawn |= 1u << group;
}

/* The processes of a sensor at a place of the grid above all bridges. */
INSTRUCTIONS static void go_on(const Errors *e, const ErrorStream *s, int64_t place, int64_t sensor, double *x)
{
    const Bridge *b = &s->grids[GRIDS - 1];
    for (int64_t number = 0; number <= place; number++) {
        double normal[2][PROCESSES / 2];
        const uint32_t words[] = {e->drift_words[0], e->drift_words[1], e->drift_words[2], WIDEST, (uint32_t)number};
        uint64_t key[2];
        find_key(words, 5, key);
        draw_part(key, sensor, PROCESSES / 2, 0, PROCESSES / 2, normal[0], normal[1]);
        for (int p = 0; p < PROCESSES; p++) {
            const double draw = normal[p / (PROCESSES / 2)][p % (PROCESSES / 2)];
            const double first = p == PROCESSES - 1 ? 0.0 : e->slow; /* at the start: stationary already */
            x[p] = number == 0 ? first * draw : b->power[p] * x[p] + b->kick[p] * b->total[p] * draw;
        }
    }
}

/* Where a bridge of a sensor is kept, (PLACES + 1, PROCESSES). */
INLINE double *find_path(const Errors *e, const ErrorStream *s, int64_t grid, int64_t block, int64_t sensor)
{
    return s->paths + (((grid - 1) * 2 + block % 2) * e->sensors + sensor) * (PLACES + 1) * PROCESSES;
}

/* The processes of a sensor at a place of a grid; its block is there. */
INLINE void find_value(const Errors *e, const ErrorStream *s, int64_t grid, int64_t place, int64_t sensor, double *x)
{
    if (grid == GRIDS)
        go_on(e, s, place, sensor, x);
    else
        memcpy(x, find_path(e, s, grid, place / PLACES, sensor) + place % PLACES * PROCESSES, sizeof *x * PROCESSES);
}

/* The path of a sensor between two places of the grid above: recursions x' = decay x + kick w, moved to their end. */
INSTRUCTIONS static void connect(const Errors *e, const ErrorStream *s, int64_t grid, int64_t block, int64_t sensor,
                                 double *path)
{
    enum { HALF = PROCESSES * PLACES / 2 };
    const Bridge *b = &s->grids[grid];
    const uint32_t words[] = {e->drift_words[0], e->drift_words[1], e->drift_words[2], WIDEST + 1 + (uint32_t)grid,
                              (uint32_t)block};
    double normal[2 * HALF], last[PROCESSES], missing[PROCESSES];
    uint64_t key[2];
    find_key(words, 5, key);
    for (int64_t first = 0; first < HALF; first += PART)
        draw_part(key, sensor, HALF, first, HALF - first < PART ? HALF - first : PART, normal + first,
                  normal + HALF + first);
    find_value(e, s, grid + 1, block, sensor, path);
    find_value(e, s, grid + 1, block + 1, sensor, last);
    for (int k = 0; k < PLACES; k++)
        for (int p = 0; p < PROCESSES; p++)
            path[(k + 1) * PROCESSES + p] = b->kick[p] * normal[p * PLACES + k] + b->decay[p] * path[k * PROCESSES + p];
    for (int p = 0; p < PROCESSES; p++)
        missing[p] = last[p] - path[PLACES * PROCESSES + p];
    for (int k = 0; k < PLACES; k++)
        for (int p = 0; p < PROCESSES; p++)
            path[(k + 1) * PROCESSES + p] += b->weight[k][p] * missing[p];
}

/* Drift of a sensor at the places of a block, and its growth to the next ones. */
INSTRUCTIONS static void add_up(const Errors *e, const ErrorStream *s, int64_t block, int64_t sensor)
{
    double path[(PLACES + 1) * PROCESSES], sums[PLACES + 1];
    double *value = s->sums + (block % 2 * e->sensors + sensor) * 2 * PLACES;
    connect(e, s, 0, block, sensor, path);
    for (int k = 0; k <= PLACES; k++) {
        sums[k] = path[k * PROCESSES];
        for (int p = 1; p < PROCESSES; p++)
            sums[k] += path[k * PROCESSES + p];
    }
    for (int k = 0; k < PLACES; k++) {
        value[k] = sums[k];
        value[PLACES + k] = sums[k + 1] - sums[k];
    }
}

/* Make the drift of one sensor in a block of a grid, 5 us, of all that a block of the first grid needs; false: it is all
   there. */
INSTRUCTIONS static bool make_drift(const Errors *e, ErrorStream *s, int64_t block)
{
    int64_t low[GRIDS], high[GRIDS];
    low[0] = high[0] = block;
    for (int grid = 1; grid < GRIDS; grid++) {
        low[grid] = low[grid - 1] / PLACES;
        high[grid] = (high[grid - 1] + 1) / PLACES;
    }
    for (int grid = GRIDS - 1; grid >= 0; grid--)
        for (int64_t number = low[grid]; number <= high[grid]; number++) {
            const int place = number % 2;
            if (s->number[grid][place] != number) {
                s->number[grid][place] = number;
                s->made[grid][place] = 0;
            }
            const int64_t sensor = s->made[grid][place];
            if (sensor == e->sensors)
                continue;
            s->made[grid][place]++;
            if (grid == 0)
                add_up(e, s, number, sensor);
            else
                connect(e, s, grid, number, sensor, find_path(e, s, grid, number, sensor));
            return true;
        }
    return false;
}

INLINE bool has_drift(const Errors *e, const ErrorStream *s, int64_t block)
{
    return s->number[0][block % 2] == block && s->made[0][block % 2] == e->sensors;
}

/* Errors of a sample, one for each sensor. */
INSTRUCTIONS static void find_errors(const Errors *e, ErrorStream *s, int64_t sample, double *errors)
{
    const int64_t block = sample / WHITE, k = sample % WHITE, group = k % (WHITE / 2) / AT_ONCE;
    const int64_t at = sample / s->stride, n = e->sensors, place = at % PLACES;
    if (s->block != block) {
        s->block = block;
        s->drawn = 0;
    }
    if (!(s->drawn >> group & 1) && s->deviation != 0.0)
        draw_white(e, s, group);
    for (int64_t i = 0; i < n; i++)
        errors[i] = s->deviation != 0.0 ? s->white[i * WHITE + k] * s->deviation : 0.0;
    if (!e->drifts)
        return;
    if (!has_drift(e, s, at / PLACES))
        while (make_drift(e, s, at / PLACES))
            ;
    const double share = (double)(sample % s->stride) / (double)s->stride;
    const double *value = s->sums + at / PLACES % 2 * n * 2 * PLACES + place;
    for (int64_t i = 0; i < n; i++, value += 2 * PLACES) {
        errors[i] += value[0];
        errors[i] += share * value[PLACES];
    }
}

/* A part of the work for the block of the drift that comes after a sample, where steps take `rate` samples. */
INSTRUCTIONS static void prepare_drift(const Errors *e, ErrorStream *s, int64_t sample, double rate)
{
    const int64_t next = sample / s->stride / PLACES + 1;
    const double samples = (double)s->stride * PLACES;
    if (!e->drifts || has_drift(e, s, next) || rate >= samples)
        return;
    const double steps = ((double)next * samples - (double)sample) / rate;
    int64_t parts = (int64_t)((double)(e->sensors + 1) / steps) + 1;
    while (parts-- > 0 && make_drift(e, s, next))
        ;
}

/* Errors of samples in ascending order, into rows of `width` numbers. */
INSTRUCTIONS static void make_errors(Errors *e, double interval, const int64_t *samples, int64_t n, double *rows, int64_t width)
{
    ErrorStream *s = find_stream(e, interval);
    for (int64_t i = 0; i < n; i++)
        find_errors(e, s, samples[i], rows + i * width);
}

/* White noise of unit variance for rows of numbers (voice_coil.py), `channels` each. */
INSTRUCTIONS static const double *find_white(White *w, int64_t sample)
{
    const int64_t block = sample / WHITE_ROWS, half = WHITE_ROWS / 2, k = sample % WHITE_ROWS;
    const int64_t group = k % half / AT_ONCE, all = half * w->channels, first = group * AT_ONCE * w->channels;
    if (w->block != block) {
        w->block = block;
        w->drawn = 0;
    }
    if (!(w->drawn >> group & 1)) {
        uint64_t key[2];
        w->words[w->n_words - 1] = (uint32_t)block;
        find_key(w->words, w->n_words, key);
        draw_part(key, 0, all, first, AT_ONCE * w->channels, w->rows + first, w->rows + all + first);
        w->drawn |= 1u << group;
    }
    return w->rows + k * w->channels;
}

INSTRUCTIONS static void make_white(White *w, int64_t first, int64_t n, double *rows)
{
    for (int64_t i = 0; i < n; i++)
        memcpy(rows + i * w->channels, find_white(w, first + i), sizeof *rows * (size_t)w->channels);
}

/* Noise of a sample of a tracker about x, y and z, of unit variance (line_of_sight.py). */
INSTRUCTIONS static void find_tracker_noise(const uint32_t *given, int64_t n_words, int64_t sample, double *noise)
{
    const int64_t first = sample % TRACKED * 3;
    uint32_t words[4];
    uint64_t key[2];
    double u[3 + 8], v[3 + 8], sines[3];
    memcpy(words, given, sizeof *words * (size_t)n_words);
    words[n_words - 1] = (uint32_t)(sample / TRACKED);
    find_key(words, n_words, key);
    draw_uniform(key, first, 3, u + 4);
    draw_uniform(key, 3 * TRACKED + first, 3, v + 4);
    make_normal(u + 4, v + 4, 3, noise, sines);
}
