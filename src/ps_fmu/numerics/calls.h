/* The functions of this library as calls that wait: each takes its arguments from one structure, so that whoever makes
   the call need not know them (calls.py). */

INSTRUCTIONS static void clear_rows(const void *arguments)
{
    const Part *p = arguments;
    memset(p->block->rows + p->first, 0, sizeof(double) * (size_t)(p->end - p->first));
}

/* Numbers from 0 to below 1; `first` is a multiple of four, and behind the last number is room for three more. */
INSTRUCTIONS static void draw_numbers(const void *arguments)
{
    const Part *p = arguments;
    uint64_t key[2];
    find_key(p->block->words, p->block->n_words, key);
    draw_uniform(key, p->first, p->end - p->first, p->block->draws + p->first);
}

INSTRUCTIONS static void draw_some_lines(const void *arguments)
{
    const Part *p = arguments;
    const NoiseBlock *b = p->block;
    draw_lines(b->lines, b->draws, b->factor, b->sources, b->power, b->terms, p->first, p->end);
}

/* One phase of one group: those before it are so many as `first` says. */
INSTRUCTIONS static void store_phase(const void *arguments)
{
    const Part *p = arguments;
    const NoiseBlock *b = p->block;
    const int64_t phase = p->first / b->lines->n_terms, group = p->first % b->lines->n_terms;
    store_samples(b->lines, b->terms, phase, group, b->sizes[phase], b->room, b->rows);
}

INSTRUCTIONS static void add_some_rows(const void *arguments)
{
    const TableRows *r = arguments;
    add_rows(r->tables, r->time, r->n, r->rows);
}

INSTRUCTIONS static void add_some_turns(const void *arguments)
{
    const WheelRows *r = arguments;
    add_wheel(r->turning, r->profile, r->time, r->n, r->room, r->rows);
}

INSTRUCTIONS static void draw_some_keyed(const void *arguments)
{
    const KeyedRows *r = arguments;
    draw_keyed(r->words, r->n_words, r->n, r->half, r->rows);
}

INSTRUCTIONS static void make_some_errors(const void *arguments)
{
    const ErrorRows *r = arguments;
    make_errors(r->errors, r->block, r->n_blocks, r->drift, r->rows, r->width);
}

/* Rows in any order, with what is added to them, and then what they are multiplied by. */
INSTRUCTIONS static void gather(const void *arguments)
{
    const Gather *g = arguments;
    for (int64_t i = 0; i < g->n; i++) {
        const double *from = g->from + (g->index[i] - g->first) * g->width;
        double *row = g->rows + i * g->width;
        memcpy(row, from, sizeof *row * (size_t)g->width);
        if (g->bias != NULL)
            for (int64_t k = 0; k < g->width; k++)
                row[k] += g->bias[k];
        if (g->gain != NULL)
            for (int64_t k = 0; k < g->width; k++)
                row[k] *= g->gain[k];
    }
}
