#include "profile.h"

#include <math.h>

#include "../numerics/angles.h"
#include "vectors.h"

/* Peaks of |x'|, |x''|, |x'''| of a transfer over unit distance in unit time: 35/16, 84 sqrt(5)/25, 105/2. */
static const double PEAK_RATE = 2.1875, PEAK_ACCELERATION = 7.513188404399293, PEAK_JERK = 52.5;
/* How far the sum of brake and transfer may exceed the limits, relatively.  At the full rate, a transfer in the same
   direction would otherwise have to wait for the brake: 10 % more halves the time in the worst cases tried. */
static const double REDIRECTION_EXCESS = 0.1;
static const double SLACK = 1e-3; /* for sampling and rounding of a profile that just meets its limits */

/* Samples of tau for each of the two parts, at which a profile is held against its limits; durations that are tried,
   relative to a lower bound. */
enum { SAMPLES = 33, BRAKES = 100, TRANSFERS = 60 };
static const double SHORTEST_BRAKE = 0.5, LONGER = 1.03;

static double find_length(const double *x)
{
    return sqrt(dot(x, x));
}

/* x^(1/3), x >= 0, by Newton's method from above; exponents are divided by three first. */
static double find_cube_root(double x)
{
    if (!(x > 0.0 && x <= 1e300))
        return x > 0.0 ? 1e100 : 0.0;
    double root = from_bits(to_bits(x) / 3 + (UINT64_C(0x3ff) << 52) / 3 * 2); /* within 12 % */
    for (int k = 0; k < 6; k++)
        root -= (root * root * root - x) / (3.0 * root * root);
    return root;
}

void profile_hold(Profile *p, double time, const double *position)
{
    *p = (Profile){time, 0.0, 0.0, {{0.0}}, {0.0}};
    for (int k = 0; k < 3; k++)
        p->start[0][k] = p->target[k] = position[k];
}

/* Where a brake of this duration ends: the stop that lowers the polynomial's degree to 6 (b_3 = 0). */
static void find_natural_stop(Motions start, double T, Vector stop)
{
    for (int k = 0; k < 3; k++)
        stop[k] = start[0][k] + start[1][k] * T / 2.0 + start[2][k] * (T * T) / 10.0 + start[3][k] * (T * T * T) / 120.0;
}

/* b_0 to b_3 of the polynomial from `start` to rest at `end`. */
static void find_factors(Motions start, const double *end, double T, Vector *b)
{
    for (int k = 0; k < 3; k++) {
        const double c0 = start[0][k] - end[k], c1 = start[1][k] * T;
        const double c2 = start[2][k] * (T * T) / 2.0, c3 = start[3][k] * (T * T * T) / 6.0;
        b[0][k] = c0;
        b[1][k] = c1 + 4.0 * c0;
        b[2][k] = c2 + 4.0 * c1 + 10.0 * c0;
        b[3][k] = c3 + 4.0 * c2 + 10.0 * c1 + 20.0 * c0;
    }
}

/* (1 - tau)^4 tau^i and its derivatives up to an order, at most 3, in time (Leibniz), for i = 0 to 3. */
static inline void find_powers(double tau, double T, int order, double (*power)[4])
{
    const double q = 1.0 - tau, q2 = q * q, tau2 = tau * tau, by = 1.0 / T;
    const double outer[4] = {q2 * q2, -4.0 * q2 * q, 12.0 * q2, -24.0 * q};
    const double inner[4][4] = {
        {1.0, tau, tau2, tau2 * tau}, {0.0, 1.0, 2.0 * tau, 3.0 * tau2}, {0.0, 0.0, 2.0, 6.0 * tau}, {0.0, 0.0, 0.0, 6.0}};
    const double by2 = by * by, by3 = by2 * by;
    for (int i = 0; i < 4; i++) {
        power[0][i] = outer[0] * inner[0][i];
        power[1][i] = (outer[1] * inner[0][i] + outer[0] * inner[1][i]) * by;
        if (order < 2)
            continue;
        power[2][i] = (outer[2] * inner[0][i] + 2.0 * outer[1] * inner[1][i] + outer[0] * inner[2][i]) * by2;
        power[3][i] = (outer[3] * inner[0][i] + 3.0 * outer[2] * inner[1][i] + 3.0 * outer[1] * inner[2][i] +
                       outer[0] * inner[3][i]) * by3;
    }
}

/* Add a part, relative to its end, where tau is below 1. */
static inline void add_part(Vector *b, double T, double elapsed, int order, Motions motions)
{
    if (!(T > 0.0 && elapsed < T))
        return;
    double power[4][4];
    find_powers(elapsed > 0.0 ? elapsed / T : 0.0, T, order, power);
    for (int n = 0; n <= order; n++)
        for (int k = 0; k < 3; k++)
            motions[n][k] += power[n][0] * b[0][k] + power[n][1] * b[1][k] + power[n][2] * b[2][k] + power[n][3] * b[3][k];
}

/* Both parts of a profile. */
typedef struct {
    Vector brake[4], transfer[4];
} Parts;

static void find_parts(const Profile *p, Parts *parts)
{
    Vector stop;
    Motions rest = {{0.0}};
    Motions *start = (Motions *)&p->start;
    find_natural_stop(*start, p->brake, stop);
    find_factors(*start, stop, p->brake, parts->brake);
    for (int k = 0; k < 3; k++)
        rest[0][k] = stop[k];
    find_factors(rest, p->target, p->transfer, parts->transfer);
}

static void follow_parts(const Profile *p, Parts *parts, double time, int order, Motions motions)
{
    for (int n = 0; n <= order; n++)
        for (int k = 0; k < 3; k++)
            motions[n][k] = 0.0;
    if (time < profile_end(p)) { /* although (end - start_time) / duration may round below 1 */
        add_part(parts->brake, p->brake, time - p->start_time, order, motions);
        add_part(parts->transfer, p->transfer, time - p->start_time, order, motions);
    }
    for (int k = 0; k < 3; k++)
        motions[0][k] = p->target[k] + motions[0][k];
}

void profile_follow(const Profile *p, double time, int order, Motions motions)
{
    Parts parts;
    find_parts(p, &parts);
    follow_parts(p, &parts, time, order, motions);
}

static double find_transfer_duration(double distance, const Limits *limits)
{
    if (distance == 0.0)
        return 0.0;
    double longest = limits->min_duration;
    const double by[3] = {PEAK_RATE * distance / limits->rate, sqrt(PEAK_ACCELERATION * distance / limits->acceleration),
                          find_cube_root(PEAK_JERK * distance / limits->jerk)};
    for (int k = 0; k < 3; k++)
        longest = by[k] > longest ? by[k] : longest;
    return longest;
}

/* 140 tau^3 (1 - tau)^3 and its first two derivatives: rate, acceleration and jerk of a transfer over unit distance in unit
   time. */
static inline void find_transfer(double tau, double *s)
{
    const double q = 1.0 - tau, both = tau * q;
    s[0] = 140.0 * both * both * both;
    s[1] = 420.0 * both * both * (1.0 - 2.0 * tau);
    s[2] = 840.0 * both * (1.0 - 5.0 * both);
}

/* Rate, acceleration and jerk of a brake in unit time from unit rate, acceleration and jerk, [n][of which]. */
static inline void find_brake(double tau, double (*phi)[3])
{
    static const double b[3][3] = {{-1.0 / 2.0, -1.0, -1.0}, {-1.0 / 10.0, -4.0 / 10.0, -1.0 / 2.0},
                                   {-1.0 / 120.0, -4.0 / 120.0, -10.0 / 120.0}};
    const double q = 1.0 - tau, q2 = q * q;
    for (int i = 0; i < 3; i++) {
        const double p = b[i][0] + tau * (b[i][1] + tau * b[i][2]), slope = b[i][1] + 2.0 * tau * b[i][2];
        const double bend = 2.0 * b[i][2];
        phi[0][i] = q2 * q * (q * slope - 4.0 * p);
        phi[1][i] = q2 * (q2 * bend - 8.0 * q * slope + 12.0 * p);
        phi[2][i] = q * (-12.0 * q2 * bend + 36.0 * q * slope - 24.0 * p);
    }
}

/* A search for a duration: of the brake, without a transfer, or of the transfer with this brake. */
typedef struct {
    double products[4][4]; /* of rate, acceleration and jerk of the start and the distance of the transfer */
    double scaled[4][4];   /* the same, the motion in units of time of the brake's duration */
    double per_allowed[3]; /* of rate, acceleration and jerk; 1 / square */
    double brake, per_brake;
    int transferring;
    int worst;             /* the sample that was last found beyond what is allowed */
    double of_brake[SAMPLES][3][3], of_transfer[SAMPLES][3]; /* find_brake and find_transfer of each sample of tau */
} Search;

static void fill_samples(Search *search)
{
    for (int k = 0; k < SAMPLES; k++) {
        find_brake(k * (1.0 / (SAMPLES - 1)), search->of_brake[k]);
        find_transfer(k * (1.0 / (SAMPLES - 1)), search->of_transfer[k]);
    }
}

static void set_brake(Search *search, double brake)
{
    const double scale[4] = {brake, brake * brake, brake * brake * brake, 1.0};
    search->brake = brake;
    search->per_brake = 1.0 / brake;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            search->scaled[i][j] = search->products[i][j] * (scale[i] * scale[j]);
}

static inline double at_most_one(double x)
{
    return x < 1.0 ? x : 1.0;
}

/* The largest ratio of a derivative to what is allowed at a sample, squared: brake and transfer at a time.  `duration`,
   and 1 / duration: of the transfer. */
static inline double find_excess_at(const Search *search, double duration, double per_duration, int sample)
{
    const double(*G)[4] = search->scaled;
    double made[3][3], moved[3] = {0.0, 0.0, 0.0}, largest = 0.0, brake = 1.0, transfer = 1.0;
    const double(*phi)[3] = search->of_brake[sample < SAMPLES ? sample : 0];
    const double *s = moved;
    if (sample >= SAMPLES) { /* of the transfer's duration */
        s = search->of_transfer[sample - SAMPLES];
        find_brake(at_most_one((sample - SAMPLES) * (1.0 / (SAMPLES - 1)) * duration * search->per_brake), made);
        phi = (const double(*)[3])made;
    } else if (search->transferring)
        find_transfer(at_most_one(sample * (1.0 / (SAMPLES - 1)) * search->brake * per_duration), moved);
    for (int n = 0; n < 3; n++) {
        brake *= search->per_brake;
        transfer *= per_duration;
        const double x = phi[n][0] * brake, y = phi[n][1] * brake, z = phi[n][2] * brake;
        double square = x * (G[0][0] * x + 2.0 * (G[0][1] * y + G[0][2] * z)) + y * (G[1][1] * y + 2.0 * G[1][2] * z) +
                        z * (G[2][2] * z);
        if (search->transferring) {
            const double d = s[n] * transfer;
            square += d * (2.0 * (G[0][3] * x + G[1][3] * y + G[2][3] * z) + G[3][3] * d);
        }
        const double ratio = square * search->per_allowed[n];
        largest = ratio > largest ? ratio : largest;
    }
    return largest;
}

/* The same of all samples, from the worst one on to both sides, up to the first that is above `least`. */
static double find_excess(Search *search, double duration, double least)
{
    const int n = search->transferring ? 2 * SAMPLES : SAMPLES, begin = search->worst;
    if (!search->transferring)
        set_brake(search, duration);
    const double per_duration = 1.0 / duration;
    double largest = find_excess_at(search, duration, per_duration, begin);
    for (int k = 2; k < 2 * n && largest <= least; k++) {
        const int sample = k % 2 == 0 ? begin + k / 2 : begin - k / 2;
        if (sample < 0 || sample >= n)
            continue;
        const double excess = find_excess_at(search, duration, per_duration, sample);
        if (excess > largest) {
            largest = excess;
            search->worst = sample;
        }
    }
    return largest;
}

/* The first duration within what is allowed, else that with the least excess; `*excess`: that is squared.

   Where a duration is found beyond what is allowed, the next one mostly is, too, and one sample suffices to refuse it.
   These samples are lower bounds: durations are looked at wholly from the lowest bound on, until none is left below the
   least excess. */
static double choose(Search *search, double shortest, int n, double *excess)
{
    double bound[BRAKES], duration[BRAKES];
    int best = 0;
    for (int k = 0; k < n; k++, shortest *= LONGER) {
        duration[k] = shortest;
        *excess = bound[k] = find_excess(search, shortest, 1.0);
        if (bound[k] <= 1.0)
            return shortest;
    }
    *excess = INFINITY;
    for (int tried = 0; tried < n; tried++) {
        int next = 0;
        for (int k = 1; k < n; k++)
            next = bound[k] < bound[next] ? k : next;
        if (!(bound[next] < *excess))
            break;
        const double found = find_excess(search, duration[next], *excess);
        if (found < *excess || (found == *excess && next < best)) {
            *excess = found;
            best = next;
        }
        bound[next] = INFINITY;
    }
    return duration[best];
}

/* Products of the motion of the start, from its rate on, and the distance. */
static void multiply_motions(Motions start, const double *distance, double (*products)[4])
{
    const double *of[4] = {start[1], start[2], start[3], distance};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            products[i][j] = dot(of[i], of[j]);
}

void profile_plan(Profile *p, double time, Motions start, const double *target, const Limits *limits)
{
    const double limit[3] = {limits->rate, limits->acceleration, limits->jerk};
    double own[3], allowed[3], excess, bound = 1e-3; /* s */
    Vector stop, distance = {0.0, 0.0, 0.0};
    Search search;
    profile_hold(p, time, target);
    for (int n = 0; n < 4; n++)
        for (int k = 0; k < 3; k++)
            p->start[n][k] = start[n][k];
    for (int n = 0; n < 3; n++)
        own[n] = find_length(start[n + 1]);
    const int moving = own[0] != 0.0 || own[1] != 0.0 || own[2] != 0.0;
    if (moving) {
        fill_samples(&search);
        const double bounds[3] = {own[0] / limit[1], sqrt(own[0] / limit[2]), own[1] / limit[2]};
        for (int n = 0; n < 3; n++) {
            bound = bounds[n] > bound ? bounds[n] : bound;
            allowed[n] = (own[n] > limit[n] ? own[n] : limit[n]) * (1.0 + SLACK);
            search.per_allowed[n] = 1.0 / (allowed[n] * allowed[n]);
        }
        search.transferring = search.worst = 0;
        multiply_motions(start, distance, search.products);
        p->brake = choose(&search, SHORTEST_BRAKE * bound, BRAKES, &excess);
    }
    find_natural_stop(start, p->brake, stop);
    for (int k = 0; k < 3; k++)
        distance[k] = target[k] - stop[k];
    p->transfer = find_transfer_duration(find_length(distance), limits);
    if (moving && p->transfer > 0.0) {
        for (int n = 0; n < 3; n++) {
            const double raised = allowed[n] * (excess > 1.0 ? sqrt(excess) : 1.0);
            const double redirected = (1.0 + REDIRECTION_EXCESS) * limit[n];
            const double larger = raised > redirected ? raised : redirected;
            search.per_allowed[n] = 1.0 / (larger * larger);
        }
        search.transferring = 1;
        search.worst = 0;
        multiply_motions(start, distance, search.products);
        set_brake(&search, p->brake);
        p->transfer = choose(&search, p->transfer, TRANSFERS, &excess);
    }
}
