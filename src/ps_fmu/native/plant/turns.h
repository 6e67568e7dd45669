/* Vectors, attitudes and rotations of the plant's step. */
#ifndef PS_FMU_TURNS_H
#define PS_FMU_TURNS_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

static void cross(const double a[3], const double b[3], double c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static double largest(const double *a, const double *b, int n)
{
    double found = 0.0;
    for (int k = 0; k < n; k++) {
        const double value = fabs(b == NULL ? a[k] : a[k] - b[k]);
        found = value > found ? value : found;
    }
    return found;
}

static double clip(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* sin(a) / a and (1 - cos(a)) / a^2 of a small angle, from its square: 1e-17 up to 0.5 rad. */
static void find_series(double square, double *sine, double *cosine)
{
    const double s = square;
    *sine = 1.0 - 1.0 / 6.0 * s * (1.0 - 1.0 / 20.0 * s * (1.0 - 1.0 / 42.0 * s * (1.0 - 1.0 / 72.0 * s *
            (1.0 - 1.0 / 110.0 * s))));
    *cosine = 0.5 - 1.0 / 24.0 * s * (1.0 - 1.0 / 30.0 * s * (1.0 - 1.0 / 56.0 * s * (1.0 - 1.0 / 90.0 * s *
              (1.0 - 1.0 / 132.0 * s))));
}

/* q <- q turned by a small rotation vector in its own axes. */
static void turn_attitude(double q[4], const double turn[3])
{
    double sine, cosine, r[4], v[3], norm = 0.0;
    find_series(0.25 * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]), &sine, &cosine);
    r[0] = 1.0 - 0.25 * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]) * cosine;
    for (int k = 0; k < 3; k++)
        r[1 + k] = 0.5 * sine * turn[k];
    cross(q + 1, r + 1, v);
    const double scalar = q[0] * r[0] - (q[1] * r[1] + q[2] * r[2] + q[3] * r[3]);
    for (int k = 0; k < 3; k++)
        v[k] += q[0] * r[1 + k] + r[0] * q[1 + k];
    norm = sqrt(scalar * scalar + v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    q[0] = scalar / norm;
    for (int k = 0; k < 3; k++)
        q[1 + k] = v[k] / norm;
}

/* R <- a small rotation vector, in the axes that R leads to, after R; row by row. */
static void turn_rotation(double R[9], const double turn[3])
{
    double sine, cosine;
    find_series(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2], &sine, &cosine);
    for (int k = 0; k < 3; k++) {
        const double column[3] = {R[k], R[3 + k], R[6 + k]};
        double once[3], twice[3];
        cross(turn, column, once);
        cross(turn, once, twice);
        for (int i = 0; i < 3; i++)
            R[3 * i + k] += sine * once[i] + cosine * twice[i];
    }
}

/* Components in inertial axes of a vector in B, or (`back`) the other way round. */
static void rotate(const double q[4], const double v[3], bool back, double result[3])
{
    const double axis[3] = {back ? -q[1] : q[1], back ? -q[2] : q[2], back ? -q[3] : q[3]};
    double once[3], twice[3];
    cross(axis, v, once);
    cross(axis, once, twice);
    for (int k = 0; k < 3; k++)
        result[k] = v[k] + 2.0 * (q[0] * once[k] + twice[k]);
}

#endif
