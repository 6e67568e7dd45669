/* FILTER: the low-pass of filter.c by vectors of WIDTH doubles.  Included once for each set of instructions.

   Each number is 0 + h[0] x[0] + h[1] x[1] + ..., rounded after each operation and in this order: the same bits whatever
   the width, whichever columns and rows are beside it, and the same as numpy's (../lowpass.py). */

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define Vector JOIN(Vector, WIDTH)
#define PANEL JOIN(panel, WIDTH)
#define GROUP JOIN(group, WIDTH)
#define FILTER JOIN(filter, WIDTH)

/* As those of a double, for rows begin anywhere. */
typedef double Vector __attribute__((vector_size(8 * WIDTH), aligned(8)));

/* `outputs` rows and `vectors` vectors of columns of the result, whose sums stay in registers. */
INSTRUCTIONS static inline __attribute__((always_inline)) void PANEL(
    const Lowpass *filter, const double *rows, double *result, const int vectors, const int outputs)
{
    const double *taps = filter->taps;
    const int64_t columns = filter->columns, factor = filter->factor;
    const int64_t length = filter->length + (outputs - 1) * factor;
    Vector sums[OUTPUTS][VECTORS];
    for (int k = 0; k < outputs; k++)
        for (int v = 0; v < vectors; v++)
            sums[k][v] = (Vector){0.0};
    for (int64_t row = 0; row < length; row++, rows += columns)
        for (int k = 0; k < outputs; k++) {
            const double tap = taps[row - k * factor];
            for (int v = 0; v < vectors; v++)
                sums[k][v] += *(const Vector *)(rows + v * WIDTH) * tap;
        }
    for (int k = 0; k < outputs; k++)
        for (int v = 0; v < vectors; v++)
            *(Vector *)(result + k * columns + v * WIDTH) = sums[k][v];
}

/* `outputs` rows.  The last vectors end with the last column, and repeat some columns of those before. */
INSTRUCTIONS static inline __attribute__((always_inline)) void GROUP(
    const Lowpass *filter, const double *rows, double *result, const int outputs)
{
    const int64_t columns = filter->columns;
    int64_t column = 0;
    for (; columns - column >= VECTORS * WIDTH; column += VECTORS * WIDTH)
        PANEL(filter, rows + column, result + column, VECTORS, outputs);
    for (; columns - column >= WIDTH; column += WIDTH)
        PANEL(filter, rows + column, result + column, 1, outputs);
    if (column < columns && columns >= WIDTH)
        PANEL(filter, rows + columns - WIDTH, result + columns - WIDTH, 1, outputs);
    else if (column < columns)
        narrow_group(filter, rows, result, outputs);
}

INSTRUCTIONS static void FILTER(const Lowpass *filter, const double *rows, int64_t count, double *result)
{
    const int64_t columns = filter->columns, step = filter->factor * columns;
    int64_t k = 0;
    for (; count - k >= OUTPUTS; k += OUTPUTS) {
        /* The rows that the next group needs besides: no processor guesses them from panels of columns. */
        const char *next = (const char *)(rows + (k + OUTPUTS - 1) * step + filter->length * columns);
        if (count - k >= 2 * OUTPUTS)
            for (int64_t place = 0; place < OUTPUTS * step * 8; place += 64) /* B */
                __builtin_prefetch(next + place);
        GROUP(filter, rows + k * step, result + k * columns, OUTPUTS);
    }
    for (; k < count; k++)
        GROUP(filter, rows + k * step, result + k * columns, 1);
}

#undef JOIN_
#undef JOIN
#undef Vector
#undef PANEL
#undef GROUP
#undef FILTER
#undef WIDTH
#undef VECTORS
#undef INSTRUCTIONS
