/* What makes up the wrench on the bus beside noise and wheels, and the step of their sum (total.py). */

/* cos and sin of 2 pi v; of what is too far away for them, of 0. */
INLINE void turn_any(double v, double *cosine, double *sine)
{
    turn(fabs(v) < 281474976710656.0 ? v : 0.0, cosine, sine);
}

/* Rows += size times a wrench. */
INLINE void add_sizes(const double *size, const double *wrench, int64_t n, double *rows)
{
    for (int64_t i = 0; i < n; i++, rows += CHANNELS)
        for (int c = 0; c < CHANNELS; c++)
            rows[c] += size[i] * wrench[c];
}

/* d2/dt2 (W G) with G = -sin(w t + phase) / w^2. */
INSTRUCTIONS static void add_tone(void *source, const double *time, int64_t n, double *rows)
{
    const Tone *s = source;
    const double omega = 6.283185307179586 * s->frequency;
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        double x[PART], value[PART], slope[PART], bend[PART], size[PART];
        for (int64_t i = 0; i < m; i++)
            x[i] = limit(time[first + i] / s->rise_time, 1.0);
        rise(x, m, value, slope, bend);
        for (int64_t i = 0; i < m; i++) {
            double cosine, sine;
            turn_any(s->frequency * time[first + i] + s->phase, &cosine, &sine);
            const double rate = slope[i] / s->rise_time, curvature = bend[i] / (s->rise_time * s->rise_time);
            size[i] = value[i] * sine + 2.0 * rate * (-cosine / omega) + curvature * (-sine / (omega * omega));
        }
        add_sizes(size, s->wrench, m, rows + first * CHANNELS);
    }
}

/* Turns since the start of a sweep: the integral of its frequency. */
INLINE double find_turns(const Chirp *s, double elapsed)
{
    if (s->rate != 0.0) /* the frequency grows by exp(rate t) */
        return s->initial * exponential_less_one(s->rate * elapsed) / s->rate;
    return s->initial * elapsed + 0.5 * (s->final - s->initial) / s->duration * (elapsed * elapsed);
}

INSTRUCTIONS static void add_chirp(void *source, const double *time, int64_t n, double *rows)
{
    const Chirp *s = source;
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        double elapsed[PART], x[2][PART], fade[2][PART], rest[2][PART], size[PART];
        for (int64_t i = 0; i < m; i++) {
            elapsed[i] = limit(time[first + i] - s->start, s->duration);
            x[0][i] = limit(elapsed[i] / s->rise_time, 1.0);
            x[1][i] = limit((s->duration - elapsed[i]) / s->rise_time, 1.0);
        }
        rise(x[0], m, fade[0], rest[0], rest[1]);
        rise(x[1], m, fade[1], rest[0], rest[1]);
        for (int64_t i = 0; i < m; i++) {
            double cosine, sine;
            turn_any(find_turns(s, elapsed[i]), &cosine, &sine);
            size[i] = fade[0][i] * fade[1][i] * sine;
        }
        add_sizes(size, s->wrench, m, rows + first * CHANNELS);
    }
}

/* How many of ascending times come before one. */
INLINE int64_t count_before(const double *time, int64_t n, double end)
{
    int64_t low = 0;
    for (int64_t high = n; low < high;) {
        const int64_t middle = low + (high - low) / 2;
        if (time[middle] < end)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

INSTRUCTIONS static void add_multisine(void *source, const double *time, int64_t n, double *rows)
{
    const Multisine *s = source;
    const int64_t first = count_before(time, n, 0.0), risen = count_before(time, n, s->rise_time);
    for (const RisingTable *t = s->tables; t < s->tables + s->n_tables; t++) {
        add_rows(&t->rising, time + first, risen - first, rows + first * CHANNELS);
        add_rows(&t->steady, time + risen, n - risen, rows + risen * CHANNELS);
    }
}

INLINE void add_between(const Track *t, double at, double *row)
{
    const int64_t before = find_row(t->time, t->n, at);
    const double *one = t->wrench + before * CHANNELS, *other = one + CHANNELS;
    const double part = (at - t->time[before]) / (t->time[before + 1] - t->time[before]);
    for (int c = 0; c < CHANNELS; c++)
        row[c] += one[c] + part * (other[c] - one[c]);
}

INSTRUCTIONS static void add_recording(void *source, const double *time, int64_t n, double *rows)
{
    const Recording *s = source;
    const double begin = s->steady.time[0], end = s->steady.time[s->steady.n - 1], period = end - begin;
    const double slack = 1e-9 * period; /* for times that are sums of steps: the last row acts */
    for (int64_t i = 0; i < n; i++, rows += CHANNELS) {
        const double t = time[i];
        if (s->repeats) {
            double rest = fmod(t - begin, period);
            rest = rest < 0.0 ? rest + period : rest;
            if (!s->has_first || t >= end)
                add_between(&s->steady, begin + rest, rows);
            else if (t >= begin)
                add_between(&s->first, t, rows);
        } else if (t >= begin - slack && t <= end + slack) {
            add_between(&s->first, t < begin ? begin : t > end ? end : t, rows);
        }
    }
}

/* Force and torque (n, CHANNELS) at ascending times (n). */
INSTRUCTIONS static void add_sources(const Source *s, const double *time, int64_t n, double *rows)
{
    memset(rows, 0, sizeof(double) * CHANNELS * (size_t)n);
    for (const AddedSource *one = s->sources; one < s->sources + s->n_sources; one++)
        one->add(one->source, time, n, rows);
}

/* The row of the step under way: with some of the next ones, as several take little longer; but not where steps have just
   changed. */
INSTRUCTIONS static const double *find_source_row(Source *s, const Core *core, double start, int64_t at_once)
{
    enum { SETTLED = 4 /* steps of the same size */ };
    const int64_t count = core->count;
    if (s->origin != core->origin || s->step != core->step || s->start != start || count < s->first || count >= s->end) {
        double time[ROWS_AT_ONCE];
        s->origin = core->origin, s->step = core->step, s->start = start;
        s->first = count;
        s->end = count < SETTLED ? count + 1 : (count / at_once + 1) * at_once;
        for (int64_t k = count; k < s->end; k++)
            time[k - count] = core->origin + (double)(k + 1) * core->step - start;
        add_sources(s, time, s->end - count, s->rows);
    }
    return s->rows + (count - s->first) * CHANNELS;
}

/* What steps of a size (s) make of a frequency, into a text of MOST_TEXT bytes; 0: nothing. */
INSTRUCTIONS static int64_t explain_alias(const Alias *a, double step, char *text)
{
    const double f = a->frequency, rate = 1.0 / step;
    if (!(f * step > 0.5))
        return 0;
    if (*a->what == '\0')
        snprintf(text, MOST_TEXT, "noise up to %g Hz in steps of %g s: what lies above %g Hz is taken for lower frequencies; "
                 "set noise.band.max to %g Hz or less, or make steps of %.2g s", f, step, 0.5 / step, 0.4 / step, 0.4 / f);
    else
        snprintf(text, MOST_TEXT, "%s at %.5g Hz is above half the rate of steps of %g s: it acts at %.5g Hz instead; take "
                 "steps below %.2g s", a->what, f, step, fabs(f - rate * round_to_whole(f / rate)), 0.5 / f);
    return 1;
}

/* Warn of aliases, of one a step; of each again only where steps become longer. */
INSTRUCTIONS static void warn_of_aliases(Source *s, Core *core)
{
    char text[MOST_TEXT];
    while (s->next_alias < s->n_aliases)
        if (explain_alias(&s->aliases[s->next_alias++], core->step, text)) {
            write_message(core, MESSAGE_WARNING, "%s", text);
            return;
        }
    s->next_alias = 0;
    s->checked_step = core->step;
}

/* An element: the wrench at the end of a step, and a part of the work for later ones. */
INSTRUCTIONS static int64_t step_source(void *arguments, Core *core)
{
    Source *s = arguments;
    const double start = core->data[s->start_place], step = core->step;
    const double time = core->origin + (double)(core->count + 1) * step - start;
    const bool dense = (double)(4 * ROWS_AT_ONCE) * step < s->shortest;
    if (!(fabs(time) <= s->latest)) {
        write_message(core, MESSAGE_REFUSAL, "%g s after the start of the experiment: expected at most %g s", time,
                      s->latest);
        return CALL_REFUSED;
    }
    const int64_t known = s->end;
    const double *row = find_source_row(s, core, start, dense ? ROWS_AT_ONCE : 1);
    bool busy = dense && s->end != known;
    memcpy(core->data + s->target, row, sizeof(double) * CHANNELS);
    if (s->noise != NULL)
        for (int64_t k = 0; k < s->noise->n_layers; k++)
            busy = work_ahead(&s->noise->layers[k], time, dense ? ROWS_AT_ONCE * step : 0.0, step, busy) || busy;
    if (step > s->checked_step)
        warn_of_aliases(s, core);
    return CALL_DONE;
}
