/* What turns with the multiples of an angle. */

/* exp(i multiple angle) for some angles: by series of as few multiples as there must be, the others are products. */
INLINE void turn_all(const Turning *t, const double *angle, int64_t n, double (*turned)[2][PART])
{
    for (int64_t k = 0; k < t->n_multiples; k++) {
        const double multiple = t->multiples[k];
        for (int64_t i = 0; i < n; i++)
            turn(multiple * angle[i], &turned[k][0][i], &turned[k][1][i]);
    }
    double(*made)[2][PART] = turned + t->n_multiples;
    for (const Product *p = t->products; p < t->products + t->n_products; p++, made++) {
        const double(*one)[PART] = (const double(*)[PART])turned[p->one];
        const double(*other)[PART] = (const double(*)[PART])turned[p->other];
        const double sign = p->conjugate ? -1.0 : 1.0;
        for (int64_t i = 0; i < n; i++) {
            const double c = one[0][i], s = one[1][i], d = other[0][i], r = sign * other[1][i];
            (*made)[0][i] = c * d - s * r;
            (*made)[1][i] = c * r + s * d;
        }
    }
}

typedef struct {
    Vector re, im;
} Pair;

/* The sum of amplitude times exp(i multiple angle) over some lines, for WIDTH angles from `angle` on. */
INLINE Pair sum_lines(const double (*turned)[2][PART], int64_t angle, const int64_t *which, const double (*amplitude)[2],
                      int64_t n)
{
    Pair sum = {{0.0}, {0.0}};
    for (int64_t k = 0; k < n; k++) {
        const Vector c = *(const Vector *)&turned[which[k]][0][angle], s = *(const Vector *)&turned[which[k]][1][angle];
        sum.re += amplitude[k][0] * c - amplitude[k][1] * s;
        sum.im += amplitude[k][0] * s + amplitude[k][1] * c;
    }
    return sum;
}

/* Add the first sums at `n` angles, n <= PART, each multiplied by its sizes. */
INLINE void add_part(const Turning *t, const double *angle, int64_t n, const double *const *sizes, int64_t n_terms,
                     double *room, double *wrench)
{
    double padded[3][PART], made[CHANNELS][PART];
    double(*turned)[2][PART] = (double(*)[2][PART])room;
    const double(*amplitude)[2] = (const double(*)[2])t->amplitudes;
    const int64_t n_torque = t->n_lines - t->n_force;
    turn_all(t, angle, n, turned);
    for (int64_t term = 0; term < n_terms; term++)
        for (int64_t i = 0; i < PART; i++)
            padded[term][i] = i < n ? sizes[term][i] : 0.0;
    for (int64_t i = 0; i < n; i += WIDTH) {
        Pair force = {{0.0}, {0.0}}, torque = {{0.0}, {0.0}};
        for (int64_t term = 0; term < n_terms; term++) {
            const Vector size = *(const Vector *)&padded[term][i];
            const double(*of)[2] = amplitude + term * t->n_lines;
            const Pair one = sum_lines((const double(*)[2][PART])turned, i, t->which, of, t->n_force);
            const Pair other = sum_lines((const double(*)[2][PART])turned, i, t->which + t->n_force,
                                         of + t->n_force, n_torque);
            force.re += size * one.re, force.im += size * one.im;
            torque.re += size * other.re, torque.im += size * other.im;
        }
        for (int c = 0; c < CHANNELS; c++) {
            Vector sum = t->along[0][c] * force.re + t->along[1][c] * force.im;
            if (c >= CHANNELS / 2)
                sum += t->along[2][c] * torque.re + t->along[3][c] * torque.im;
            *(Vector *)&made[c][i] = sum;
        }
    }
    for (int64_t i = 0; i < n; i++, wrench += CHANNELS)
        for (int c = 0; c < CHANNELS; c++)
            wrench[c] += made[c][i];
}

/* The last of ascending times (n), n >= 2, that is not after `at`, but not the last of all; the first where all are. */
INLINE int64_t find_row(const double *time, int64_t n, double at)
{
    int64_t low = 0, high = n - 1;
    while (high - low > 1) {
        const int64_t middle = low + (high - low) / 2;
        if (time[middle] > at)
            high = middle;
        else
            low = middle;
    }
    return low;
}

/* Angle since the first row of a table (SpeedTable of turning.py), and speed and acceleration. */
INLINE double follow_table(const Profile *p, double time, double *speed, double *acceleration)
{
    const int64_t last = p->n_rows - 1, at = find_row(p->times, p->n_rows, time);
    const double first = p->times[0], end = p->times[last], slope = p->slopes[at];
    const double held = time < first ? first : time > end ? end : time, since = held - p->times[at];
    const double before = time - first < 0.0 ? time - first : 0.0, after = time - end > 0.0 ? time - end : 0.0;
    *speed = time >= end ? p->speeds[last] : time < first ? p->speeds[0] : slope * since + p->speeds[at];
    *acceleration = time >= first && time < end ? slope : 0.0;
    return p->turned[at] + since * (p->speeds[at] + 0.5 * slope * since) + p->speeds[0] * before +
           p->speeds[last] * after;
}

/* The same of SpeedProfile, since t = 0. */
INLINE double follow_ramp(const Profile *p, double time, double *speed, double *acceleration)
{
    const double change = p->final - p->initial, rate = p->duration > 0.0 ? change / p->duration : 0.0;
    const double per_square = p->duration > 0.0 ? 0.5 / p->duration : 0.0;
    const double since = time - p->start, within = limit(since, p->duration);
    const bool before = since < 0.0, after = since >= p->duration;
    const double beyond = after ? since - p->duration : 0.0;
    const double turned = within * within * per_square + (beyond > 0.0 ? beyond : 0.0);
    *speed = before ? p->initial : after ? p->final : p->initial + rate * since;
    *acceleration = before || after ? 0.0 : rate;
    return p->initial * time + (change != 0.0 ? change * turned : 0.0); /* it may be infinite */
}

/* Angles, and the sizes of the sums: with e = (cos, sin) and d = (-sin, cos) of h angle, of the harmonic h it is
   -(R e/h^2)'' = R W^2 e - (R W' + 2 R' W) d/h - R'' e/h^2.  Returns how many sums there are. */
INLINE int64_t follow(const Profile *p, const double *time, int64_t n, double *angle, double (*sizes)[PART])
{
    double speed[PART], acceleration[PART], x[PART], value[PART], slope[PART], bend[PART];
    bool changing = false, bent = false;
    if (p->n_rows > 0)
        for (int64_t i = 0; i < n; i++)
            angle[i] = follow_table(p, time[i], &speed[i], &acceleration[i]) - p->turned_before;
    else
        for (int64_t i = 0; i < n; i++)
            angle[i] = follow_ramp(p, time[i], &speed[i], &acceleration[i]);
    for (int64_t i = 0; i < n; i++)
        x[i] = limit(time[i] / p->rise_time, 1.0);
    rise(x, n, value, slope, bend);
    for (int64_t i = 0; i < n; i++) {
        sizes[0][i] = value[i] * speed[i] * speed[i];
        sizes[1][i] = -(value[i] * acceleration[i] + 2.0 * speed[i] * (slope[i] / p->rise_time));
        sizes[2][i] = -bend[i] / (p->rise_time * p->rise_time);
    }
    for (int64_t i = 0; i < n; i++) {
        changing = changing || sizes[1][i] != 0.0;
        bent = bent || sizes[2][i] != 0.0;
    }
    return bent ? 3 : changing ? 2 : 1;
}

INSTRUCTIONS static void add_wheel(void *source, const double *time, int64_t n, double *rows)
{
    const Wheel *w = source;
    double angle[PART], sizes[3][PART];
    const double *const all[] = {sizes[0], sizes[1], sizes[2]};
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        const int64_t n_terms = follow(&w->profile, time + first, m, angle, sizes);
        add_part(&w->turning, angle, m, all, n_terms, w->room, rows + first * CHANNELS);
    }
}
