/* Rows as numbers, and the largest magnitude in them. */

enum { PART_BYTES = 1 << 14 }; /* of rows that stay in the first cache */

/* The largest magnitude of n values; not a number, if one of them is infinite or none. */
INSTRUCTIONS static double find_peak(const double *values, int64_t n)
{
    double peaks[LANES] = {0.0}, faults[LANES] = {0.0};
    int64_t i = 0;
    for (; n - i >= LANES; i += LANES)
        for (int lane = 0; lane < LANES; lane++) {
            const double value = values[i + lane], size = fabs(value);
            peaks[lane] = size > peaks[lane] ? size : peaks[lane];
            faults[lane] += value - value; /* 0, or not a number */
        }
    double peak = 0.0, fault = 0.0;
    for (int lane = 0; lane < LANES; lane++) {
        peak = peaks[lane] > peak ? peaks[lane] : peak;
        fault += faults[lane];
    }
    for (; i < n; i++) {
        const double size = fabs(values[i]);
        peak = size > peak ? size : peak;
        fault += values[i] - values[i];
    }
    return peak + fault;
}

/* `count` C ints become as many doubles: the last one first, for they lie in the places of the doubles. */
INLINE void widen(double *places, int64_t count)
{
    for (int64_t k = count - 1; k >= 0; k--) {
        int32_t number;
        memcpy(&number, (const char *)places + k * (int64_t)sizeof number, sizeof number);
        places[k] = number;
    }
}

/* `count` rows of numbers, each `reals` doubles and then C ints: these become doubles, too, in the places that they have
   as such.  What find_peak says of all numbers is returned.  From the last row, which was written last, to the first: the
   second cache has not room for all of a usual block, and who looks at them next begins with the first. */
INSTRUCTIONS static double complete_rows(double *rows, int64_t count, int64_t columns, int64_t reals)
{
    const int64_t part = PART_BYTES / (8 * columns) > 1 ? PART_BYTES / (8 * columns) : 1;
    double peak = 0.0, fault = 0.0;
    for (int64_t end = count; end > 0; end -= part) {
        const int64_t some = end < part ? end : part;
        double *begin = rows + (end - some) * columns;
        for (int64_t row = 0; row < some; row++)
            widen(begin + row * columns + reals, columns - reals);
        const double size = find_peak(begin, some * columns);
        peak = size > peak ? size : peak;
        fault += size - size; /* 0, or not a number */
    }
    return peak + fault;
}
