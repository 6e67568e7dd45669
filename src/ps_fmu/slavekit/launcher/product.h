/* w = M x by vectors of WIDTH doubles, as the function PRODUCT.  Included by kernel.c once for each set of instructions.

   Each element of w is 0 + M[i][0] x[0] + M[i][1] x[1] + ..., rounded after each operation and in this order: the same
   bits whatever the width, and the same as numpy's (plain.py).  Where x[j] is 0 or -0, nothing is added: M is finite, and
   a sum that begins with 0 is never -0, so that adding 0 or -0 changes no bit of it. */

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define Vector JOIN(Vector, WIDTH)
#define BLOCK JOIN(block, WIDTH)

typedef double Vector __attribute__((vector_size(8 * WIDTH)));

/* n vectors of w, whose sums stay in registers.  Adds 0 w to `rest`, which is NaN then if one is not finite. */
INSTRUCTIONS static inline __attribute__((always_inline)) void BLOCK(const double *matrix, int64_t stride, const double *x,
                                                                     int64_t n_x, double *w, Vector *rest, const int n)
{
    Vector sums[8];
    for (int k = 0; k < n; k++)
        sums[k] = (Vector){0.0};
    for (int64_t j = 0; j < n_x; j++, matrix += stride) {
        if (x[j] == 0.0)
            continue;
        for (int k = 0; k < n; k++)
            sums[k] += *(const Vector *)(matrix + k * WIDTH) * x[j];
    }
    for (int k = 0; k < n; k++) {
        *(Vector *)(w + k * WIDTH) = sums[k];
        *rest += sums[k] * 0.0;
    }
}

INSTRUCTIONS static bool PRODUCT(const double *matrix, int64_t stride, const double *x, int64_t n_x, double *w)
{
    Vector rest = {0.0};
    int64_t i = 0;
#define BLOCKS(n)                                                                                                      \
    for (; stride - i >= (n) * WIDTH; i += (n) * WIDTH)                                                                \
    BLOCK(matrix + i, stride, x, n_x, w + i, &rest, n)
    BLOCKS(8);
    BLOCKS(4);
    BLOCKS(2);
    BLOCKS(1);
#undef BLOCKS
    double sum = 0.0;
    for (int k = 0; k < WIDTH; k++)
        sum += rest[k];
    return sum == 0.0;
}

#undef BLOCK
#undef Vector
#undef JOIN
#undef JOIN_
#undef INSTRUCTIONS
#undef PRODUCT
#undef WIDTH
