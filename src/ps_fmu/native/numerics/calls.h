/* The functions of this library as calls that wait: each takes its arguments from one structure, so that whoever makes
   the call need not know them (calls.py). */

INSTRUCTIONS static void clear_rows(void *arguments)
{
    const Part *p = arguments;
    memset(p->block->rows + p->first, 0, sizeof(double) * (size_t)(p->end - p->first));
}

/* Numbers from 0 to below 1; `first` is a multiple of four, and behind the last number is room for three more. */
INSTRUCTIONS static void draw_numbers(void *arguments)
{
    const Part *p = arguments;
    uint64_t key[2];
    find_key(p->block->words, p->block->n_words, key);
    draw_uniform(key, p->first, p->end - p->first, p->block->draws + p->first);
}

INSTRUCTIONS static void draw_some_lines(void *arguments)
{
    const Part *p = arguments;
    const NoiseBlock *b = p->block;
    draw_lines(b->lines, b->draws, b->factor, b->sources, b->power, b->terms, p->first, p->end);
}

/* One phase of one group: those before it are so many as `first` says. */
INSTRUCTIONS static void store_phase(void *arguments)
{
    const Part *p = arguments;
    const NoiseBlock *b = p->block;
    const int64_t phase = p->first / b->lines->n_terms, group = p->first % b->lines->n_terms;
    const double *sizes = b->sizes + phase * b->lines->n_terms * b->lines->points;
    store_samples(b->lines, b->terms, phase, group, sizes, b->room, b->rows);
}

/* How many rows a call makes. */
INLINE int64_t take(Progress *left)
{
    const int64_t n = left->n < left->at_once ? left->n : left->at_once;
    left->n -= n;
    return n;
}

INSTRUCTIONS static void add_some_rows(void *arguments)
{
    TableRows *r = arguments;
    const int64_t n = take(&r->left);
    if (r->clear)
        memset(r->left.rows, 0, sizeof(double) * CHANNELS * (size_t)n);
    add_rows(r->tables, r->time, n, r->left.rows);
    r->time += n;
    r->left.rows += n * CHANNELS;
}

INSTRUCTIONS static void add_some_turns(void *arguments)
{
    WheelRows *r = arguments;
    const int64_t n = take(&r->left);
    add_wheel(r->turning, r->profile, r->time, n, r->room, r->left.rows);
    r->time += n;
    r->left.rows += n * CHANNELS;
}

INSTRUCTIONS static void draw_some_keyed(void *arguments)
{
    KeyedRows *r = arguments;
    for (int64_t n = take(&r->left); n > 0; n--) {
        draw_keyed(r->words, r->n_words, 1, r->half, r->left.rows);
        r->words[r->n_words - 1]++;
        r->left.rows += 2 * r->half;
    }
}

/* Have n blocks from `first` on in the room. */
INSTRUCTIONS static void fill_room(const ErrorRows *r, int64_t first, int64_t n)
{
    ErrorRoom *room = r->room;
    for (const ErrorKind *kind = r->kinds; kind < r->kinds + r->n_kinds; kind++) {
        const Errors *e = kind->errors;
        const int64_t drift = first * e->samples / e->stride / e->places - kind->first_drift;
        make_errors(e, first, n, kind->drift == NULL ? NULL : kind->drift + drift,
                    room->rows + kind->column, r->width);
    }
    room->first = first;
    room->n = n;
}

/* The rows of the next samples, from blocks that are in the room, or else from as many side by side as are made at once.
   Where no rows are left, nothing. */
INSTRUCTIONS static void make_some_errors(void *arguments)
{
    ErrorRows *r = arguments;
    if (r->left.n == 0)
        return;
    const int64_t first = r->index[0] / r->samples, end_of_room = r->room->first + r->room->n;
    const bool there = r->room->first <= first && first < end_of_room;
    const int64_t end = (there ? end_of_room : first + r->left.at_once) * r->samples;
    int64_t n = 1;
    while (n < r->left.n && r->index[n] < end)
        n++;
    if (!there)
        fill_room(r, first, r->index[n - 1] / r->samples + 1 - first);
    for (int64_t i = 0; i < n; i++, r->left.rows += r->width) {
        const double *from = r->room->rows + (r->index[i] - r->room->first * r->samples) * r->width;
        double *row = r->left.rows;
        memcpy(row, from, sizeof *row * (size_t)r->width);
        for (int64_t k = 0; k < r->width && r->bias != NULL; k++)
            row[k] += r->bias[k];
        for (int64_t k = 0; k < r->width && r->gain != NULL; k++)
            row[k] *= r->gain[k];
    }
    r->index += n;
    r->left.n -= n;
}
