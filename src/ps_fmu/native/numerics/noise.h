/* Endless Gaussian noise (gaussian.py), whose blocks are made in parts of some 10 us each. */

enum {
    NUMBERS = 2048, /* drawn in a part, a multiple of four */
    LINES = 64,     /* made in a part */
    FOLDS = 4,      /* parts that a spectrum is made in */
    PARTS = FOLDS + 8 /* of the samples of a phase and group */
};

/* Value, slope and bend of the polynomial from 0 to 1 (ramp of spectrum.py) at some places from 0 to 1. */
INLINE void rise(const double *place, int64_t n, double *value, double *slope, double *bend)
{
    for (int64_t i = 0; i < n; i++) {
        const double x = place[i];
        value[i] = ((((70.0 * x - 315.0) * x + 540.0) * x - 420.0) * x + 126.0) * x * x * x * x * x;
        slope[i] = ((((630.0 * x - 2520.0) * x + 3780.0) * x - 2520.0) * x + 630.0) * x * x * x * x;
        bend[i] = ((((5040.0 * x - 17640.0) * x + 22680.0) * x - 12600.0) * x + 2520.0) * x * x * x;
    }
}

/* 0 of what is no number. */
INLINE double limit(double x, double upper)
{
    return x > 0.0 ? (x < upper ? x : upper) : 0.0;
}

INLINE int64_t divide_up(int64_t n, int64_t by)
{
    return (n + by - 1) / by;
}

INLINE double find_start(const NoiseLayer *l, int64_t block)
{
    return (double)(block - 1) * 0.5 * l->period;
}

/* What the terms of a phase are multiplied by in a block that rises: its window times the rise from 0 at t = 0. */
INSTRUCTIONS static void find_sizes(const NoiseLayer *l, double start, int64_t phase)
{
    const int64_t n = l->lines.points, n_terms = l->lines.n_terms;
    const double *window = l->windows + phase * n_terms * n;
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        double x[PART], value[PART], slope[PART], bend[PART], *size = l->sizes + first;
        const double *w = window + first;
        for (int64_t i = 0; i < m; i++) {
            const double elapsed = (double)(l->lines.phases * (first + i) + phase) / l->rate;
            x[i] = limit((start + elapsed) / l->rise_time, 1.0);
        }
        rise(x, m, value, slope, bend);
        for (int64_t i = 0; i < m; i++)
            size[i] = w[i] * value[i];
        for (int64_t i = 0; i < m && n_terms > 1; i++) {
            const double rate = slope[i] / l->rise_time, curvature = bend[i] / (l->rise_time * l->rise_time);
            size[n + i] = w[n + i] * value[i] + w[i] * (2.0 * rate);
            size[2 * n + i] = w[2 * n + i] * value[i] + w[n + i] * rate + w[i] * curvature;
        }
    }
}

INLINE int64_t count_draws(const NoiseLayer *l)
{
    return divide_up(2 * l->sources * l->lines.n, NUMBERS);
}

INLINE int64_t count_parts(const NoiseLayer *l)
{
    return count_draws(l) + divide_up(l->lines.n, LINES) + PARTS * l->lines.phases * l->lines.n_terms;
}

INLINE int64_t find_place(int64_t block)
{
    return wrap(block, BLOCKS);
}

/* A part of the samples of one phase and group: of their transform, of their sizes, and of their place among the rows. */
INSTRUCTIONS static void make_samples(NoiseLayer *l, int64_t part, double *rows)
{
    const Lines *lines = &l->lines;
    const int64_t phase = part / PARTS / lines->n_terms, group = part / PARTS % lines->n_terms, half = lines->points / 2;
    const double start = find_start(l, l->making), *sizes = l->windows + phase * lines->n_terms * lines->points;
    const double *turns = lines->turns + 2 * phase * lines->n;
    const Lanes *terms = (const Lanes *)l->terms + group * lines->n;
    Lanes *room = (Lanes *)l->room, *other = room + half + 1;
    const bool rises = start < l->rise_time;
    sizes = rises ? l->sizes : sizes;
    const int64_t step = part % PARTS - FOLDS; /* from -FOLDS to 7 */
    if (step == -FOLDS) {
        memset(room, 0, sizeof *room * (size_t)(half + 1));
        return;
    }
    if (step <= 0) {
        fold(lines, terms, turns, room, (step + FOLDS - 1) * lines->n / FOLDS, (step + FOLDS) * lines->n / FOLDS);
        return;
    }
    switch (step) {
    case 1:
        pair_up(room, half, lines->roots);
        l->product = 1;
        l->samples = l->room;
        return;
    case 2:
    case 3:
    case 4:
        other = l->samples == l->room ? other : room;
        l->samples = (double *)transform((Lanes *)l->samples, other, half, lines->roots, &l->product,
                                         step < 4 ? step - 1 : INT64_MAX);
        return;
    case 5:
        if (rises && group == 0)
            find_sizes(l, start, phase);
        return;
    case 6:
        store_samples(lines, l->samples, phase, group, sizes, 0, half, rows);
        return;
    default:
        store_samples(lines, l->samples, phase, group, sizes, half, lines->points, rows);
    }
}

/* The next part of the block under way. */
INSTRUCTIONS static void make_part(NoiseLayer *l)
{
    const int64_t place = find_place(l->making), n_draws = count_draws(l), n_lines = divide_up(l->lines.n, LINES);
    int64_t part = l->done++;
    if (part < n_draws) {
        const int64_t first = part * NUMBERS, n = 2 * l->sources * l->lines.n - first;
        uint64_t key[2];
        l->words[l->n_words - 1] = (uint32_t)l->making;
        find_key(l->words, l->n_words, key);
        draw_uniform(key, first, n < NUMBERS ? n : NUMBERS, l->draws + first);
    } else if ((part -= n_draws) < n_lines) {
        const int64_t end = (part + 1) * LINES;
        draw_lines(&l->lines, l->draws, l->factor, l->sources, l->power, l->terms, part * LINES,
                   end < l->lines.n ? end : l->lines.n);
    } else {
        make_samples(l, part - n_lines, l->rows[place]);
    }
    if (l->done < count_parts(l))
        return;
    l->number[place] = l->making;
    l->making = NONE;
}

INLINE bool has_block(const NoiseLayer *l, int64_t block)
{
    return l->number[find_place(block)] == block;
}

/* Have a block under way.  It takes the place of another one. */
INLINE void begin_block(NoiseLayer *l, int64_t block)
{
    if (l->making == block)
        return;
    l->making = block;
    l->done = 0;
    l->number[find_place(block)] = NONE;
}

INSTRUCTIONS static const double *get_block(NoiseLayer *l, int64_t block)
{
    if (!has_block(l, block)) {
        begin_block(l, block);
        while (l->making != NONE)
            make_part(l);
    }
    return l->rows[find_place(block)];
}

/* The whole number of hops before a time, as Python divides. */
INLINE int64_t find_hop(const NoiseLayer *l, double time)
{
    const double hop = 0.5 * l->period;
    if (!(fabs(time) < FARTHEST))
        return 0;
    const double rest = fmod(time, hop);
    return (int64_t)round_to_whole((time - rest) / hop) - (rest < 0.0);
}

/* Blocks i and i + 1 are alive from i to i + 1 hops. */
INSTRUCTIONS static void add_layer(NoiseLayer *l, const double *time, int64_t n, double *rows)
{
    for (int64_t first = 0, end; first < n; first = end) {
        const int64_t hop = find_hop(l, time[first]);
        for (end = n; find_hop(l, time[end - 1]) != hop;)
            end = end - first > 2 * PART ? first + (end - first) / 2 : end - 1;
        const double *one = get_block(l, hop), *other = get_block(l, hop + 1);
        const int64_t points = l->lines.points * l->lines.phases;
        const Tables both = {one, other, points, points / 2, 0, (double)hop * 0.5 * l->period, l->rate};
        add_rows(&both, time + first, end - first, rows + first * CHANNELS);
    }
}

INSTRUCTIONS static void add_noise(void *source, const double *time, int64_t n, double *rows)
{
    const Noise *noise = source;
    for (int64_t k = 0; k < noise->n_layers; k++)
        add_layer(&noise->layers[k], time, n, rows);
}

/* Make some parts of the block that comes next, so that it is there when rows up to `ahead` (s) after a time reach it:
   evenly spread over steps, but one a step until that is caught up with.  `busy`: none, as long as they can wait.
   Whether any were made. */
INSTRUCTIONS static bool work_ahead(NoiseLayer *l, double time, double ahead, double step, bool busy)
{
    const int64_t hop = find_hop(l, time), next = hop + 2, parts = count_parts(l);
    const double length = 0.5 * l->period, left_time = (double)(hop + 1) * length - time - ahead;
    if (step >= length || has_block(l, next))
        return false;
    int64_t left = parts - (l->making == next ? l->done : 0);
    const double steps = left_time / step, share = 1.0 - left_time / (length - ahead);
    if (steps >= 1.0) {
        const bool can_wait = (double)(parts - left) >= (double)parts * share || (busy && steps > 2.0 * (double)left);
        left = can_wait ? 0 : (int64_t)((double)left / steps) + 1;
    }
    if (left > 0)
        begin_block(l, next);
    for (int64_t k = 0; k < left && l->making == next; k++)
        make_part(l);
    return left > 0;
}
