/* FILTER: the low-pass of filter.c by vectors of WIDTH doubles.  Included once for each set of instructions.

   Each number is 0 + h[0] x[0] + h[1] x[1] + ..., rounded after each operation and in this order: the same bits whatever
   the width, whichever columns and rows are beside it, and the same as numpy's (../lowpass.py). */

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define Vector JOIN(Vector, WIDTH)
#define Bits JOIN(Bits, WIDTH)
#define ADD_ROWS JOIN(add_rows, WIDTH)
#define PANEL JOIN(panel, WIDTH)
#define GROUP JOIN(group, WIDTH)
#define PANELS JOIN(panels, WIDTH)
#define COMPARE JOIN(compare, WIDTH)
#define COMPARE_SOME JOIN(compare_some, WIDTH)
#define TILE JOIN(tile, WIDTH)
#define FILTER JOIN(filter, WIDTH)

/* As those of a double, for rows begin anywhere. */
typedef double Vector __attribute__((vector_size(8 * WIDTH), aligned(8)));
typedef int64_t Bits __attribute__((vector_size(8 * WIDTH), aligned(8)));

/* Rows from `row` up to `end` times their taps, into the sums of the outputs from `first` up to `last`. */
INSTRUCTIONS static inline __attribute__((always_inline)) void ADD_ROWS(
    const Lowpass *filter, const double *rows, const int64_t *places, Vector sums[OUTPUTS][VECTORS], int64_t row,
    int64_t end, const int vectors, const int first, const int last)
{
    for (const double *x = rows + row * filter->columns; row < end; row++, x += filter->columns)
        for (int k = first; k < last; k++) {
            const double tap = filter->taps[row - k * filter->factor];
            for (int v = 0; v < vectors; v++)
                sums[k][v] += *(const Vector *)(x + places[v]) * tap;
        }
}

/* `outputs` rows of the result, in the vectors of columns that begin at `places`; their sums stay in registers. */
INSTRUCTIONS static inline __attribute__((always_inline)) void PANEL(
    const Lowpass *filter, const double *rows, double *result, const int64_t *begin, const int vectors,
    const int outputs)
{
    const int64_t m = filter->factor, length = filter->length;
    int64_t places[VECTORS];
    Vector sums[OUTPUTS][VECTORS];
    for (int v = 0; v < vectors; v++)
        places[v] = begin[v];
    for (int k = 0; k < outputs; k++)
        for (int v = 0; v < vectors; v++)
            sums[k][v] = (Vector){0.0};
    if (outputs == OUTPUTS && length >= (OUTPUTS - 1) * m) {
        ADD_ROWS(filter, rows, places, sums, 0, m, vectors, 0, 1);
        ADD_ROWS(filter, rows, places, sums, m, 2 * m, vectors, 0, 2);
        ADD_ROWS(filter, rows, places, sums, 2 * m, 3 * m, vectors, 0, 3);
        ADD_ROWS(filter, rows, places, sums, 3 * m, length, vectors, 0, 4);
        ADD_ROWS(filter, rows, places, sums, length, length + m, vectors, 1, 4);
        ADD_ROWS(filter, rows, places, sums, length + m, length + 2 * m, vectors, 2, 4);
        ADD_ROWS(filter, rows, places, sums, length + 2 * m, length + 3 * m, vectors, 3, 4);
    } else {
        ADD_ROWS(filter, rows, places, sums, 0, length + (outputs - 1) * m, vectors, 0, outputs);
    }
    for (int k = 0; k < outputs; k++)
        for (int v = 0; v < vectors; v++)
            *(Vector *)(result + k * filter->columns + places[v]) = sums[k][v];
}

INSTRUCTIONS static void GROUP(
    const Lowpass *filter, const double *rows, double *result, const int64_t *places, int vectors, int outputs)
{
    switch (outputs == OUTPUTS ? vectors : -vectors) {
    case 1:
        PANEL(filter, rows, result, places, 1, OUTPUTS);
        break;
    case 2:
        PANEL(filter, rows, result, places, 2, OUTPUTS);
        break;
#if VECTORS == 4
    case 3:
        PANEL(filter, rows, result, places, 3, OUTPUTS);
        break;
    case 4:
        PANEL(filter, rows, result, places, 4, OUTPUTS);
        break;
#endif
    default:
        for (int v = 0; v < vectors; v++)
            PANEL(filter, rows, result, places + v, 1, 1);
    }
}

/* `count` rows of the result, in `n` vectors of columns. */
INSTRUCTIONS static void PANELS(
    const Lowpass *filter, const double *rows, int64_t count, double *result, const int64_t *places, int64_t n)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    while (n > 0) {
        const int64_t panels = (n + VECTORS - 1) / VECTORS;
        const int vectors = (int)((n + panels - 1) / panels); /* equally many in each: one alone would wait for its sums */
        int64_t k = 0;
        for (; count - k >= OUTPUTS; k += OUTPUTS)
            GROUP(filter, rows + k * step, result + k * columns, places, vectors, OUTPUTS);
        for (; k < count; k++)
            GROUP(filter, rows + k * step, result + k * columns, places, vectors, 1);
        places += vectors;
        n -= vectors;
    }
}

/* In which bits the numbers of `n` vectors of columns, at `begin`, differ in `count` rows, into `changes` (columns). */
INSTRUCTIONS static inline __attribute__((always_inline)) void COMPARE_SOME(
    const double *rows, int64_t count, int64_t columns, const int64_t *begin, int64_t *changes, const int n)
{
    Bits first[COMPARED], found[COMPARED];
    int64_t places[COMPARED];
    for (int v = 0; v < n; v++) {
        places[v] = begin[v];
        first[v] = *(const Bits *)(rows + places[v]);
        found[v] = (Bits){0};
    }
    for (int64_t row = 1; row < count; row++)
        for (int v = 0; v < n; v++)
            found[v] |= *(const Bits *)(rows + row * columns + places[v]) ^ first[v];
    for (int v = 0; v < n; v++)
        *(Bits *)(changes + places[v]) = found[v];
}

/* In which bits the numbers of each column differ in `count` rows, into `changes` (columns). */
INSTRUCTIONS static void COMPARE(const double *rows, int64_t count, int64_t columns, int64_t *changes)
{
    int64_t places[COMPARED];
    for (int64_t column = 0; column < columns;) {
        int n = 0;
        for (; n < COMPARED && column < columns; column += WIDTH)
            places[n++] = column + WIDTH <= columns ? column : columns - WIDTH;
        if (n == COMPARED)
            COMPARE_SOME(rows, count, columns, places, changes, COMPARED);
        else
            for (int v = 0; v < n; v++)
                COMPARE_SOME(rows, count, columns, places + v, changes, 1);
    }
}

/* As FILTER, for rows that fit into the cache. */
INSTRUCTIONS static void TILE(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns;
    int64_t *changes = filter->room, *places = filter->room + columns;
    COMPARE(rows, (count - 1) * filter->factor + filter->length, columns, changes);
    /* Columns that rest first: what is computed with them of others is written over. */
    for (int rests = 1; rests >= 0; rests--) {
        int64_t n = 0;
        for (int64_t column = 0; column < columns; column++)
            if ((changes[column] == 0) == rests) {
                places[n] = column + WIDTH <= columns ? column : columns - WIDTH;
                column = places[n++] + WIDTH - 1;
            }
        PANELS(filter, rows, rests ? 1 : count, result, places, n);
        for (int64_t k = 1; rests && k < count; k++)
            for (int64_t v = 0; v < n; v++)
                *(Vector *)(result + k * columns + places[v]) = *(const Vector *)(result + places[v]);
    }
}

INSTRUCTIONS static void FILTER(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    if (columns < WIDTH) {
        narrow(filter, rows, count, result);
        return;
    }
    const int64_t groups = TILE_BYTES / (8 * step * OUTPUTS), most = OUTPUTS * (groups > 1 ? groups : 1);
    for (int64_t k = 0; k < count; k += most)
        TILE(filter, rows + k * step, count - k < most ? count - k : most, result + k * columns);
}

#undef JOIN_
#undef JOIN
#undef Vector
#undef Bits
#undef ADD_ROWS
#undef PANEL
#undef GROUP
#undef PANELS
#undef COMPARE
#undef COMPARE_SOME
#undef TILE
#undef FILTER
#undef WIDTH
#undef VECTORS
#undef COMPARED
#undef INSTRUCTIONS
