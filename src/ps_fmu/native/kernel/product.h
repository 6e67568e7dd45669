/* w = M x by vectors of WIDTH doubles: the function PRODUCT for one matrix, MAP for the blocks of a map.  Included by
   kernel.c once for each set of instructions.

   Each element of w is 0 + M[i][0] x[0] + M[i][1] x[1] + ..., rounded after each operation and in this order: the same
   bits whatever the width, and the same as numpy's (plain.py).  Where x[j] is 0 or -0, nothing is added: M is finite, and
   a sum that begins with 0 is never -0, so that adding 0 or -0 changes no bit of it.  For the same reason blocks may
   leave out zeros of M, as long as x is finite. */

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define Vector JOIN(Vector, WIDTH)
#define BLOCK JOIN(block, WIDTH)
#define ROWS JOIN(rows, WIDTH)
#define DENSE_ROWS JOIN(dense_rows, WIDTH)
#define FINITE JOIN(finite, WIDTH)
#define PRODUCT JOIN(product, WIDTH)
#define MAP JOIN(map, WIDTH)

typedef double Vector __attribute__((vector_size(8 * WIDTH)));

/* n vectors of w, whose sums stay in registers; `rest` and 0 w, which is NaN if one of them is not finite.  `columns` are
   places in x; of a dense matrix they are all, in order, and not looked up: 0.3 ns a column. */
INSTRUCTIONS static inline __attribute__((always_inline)) Vector BLOCK(const double *matrix, int64_t stride,
                                                                       const bool dense, const int32_t *columns,
                                                                       const double *x, int64_t n_x, double *w,
                                                                       Vector rest, const int n)
{
    Vector sums[8];
    for (int k = 0; k < n; k++)
        sums[k] = (Vector){0.0};
    for (int64_t j = 0; j < n_x; j++, matrix += stride) {
        const double *operand = &x[dense ? j : columns[j]];
        if (is_zero(operand))
            continue;
        __asm__("" : "+r"(operand)); /* read it again, not from the register of the test: 6 % of a map */
        for (int k = 0; k < n; k++)
            sums[k] += *(const Vector *)(matrix + k * WIDTH) * *operand;
    }
    for (int k = 0; k < n; k++) {
        *(Vector *)(w + k * WIDTH) = sums[k];
        rest += sums[k] * 0.0;
    }
    return rest;
}

/* `stride` rows of w, eight vectors at once: each sum waits for its last addition, so that eight sums take little longer
   than one. */
#define DEFINE_ROWS(name, dense)                                                                                       \
    INSTRUCTIONS static Vector name(const double *matrix, int64_t stride, const int32_t *columns, const double *x,     \
                                    int64_t n_x, double *w, Vector rest)                                               \
    {                                                                                                                  \
        int64_t i = 0;                                                                                                 \
        for (; stride - i >= 8 * WIDTH; i += 8 * WIDTH)                                                                \
            rest = BLOCK(matrix + i, stride, dense, columns, x, n_x, w + i, rest, 8);                                  \
        switch ((stride - i) / WIDTH) {                                                                                \
            CASE(1, dense) CASE(2, dense) CASE(3, dense) CASE(4, dense) CASE(5, dense) CASE(6, dense) CASE(7, dense)   \
        }                                                                                                              \
        return rest;                                                                                                   \
    }
#define CASE(n, dense)                                                                                                 \
    case n:                                                                                                            \
        rest = BLOCK(matrix + i, stride, dense, columns, x, n_x, w + i, rest, n);                                      \
        break;
DEFINE_ROWS(DENSE_ROWS, true)
DEFINE_ROWS(ROWS, false)
#undef CASE
#undef DEFINE_ROWS

/* Whether no element of `rest` is NaN. */
INSTRUCTIONS static inline bool FINITE(Vector rest)
{
    double sum = 0.0;
    for (int k = 0; k < WIDTH; k++)
        sum += rest[k];
    return sum == 0.0;
}

INSTRUCTIONS static bool PRODUCT(const double *matrix, int64_t stride, const double *x, int64_t n_x, double *w)
{
    Vector rest = {0.0};
    rest = DENSE_ROWS(matrix, stride, NULL, x, n_x, w, rest);
    return FINITE(rest);
}

INSTRUCTIONS static bool MAP(const Map *map)
{
    Vector rest = {0.0};
    for (const Block *b = map->blocks; b < map->blocks + map->n_blocks; b++) {
        const double *matrix = map->numbers + b->number;
        const int32_t *columns = map->columns + b->column;
        double *w = map->work + b->row;
        if (b->n_columns > 0 && columns[b->n_columns - 1] - columns[0] == b->n_columns - 1) /* side by side */
            rest = DENSE_ROWS(matrix, b->n_rows, NULL, map->source + columns[0], b->n_columns, w, rest);
        else
            rest = ROWS(matrix, b->n_rows, columns, map->source, b->n_columns, w, rest);
    }
    return FINITE(rest);
}

#undef MAP
#undef PRODUCT
#undef FINITE
#undef DENSE_ROWS
#undef ROWS
#undef BLOCK
#undef Vector
#undef JOIN
#undef JOIN_
#undef INSTRUCTIONS
#undef WIDTH
