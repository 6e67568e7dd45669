/* Cosine and sine, the same bits on all processors. */
#ifndef PS_FMU_ANGLES_H
#define PS_FMU_ANGLES_H

#include <stdint.h>
#include <string.h>

/* Each operation rounds. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#define ANGLES_INLINE static inline __attribute__((always_inline))

static const double ROUND = 6755399441055744.0; /* 1.5 * 2^52: a sum with it is rounded to a whole number */

ANGLES_INLINE double from_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

ANGLES_INLINE uint64_t to_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* Cosine and sine of 2 pi v, |v| < 2^48: the nearest quarter of a turn, and the series of the rest. */
ANGLES_INLINE void turn(double v, double *cosine, double *sine)
{
    static const double COSINE[] = {1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
                                    1.0 / 40320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0};
    static const double SINE[] = {-1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0,
                                  -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0};
    const double shifted = 4.0 * v + ROUND;
    const uint64_t quarter = to_bits(shifted);
    const double rest = (v - 0.25 * (shifted - ROUND)) * 6.283185307179586, square = rest * rest;
    double c = COSINE[0], s = SINE[0];
    for (int n = 1; n < 9; n++)
        c = c * square + COSINE[n];
    for (int n = 1; n < 8; n++)
        s = s * square + SINE[n];
    s = s * rest;
    /* By each quarter, (c, s) becomes (-s, c). */
    const uint64_t swapped = -(quarter & 1);
    const uint64_t a = to_bits(c), b = to_bits(s), both = (a ^ b) & swapped;
    *cosine = from_bits((a ^ both) ^ (((quarter + 1) & 2) << 62));
    *sine = from_bits((b ^ both) ^ ((quarter & 2) << 62));
}

/* Cosine and sine of an angle in rad, each within 4e-16 (1 + |angle|) of the true value. */
ANGLES_INLINE void find_cosine_sine(double angle, double *cosine, double *sine)
{
    turn(angle * 0.15915494309189535, cosine, sine);
}

#endif
