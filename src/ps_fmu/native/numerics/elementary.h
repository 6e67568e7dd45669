/* Elementary functions by + - * / and sqrt alone: the same bits on every machine.  Errors are in units in the last place
   of the result, or of 1 where that is larger. */

INLINE double from_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

INLINE uint64_t to_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* log(x), 2^-1000 < x < 2^1000: x = 2^k (1 + f) around 1, log(1 + f) = 2 artanh(f / (2 + f)). */
INLINE double logarithm(double x)
{
    const uint64_t root = 0x3fe6a09e667f3bcdULL, one = 0x3ff0000000000000ULL, fraction = 0x000fffffffffffffULL;
    const uint64_t t = to_bits(x) + (one - root);
    const double k = from_bits(0x4330000000000000ULL | (t >> 52)) - (4503599627370496.0 + 1023.0);
    const double f = from_bits((t & fraction) + root) - 1.0;
    const double s = f / (2.0 + f), z = s * s;
    double sum = 1.0 / 21.0;
    for (int n = 19; n > 0; n -= 2) /* the next term is below 2e-17 */
        sum = sum * z + 1.0 / n;
    return k * 0.6931471805599453 + 2.0 * s * sum;
}

/* Cosine and sine of 2 pi v, |v| < 2^48: the nearest quarter of a turn, and the series of the rest. */
INLINE void turn(double v, double *cosine, double *sine)
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

enum { EXPONENTIAL_TERMS = 14 };

/* exp(x) = 2^k (1 + p) of x <= 700 with an error of 2 units; below -700 it is 0. */
INLINE double find_exponential(double x, double *p, double *power)
{
    const double inverse = 1.4426950408889634, high = 0.6931471803691238, low = 1.9082149292705877e-10; /* of log 2 */
    if (!(x > -700.0)) {
        *p = 0.0, *power = 0.0;
        return 0.0;
    }
    const double k = round_to_whole((x < 700.0 ? x : 700.0) * inverse), rest = (x - k * high) - k * low;
    double sum = 1.0;
    for (int n = EXPONENTIAL_TERMS; n > 1; n--)
        sum = 1.0 + sum * rest / n;
    *p = rest * sum;
    *power = from_bits((uint64_t)((int64_t)k + 1023) << 52);
    return *power + *power * *p;
}

/* exp(x) */
INLINE double exponential(double x)
{
    double p, power;
    return find_exponential(x, &p, &power);
}

/* exp(x) - 1, relatively as exact where x is small. */
INLINE double exponential_less_one(double x)
{
    double p, power;
    find_exponential(x, &p, &power);
    return power * p + (power - 1.0);
}
