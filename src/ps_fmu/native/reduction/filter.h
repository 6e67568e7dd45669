/* A low-pass on the columns of rows, of which it keeps each m-th: y[k] = sum_j h[j] x[k m + j].

   Each number is 0 + h[0] x[0] + h[1] x[1] + ..., rounded after each operation and in this order: the same bits whatever
   the width, whichever columns and rows are beside it.  A column whose numbers do not change comes out as one number,
   too: it is computed once.  In the default system that is nearly half of them. */

/* Rows that come out together, so that a row which goes in is fetched once for them; bytes of the rows that the passes
   go over in turn, so that they stay in the second cache. */
enum { OUTPUTS = 4, TILE_BYTES = 1 << 18 };

/* Fewer columns than a vector has places: one after the other. */
INSTRUCTIONS static void narrow(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    for (int64_t k = 0; k < count; k++)
        for (int64_t column = 0; column < columns; column++) {
            double sum = 0.0;
            for (int64_t j = 0; j < filter->length; j++)
                sum += rows[k * step + j * columns + column] * filter->taps[j];
            result[k * columns + column] = sum;
        }
}

/* As those of a double, for rows begin anywhere. */
typedef double Vector __attribute__((vector_size(8 * WIDTH), aligned(8)));
typedef int64_t Bits __attribute__((vector_size(8 * WIDTH), aligned(8)));

/* Rows from `row` up to `end` times their taps, into the sums of the outputs from `first` up to `last`. */
INLINE void add_rows(
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
INLINE void make_panel(
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
        add_rows(filter, rows, places, sums, 0, m, vectors, 0, 1);
        add_rows(filter, rows, places, sums, m, 2 * m, vectors, 0, 2);
        add_rows(filter, rows, places, sums, 2 * m, 3 * m, vectors, 0, 3);
        add_rows(filter, rows, places, sums, 3 * m, length, vectors, 0, 4);
        add_rows(filter, rows, places, sums, length, length + m, vectors, 1, 4);
        add_rows(filter, rows, places, sums, length + m, length + 2 * m, vectors, 2, 4);
        add_rows(filter, rows, places, sums, length + 2 * m, length + 3 * m, vectors, 3, 4);
    } else {
        add_rows(filter, rows, places, sums, 0, length + (outputs - 1) * m, vectors, 0, outputs);
    }
    for (int k = 0; k < outputs; k++)
        for (int v = 0; v < vectors; v++)
            *(Vector *)(result + k * filter->columns + places[v]) = sums[k][v];
}

INSTRUCTIONS static void make_group(
    const Lowpass *filter, const double *rows, double *result, const int64_t *places, int vectors, int outputs)
{
    switch (outputs == OUTPUTS ? vectors : -vectors) {
    case 1:
        make_panel(filter, rows, result, places, 1, OUTPUTS);
        break;
    case 2:
        make_panel(filter, rows, result, places, 2, OUTPUTS);
        break;
#if VECTORS == 4
    case 3:
        make_panel(filter, rows, result, places, 3, OUTPUTS);
        break;
    case 4:
        make_panel(filter, rows, result, places, 4, OUTPUTS);
        break;
#endif
    default:
        for (int v = 0; v < vectors; v++)
            make_panel(filter, rows, result, places + v, 1, 1);
    }
}

/* `count` rows of the result, in `n` vectors of columns. */
INSTRUCTIONS static void make_panels(
    const Lowpass *filter, const double *rows, int64_t count, double *result, const int64_t *places, int64_t n)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    while (n > 0) {
        const int64_t panels = (n + VECTORS - 1) / VECTORS;
        const int vectors = (int)((n + panels - 1) / panels); /* equally many in each: one alone would wait for its sums */
        int64_t k = 0;
        for (; count - k >= OUTPUTS; k += OUTPUTS)
            make_group(filter, rows + k * step, result + k * columns, places, vectors, OUTPUTS);
        for (; k < count; k++)
            make_group(filter, rows + k * step, result + k * columns, places, vectors, 1);
        places += vectors;
        n -= vectors;
    }
}

/* In which bits the numbers of `n` vectors of columns, at `begin`, differ in `count` rows, into `changes` (columns). */
INLINE void compare_some(
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
INSTRUCTIONS static void compare(const double *rows, int64_t count, int64_t columns, int64_t *changes)
{
    int64_t places[COMPARED];
    for (int64_t column = 0; column < columns;) {
        int n = 0;
        for (; n < COMPARED && column < columns; column += WIDTH)
            places[n++] = column + WIDTH <= columns ? column : columns - WIDTH;
        if (n == COMPARED)
            compare_some(rows, count, columns, places, changes, COMPARED);
        else
            for (int v = 0; v < n; v++)
                compare_some(rows, count, columns, places + v, changes, 1);
    }
}

/* As filter_rows, for rows that fit into the cache. */
INSTRUCTIONS static void make_tile(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns;
    int64_t *changes = filter->room, *places = filter->room + columns;
    compare(rows, (count - 1) * filter->factor + filter->length, columns, changes);
    /* Columns that rest first: what is computed with them of others is written over. */
    for (int rests = 1; rests >= 0; rests--) {
        int64_t n = 0;
        for (int64_t column = 0; column < columns; column++)
            if ((changes[column] == 0) == rests) {
                places[n] = column + WIDTH <= columns ? column : columns - WIDTH;
                column = places[n++] + WIDTH - 1;
            }
        make_panels(filter, rows, rests ? 1 : count, result, places, n);
        for (int64_t k = 1; rests && k < count; k++)
            for (int64_t v = 0; v < n; v++)
                *(Vector *)(result + k * columns + places[v]) = *(const Vector *)(result + places[v]);
    }
}

INSTRUCTIONS static void filter_rows(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    if (columns < WIDTH) {
        narrow(filter, rows, count, result);
        return;
    }
    const int64_t groups = TILE_BYTES / (8 * step * OUTPUTS), most = OUTPUTS * (groups > 1 ? groups : 1);
    for (int64_t k = 0; k < count; k += most)
        make_tile(filter, rows + k * step, count - k < most ? count - k : most, result + k * columns);
}
