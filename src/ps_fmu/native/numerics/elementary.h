/* Logarithm and exponential, the same bits on all processors. */

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
