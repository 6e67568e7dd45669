/* Vectors of three numbers and matrices of three rows. */
#ifndef PS_FMU_VECTORS_H
#define PS_FMU_VECTORS_H

/* Each operation rounds. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

static inline double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* c <- a b */
static inline void multiply(double a[3][3], double b[3][3], double c[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* The inverse; its determinant is the result. */
static inline double invert(double a[3][3], double inverse[3][3])
{
    double rows[3][3];
    cross(a[1], a[2], rows[0]);
    cross(a[2], a[0], rows[1]);
    cross(a[0], a[1], rows[2]);
    const double determinant = dot(a[0], rows[0]), by = 1.0 / determinant;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            inverse[i][j] = rows[j][i] * by;
    return determinant;
}

#endif
