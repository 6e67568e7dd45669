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
#define FINITE JOIN(finite, WIDTH)
#define PRODUCT JOIN(product, WIDTH)
#define MAP JOIN(map, WIDTH)

typedef double Vector __attribute__((vector_size(8 * WIDTH)));

/* n vectors of w, whose sums stay in registers.  Adds 0 w to `rest`, which is NaN then if one is not finite.  `columns`
   are places in x; NULL: all in order, which the compiler makes a loop of its own of. */
INSTRUCTIONS static inline __attribute__((always_inline)) void BLOCK(const double *matrix, int64_t stride,
                                                                     const int32_t *columns, const double *x,
                                                                     int64_t n_x, double *w, Vector *rest, const int n)
{
    Vector sums[8];
    for (int k = 0; k < n; k++)
        sums[k] = (Vector){0.0};
    for (int64_t j = 0; j < n_x; j++, matrix += stride) {
        const double operand = x[columns != NULL ? columns[j] : j];
        if (operand == 0.0)
            continue;
        for (int k = 0; k < n; k++)
            sums[k] += *(const Vector *)(matrix + k * WIDTH) * operand;
    }
    for (int k = 0; k < n; k++) {
        *(Vector *)(w + k * WIDTH) = sums[k];
        *rest += sums[k] * 0.0;
    }
}

/* `stride` rows of w. */
INSTRUCTIONS static inline __attribute__((always_inline)) void ROWS(const double *matrix, int64_t stride,
                                                                    const int32_t *columns, const double *x, int64_t n_x,
                                                                    double *w, Vector *rest)
{
    int64_t i = 0;
#define BLOCKS(n)                                                                                                      \
    for (; stride - i >= (n) * WIDTH; i += (n) * WIDTH)                                                                \
    BLOCK(matrix + i, stride, columns, x, n_x, w + i, rest, n)
    BLOCKS(8);
    BLOCKS(4);
    BLOCKS(2);
    BLOCKS(1);
#undef BLOCKS
}

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
    ROWS(matrix, stride, NULL, x, n_x, w, &rest);
    return FINITE(rest);
}

INSTRUCTIONS static bool MAP(const Map *map)
{
    Vector rest = {0.0};
    for (const Block *b = map->blocks; b < map->blocks + map->n_blocks; b++) {
        const double *matrix = map->numbers + b->number;
        double *w = map->work + b->row;
        if (map->columns == NULL)
            ROWS(matrix, b->n_rows, NULL, map->source, b->n_columns, w, &rest);
        else
            ROWS(matrix, b->n_rows, map->columns + b->column, map->source, b->n_columns, w, &rest);
    }
    return FINITE(rest);
}

#undef MAP
#undef PRODUCT
#undef FINITE
#undef ROWS
#undef BLOCK
#undef Vector
#undef JOIN
#undef JOIN_
#undef INSTRUCTIONS
#undef WIDTH
