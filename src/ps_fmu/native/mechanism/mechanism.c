/* The state of the plant about the generated functions. */
#include "mechanism.h"

#include <math.h>
#include <string.h>

enum { FINE = 0, SHIFT = 3, TURN = 6, MODES = 9 };
enum { MOST_STEPS = 20 };
static const double LARGEST_CONDITION = 1e6, TOLERANCE = 1e-14, ROUNDING = 2e-16; /* 1, m, m */
static const double FAR = 1e-2;

/* Places in the state. */
typedef struct {
    int64_t n, rods, payload, s, ds, r, states;
} Layout;

static Layout lay_out(const Mechanism *m)
{
    int64_t n = 12 + m->n_bus + m->n_payload, rods = MODES + m->n_bus;
    return (Layout){n, rods, rods + 3, 2 * n, 2 * n + 3, 2 * n + 6, 2 * n + 9};
}

static void cross(const double a[3], const double b[3], double c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* skew(w) R */
static void turn(const double w[3], const double *R, double *result)
{
    for (int k = 0; k < 3; k++) {
        double column[3] = {R[k], R[3 + k], R[6 + k]}, turned[3];
        cross(w, column, turned);
        for (int i = 0; i < 3; i++)
            result[3 * i + k] = turned[i];
    }
}

/* Both vectors of a wrench. */
static void rotate(const double *R, const double *six, double *result)
{
    for (int i = 0; i < 3; i++) {
        result[i] = R[3 * i] * six[0] + R[3 * i + 1] * six[1] + R[3 * i + 2] * six[2];
        result[3 + i] = R[3 * i] * six[3] + R[3 * i + 1] * six[4] + R[3 * i + 2] * six[5];
    }
}

static double dot6(const double *a, const double *b)
{
    return ((a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])) + (a[4] * b[4] + a[5] * b[5]);
}

static double sum6(const double *a)
{
    return ((a[0] + a[1]) + (a[2] + a[3])) + (a[4] + a[5]);
}

static void multiply6(const double *matrix, const double *vector, double *result)
{
    for (int i = 0; i < 6; i++)
        result[i] = dot6(matrix + 6 * i, vector);
}

/* By four sums: none waits for the others. */
static int is_finite(const double *values, int64_t n)
{
    double sums[4] = {0.0};
    int64_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int k = 0; k < 4; k++)
            sums[k] += 0.0 * values[i + k];
    for (; i < n; i++)
        sums[0] += 0.0 * values[i];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]) == 0.0;
}

/* Gauss and Jordan with the largest pivot of each column.  0: there is none. */
static int64_t invert6(double a[36], double inverse[36])
{
    for (int i = 0; i < 36; i++)
        inverse[i] = i % 7 == 0 ? 1.0 : 0.0;
    for (int j = 0; j < 6; j++) {
        int pivot = j;
        for (int i = j + 1; i < 6; i++)
            if (fabs(a[6 * i + j]) > fabs(a[6 * pivot + j]))
                pivot = i;
        if (!(fabs(a[6 * pivot + j]) > 0.0))
            return 0;
        if (pivot != j)
            for (int k = 0; k < 6; k++) {
                double one = a[6 * j + k], other = inverse[6 * j + k];
                a[6 * j + k] = a[6 * pivot + k], a[6 * pivot + k] = one;
                inverse[6 * j + k] = inverse[6 * pivot + k], inverse[6 * pivot + k] = other;
            }
        double factor = 1.0 / a[6 * j + j];
        for (int k = 0; k < 6; k++)
            a[6 * j + k] *= factor, inverse[6 * j + k] *= factor;
        for (int i = 0; i < 6; i++) {
            if (i == j)
                continue;
            double times = a[6 * i + j];
            for (int k = 0; k < 6; k++)
                a[6 * i + k] -= times * a[6 * j + k], inverse[6 * i + k] -= times * inverse[6 * j + k];
        }
    }
    return 1;
}

static int64_t find_legs(const Mechanism *m, const double *t, const double *R, double lengths[6], double J_pl[36])
{
    double place[12], J_lp[36], divisor, square[6] = {0.0}, inverse[6] = {0.0};
    memcpy(place, t, 3 * sizeof *t);
    memcpy(place + 3, R, 9 * sizeof *R);
    equations_legs((const double *)&m->rigid, place, lengths, J_lp, J_pl, &divisor);
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++) {
            double scaled = k < 3 ? m->radius * J_lp[6 * i + k] : J_lp[6 * i + k];
            square[k] += scaled * scaled;
        }
    /* By blocks where the directions of the coarse legs are far from one plane. */
    if (!(fabs(divisor) > FAR) && !invert6(J_lp, J_pl))
        return 0;
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++) {
            double scaled = i < 3 ? J_pl[6 * i + k] : m->radius * J_pl[6 * i + k];
            inverse[k] += scaled * scaled;
        }
    double radius = m->radius;
    return sum6(square) * sum6(inverse) <= 36.0 * LARGEST_CONDITION * LARGEST_CONDITION * radius * radius;
}

EXPORT int64_t mechanism_invert(const Mechanism *m, const double t[3], const double R[9], double J_pl[36])
{
    double lengths[6];
    return find_legs(m, t, R, lengths, J_pl);
}

/* R <- a rotation about `half` twice, times R: the unit quaternion along (1, half). */
static void turn_finitely(const double half[3], double R[9])
{
    double x = half[0], y = half[1], z = half[2], s = 2.0 / (1.0 + (x * x + y * y + z * z));
    double Q[9] = {1.0 - s * (y * y + z * z), s * (x * y - z), s * (x * z + y),
                   s * (x * y + z), 1.0 - s * (x * x + z * z), s * (y * z - x),
                   s * (x * z - y), s * (y * z + x), 1.0 - s * (x * x + y * y)};
    double before[9];
    memcpy(before, R, sizeof before);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            R[3 * i + k] = Q[3 * i] * before[k] + Q[3 * i + 1] * before[3 + k] + Q[3 * i + 2] * before[6 + k];
}

EXPORT int64_t mechanism_find_place(const Mechanism *m, const double lengths[6], double t[3], double R[9])
{
    int last = 0;
    for (int step = 0; step <= MOST_STEPS; step++) {
        double present[6], J_pl[36], error[6], move[6], largest = 0.0;
        if (!find_legs(m, t, R, present, J_pl))
            return 0;
        for (int i = 0; i < 6; i++) {
            error[i] = lengths[i] - present[i];
            largest = fabs(error[i]) > largest ? fabs(error[i]) : largest;
        }
        if (!is_finite(error, 6))
            return 0;
        if (last || largest <= ROUNDING)
            return 1;
        last = largest <= TOLERANCE; /* one step more takes the error down to rounding */
        multiply6(J_pl, error, move);
        for (int i = 0; i < 3; i++) {
            t[i] += move[i];
            move[3 + i] *= 0.5;
        }
        turn_finitely(move + 3, R);
    }
    return 0;
}

/* What is linear in state and input: all of the motion but the places. */
static void gather(const Mechanism *m, const double *x, const double *u, EquationsMotion *z)
{
    Layout at = lay_out(m);
    const double *q = x, *dq = x + at.n;
    for (int i = 0; i < 3; i++) {
        double stretch = m->mask[i] * q[at.rods + i], stretching = m->mask[i] * dq[at.rods + i];
        z->rate[i] = x[at.ds + i] + stretching;
        z->rate[3 + i] = dq[FINE + i];
        z->turn[i] = dq[TURN + i];
        z->leg_force[i] = -m->leg_stiffness[i] * stretch - m->leg_damping[i] * stretching;
        z->leg_force[3 + i] = (u[MECHANISM_FINE_FORCE + i] + u[MECHANISM_ADDED_FORCE + i]) -
                              m->leg_stiffness[3 + i] * q[FINE + i] - m->leg_damping[3 + i] * dq[FINE + i];
        z->given[i] = m->servo_stiffness * (x[at.r + i] - x[at.s + i]) - m->servo_damping * x[at.ds + i];
        z->given[3 + i] = 0.0;
    }
    double shift[3] = {0.0}, flow[6] = {0.0}, wrench[6] = {0.0}, change[6] = {0.0}, change_rate[6] = {0.0};
    memcpy(z->given + 6, u + MECHANISM_BASE_MOTION, 6 * sizeof *u);
    memcpy(wrench, u + MECHANISM_BASE_WRENCH, sizeof wrench);
    for (int64_t k = 0; k < m->n_bus; k++) {
        const Mode *mode = m->bus + k;
        double place = q[MODES + k], rate = dq[MODES + k];
        if (mode->mobility == 0.0)
            continue;
        double held = mode->mobility * (mode->stiffness * place + mode->damping * rate);
        for (int i = 0; i < 3; i++)
            shift[i] += mode->momentum[i] * place;
        for (int i = 0; i < 6; i++) {
            flow[i] += mode->momentum[i] * rate;
            wrench[i] += mode->momentum[i] * held;
        }
    }
    memcpy(z->bus_shift, shift, sizeof shift);
    memcpy(z->bus_flow, flow, sizeof flow);
    memcpy(z->base_wrench, wrench, sizeof wrench);
    memset(shift, 0, sizeof shift);
    memset(flow, 0, sizeof flow);
    memcpy(wrench, u + MECHANISM_PAYLOAD_WRENCH, sizeof wrench);
    for (int64_t k = 0; k < m->n_payload; k++) {
        const Mode *mode = m->payload + k;
        double place = q[at.payload + k], rate = dq[at.payload + k];
        if (mode->mobility == 0.0)
            continue;
        double held = mode->mobility * (mode->stiffness * place + mode->damping * rate);
        for (int i = 0; i < 3; i++)
            shift[i] += mode->momentum[i] * place;
        for (int i = 0; i < 6; i++) {
            flow[i] += mode->momentum[i] * rate;
            change[i] += mode->inertia[i] * place;
            change_rate[i] += mode->inertia[i] * rate;
            wrench[i] += mode->momentum[i] * held;
        }
    }
    memcpy(z->payload_shift, shift, sizeof shift);
    memcpy(z->payload_flow, flow, sizeof flow);
    memcpy(z->payload_change, change, sizeof change);
    memcpy(z->payload_change_rate, change_rate, sizeof change_rate);
    memcpy(z->payload_wrench, wrench, sizeof wrench);
}

/* Rates and outputs from accelerations, as far as they are linear in these, in state and input; those of the base's
   velocity and position as if B did not turn. */
static void spread(const Mechanism *m, const double *x, const double *u, const double *given, const double *accelerations,
                   const double *body, const double *spin, double *rates, double *y)
{
    Layout at = lay_out(m);
    const double *q = x, *dq = x + at.n;
    double *speeds = rates, *changes = rates + at.n;
    for (int i = 0; i < 3; i++) {
        speeds[FINE + i] = dq[FINE + i];
        changes[FINE + i] = accelerations[3 + i];
        speeds[at.rods + i] = m->mask[i] * dq[at.rods + i];
        changes[at.rods + i] = m->mask[i] * (accelerations[i] - given[i]);
        rates[at.s + i] = x[at.ds + i];
        rates[at.ds + i] = given[i];
        rates[at.r + i] = u[MECHANISM_REFERENCE_RATE + i];
    }
    for (int i = 0; i < 6; i++) {
        speeds[SHIFT + i] = dq[SHIFT + i];
        changes[SHIFT + i] = accelerations[6 + i];
    }
    for (int64_t k = 0; k < m->n_bus; k++) {
        const Mode *mode = m->bus + k;
        double place = q[MODES + k], rate = dq[MODES + k];
        speeds[MODES + k] = mode->mobility == 0.0 ? 0.0 : rate;
        changes[MODES + k] = -mode->mobility * (mode->stiffness * place + mode->damping * rate +
                                                dot6(mode->momentum, accelerations + 6));
    }
    double sight[2] = {0.0, 0.0};
    for (int64_t k = 0; k < m->n_payload; k++) {
        const Mode *mode = m->payload + k;
        double place = q[at.payload + k], rate = dq[at.payload + k];
        speeds[at.payload + k] = mode->mobility == 0.0 ? 0.0 : rate;
        changes[at.payload + k] = mode->mobility * (dot6(mode->inertia, spin) - mode->stiffness * place -
                                                    mode->damping * rate - dot6(mode->momentum, body));
        sight[0] += mode->sight[0] * place;
        sight[1] += mode->sight[1] * place;
    }
    for (int i = 0; i < 6; i++) {
        y[MECHANISM_BASE_ACCELERATION + i] = accelerations[6 + i];
        y[MECHANISM_BASE_VELOCITY + i] = dq[SHIFT + i];
        y[MECHANISM_BASE_POSITION + i] = q[SHIFT + i];
    }
    for (int i = 0; i < 3; i++) {
        y[MECHANISM_FINE_DISPLACEMENT + i] = q[FINE + i];
        y[MECHANISM_FINE_VELOCITY + i] = dq[FINE + i];
        y[MECHANISM_COARSE_DISPLACEMENT + i] = x[at.s + i];
    }
    y[MECHANISM_LINE_OF_SIGHT] = sight[0];
    y[MECHANISM_LINE_OF_SIGHT + 1] = sight[1];
}

/* Outputs that are not linear, or their derivatives, to their places; those that follow from them. */
static void place_outputs(const Mechanism *m, const double found[16], double *y)
{
    memcpy(y + MECHANISM_PAYLOAD_POSITION, found, 6 * sizeof *found);
    memcpy(y + MECHANISM_ORIENTATION, found + 6, 6 * sizeof *found);
    memcpy(y + MECHANISM_PAYLOAD_ATTITUDE, found + 12, 4 * sizeof *found);
    /* A small rotation th turns the boresight z by th x z = (th_y, -th_x, 0). */
    y[MECHANISM_LOS] = m->focal_length * found[4];
    y[MECHANISM_LOS + 1] = -m->focal_length * found[3];
    y[MECHANISM_LINE_OF_SIGHT] += found[3];
    y[MECHANISM_LINE_OF_SIGHT + 1] += found[4];
}

static int64_t fill(const Mechanism *m, const Place *place, const double *x, const double *u, Point *p)
{
    Layout at = lay_out(m);
    EquationsMotion *z = &p->motion;
    if (!mechanism_invert(m, place->translation, place->rotation, p->J_pl) ||
        !mechanism_invert(m, place->nominal_translation, place->nominal_rotation, p->nominal_J_pl))
        return 0;
    memcpy(z->translation, place->translation, sizeof z->translation);
    memcpy(z->rotation, place->rotation, sizeof z->rotation);
    gather(m, x, u, z);
    memcpy(p->velocity, x + at.n + SHIFT, sizeof p->velocity);
    memcpy(p->turn, x + at.n + TURN, sizeof p->turn);
    memcpy(p->position, x + SHIFT, sizeof p->position);
    double coarse[6] = {x[at.ds], x[at.ds + 1], x[at.ds + 2], 0.0, 0.0, 0.0};
    multiply6(p->nominal_J_pl, coarse, p->nominal_twist);
    EquationsPlace *o = &p->place;
    memcpy(o->translation, place->translation, sizeof o->translation);
    memcpy(o->rotation, place->rotation, sizeof o->rotation);
    memcpy(o->nominal_translation, place->nominal_translation, sizeof o->nominal_translation);
    memcpy(o->nominal_rotation, place->nominal_rotation, sizeof o->nominal_rotation);
    memcpy(o->attitude, place->attitude, sizeof o->attitude);
    memcpy(o->base_position, x + SHIFT, sizeof o->base_position);
    memcpy(o->base_rotation, x + TURN, sizeof o->base_rotation);
    return 1;
}

EXPORT int64_t mechanism_evaluate(const Mechanism *m, const Place *place, const double *x, const double u[MECHANISM_INPUTS],
                                  Point *p)
{
    Layout at = lay_out(m);
    double found[16], turned[3];
    if (!fill(m, place, x, u, p))
        return 0;
    const double *z = (const double *)&p->motion;
    equations_accelerations((const double *)&m->rigid, z, p->J_pl, m->mask, p->accelerations, p->body, p->spin, p->reaction,
                            p->kept, p->lower, p->divisors, p->base_rows);
    memcpy(p->twist, p->kept, sizeof p->twist);
    spread(m, x, u, p->motion.given, p->accelerations, p->body, p->spin, p->rates, p->outputs);
    for (int64_t from = 0; from <= at.n; from += at.n) { /* components in B, which turns */
        cross(p->turn, x + from + SHIFT, turned);
        for (int i = 0; i < 3; i++)
            p->rates[from + SHIFT + i] -= turned[i];
    }
    equations_outputs((const double *)&p->place, found);
    place_outputs(m, found, p->outputs);
    memcpy(p->outputs + MECHANISM_BASE_ATTITUDE, place->attitude, sizeof place->attitude);
    return is_finite(p->rates, at.states) && is_finite(p->outputs, MECHANISM_OUTPUTS) && is_finite(p->reaction, 6);
}

/* Solution of the masses' equations, by the factors of a point. */
static void solve(const Point *p, const double right[12], double found[12])
{
    const double *row = p->lower;
    for (int i = 0; i < 12; i++) {
        double value = right[i];
        for (int k = 0; k < i; k++)
            value -= row[k] * found[k];
        found[i] = value;
        row += i;
    }
    for (int i = 0; i < 12; i++)
        found[i] *= p->divisors[i];
    for (int i = 11; i >= 0; i--) {
        row -= i;
        for (int k = 0; k < i; k++)
            found[k] -= row[k] * found[i];
    }
}

/* Generalised forces on legs' lengths and base by a change of forces alone and of the base's prescribed accelerations. */
static void find_forces(const Point *p, const EquationsMotion *dz, double right[12])
{
    double wrench[6], moment[3];
    rotate(p->motion.rotation, dz->payload_wrench, wrench);
    cross(p->motion.translation, wrench, moment);
    for (int i = 0; i < 6; i++) {
        right[i] = dz->leg_force[i];
        for (int k = 0; k < 6; k++)
            right[i] += p->J_pl[6 * k + i] * wrench[k];
        right[6 + i] = dz->base_wrench[i] + wrench[i] + (i < 3 ? 0.0 : moment[i - 3]);
    }
    for (int i = 0; i < 12; i++)
        for (int k = 0; k < 6; k++)
            right[i] -= p->base_rows[12 * k + i] * dz->given[6 + k];
}

/* Add what accelerations of legs' lengths and base are to those of the payload, in P. */
static void move_platform(const Point *p, const double accelerations[12], double body[6])
{
    const double *R = p->motion.rotation, *base = accelerations + 6;
    double moved[6], transported[3];
    multiply6(p->J_pl, accelerations, moved);
    cross(base + 3, p->motion.translation, transported);
    for (int i = 0; i < 3; i++) {
        moved[i] += base[i] + transported[i];
        moved[3 + i] += base[3 + i];
    }
    for (int i = 0; i < 3; i++) {
        body[i] += R[i] * moved[0] + R[3 + i] * moved[1] + R[6 + i] * moved[2];
        body[3 + i] += R[i] * moved[3] + R[3 + i] * moved[4] + R[6 + i] * moved[5];
    }
}

/* Accelerations from forces; what `body` is by the rest is in it already. */
static void accelerate(const Point *p, const double *given, const double right[12], double found[12], double total[12],
                       double body[6])
{
    solve(p, right, found);
    for (int i = 0; i < 12; i++)
        total[i] = given[i] + found[i];
    move_platform(p, found, body);
}

EXPORT void mechanism_accelerate(const Mechanism *m, const Point *p, const double du[MECHANISM_INPUTS], double *d_rates)
{
    const double still[MECHANISM_STATES] = {0.0}, spin[6] = {0.0};
    double right[12], found[12], accelerations[12], body[6] = {0.0}, y[MECHANISM_OUTPUTS];
    EquationsMotion dz;
    gather(m, still, du, &dz);
    find_forces(p, &dz, right);
    move_platform(p, dz.given, body);
    accelerate(p, dz.given, right, found, accelerations, body);
    spread(m, still, du, dz.given, accelerations, body, spin, d_rates, y);
}

/* Whether any of n numbers is not zero. */
static int is_any(const double *values, int64_t n)
{
    int found = 0;
    for (int64_t i = 0; i < n; i++)
        found |= values[i] != 0.0;
    return found;
}

EXPORT void mechanism_differentiate(const Mechanism *m, const Point *p, const double *dx, const double du[MECHANISM_INPUTS],
                                    double *d_rates, double d_outputs[MECHANISM_OUTPUTS], double d_reaction[6])
{
    Layout at = lay_out(m);
    EquationsMotion dz;
    EquationsPlace dp;
    double lengths[6], move[6], right[12], found[12], accelerations[12], body[6], spin[6], changed[16], one[3], other[3];
    gather(m, dx, du, &dz);
    for (int i = 0; i < 3; i++) {
        lengths[i] = dx[at.s + i] + m->mask[i] * dx[at.rods + i];
        lengths[3 + i] = dx[FINE + i];
    }
    multiply6(p->J_pl, lengths, move);
    memcpy(dz.translation, move, sizeof dz.translation);
    turn(move + 3, p->motion.rotation, dz.rotation);
    memcpy(dp.translation, dz.translation, sizeof dp.translation);
    memcpy(dp.rotation, dz.rotation, sizeof dp.rotation);
    double coarse[6] = {dx[at.s], dx[at.s + 1], dx[at.s + 2], 0.0, 0.0, 0.0};
    multiply6(p->nominal_J_pl, coarse, move);
    memcpy(dp.nominal_translation, move, sizeof dp.nominal_translation);
    turn(move + 3, p->place.nominal_rotation, dp.nominal_rotation);
    const double *q = p->place.attitude, *half = dx + TURN; /* q (0, half) / 2 */
    dp.attitude[0] = -0.5 * (q[1] * half[0] + q[2] * half[1] + q[3] * half[2]);
    cross(q + 1, half, one);
    for (int i = 0; i < 3; i++)
        dp.attitude[1 + i] = 0.5 * (q[0] * half[i] + one[i]);
    memcpy(dp.base_position, dx + SHIFT, sizeof dp.base_position);
    memcpy(dp.base_rotation, dx + TURN, sizeof dp.base_rotation);

    const double *all = (const double *)&dz;
    int64_t n_moved = (const double *)dz.leg_force - all;
    if (is_any(all, n_moved) || is_any(dz.given, 6)) {
        equations_change((const double *)&m->rigid, (const double *)&p->motion, p->J_pl, p->kept, p->accelerations, all,
                         right, body, spin);
        for (int i = 0; i < 12; i++)
            right[i] = -right[i];
    } else {
        find_forces(p, &dz, right);
        memset(body, 0, sizeof body);
        memset(spin, 0, sizeof spin);
        move_platform(p, dz.given, body);
    }
    accelerate(p, dz.given, right, found, accelerations, body);
    for (int i = 0; i < 6; i++) {
        const double *base = p->base_rows + 12 * i;
        d_reaction[i] = (dot6(base, found) + dot6(base + 6, found + 6)) - right[6 + i];
    }
    spread(m, dx, du, dz.given, accelerations, body, spin, d_rates, d_outputs);
    for (int64_t from = 0; from <= at.n; from += at.n) {
        cross(p->turn, dx + from + SHIFT, one);
        cross(dx + at.n + TURN, from ? p->velocity : p->position, other);
        for (int i = 0; i < 3; i++)
            d_rates[from + SHIFT + i] -= one[i] + other[i];
    }
    memset(changed, 0, sizeof changed);
    if (is_any(lengths, 6) || is_any(dx + SHIFT, 6))
        equations_outputs_change((const double *)&p->place, (const double *)&dp, changed);
    place_outputs(m, changed, d_outputs);
    memcpy(d_outputs + MECHANISM_BASE_ATTITUDE, dp.attitude, sizeof dp.attitude);
}

EXPORT void mechanism_linearise(const Mechanism *m, const Point *p, double *A, double *B, double *C, double *D, double *E,
                                double *F, int64_t first, int64_t end)
{
    int64_t n = lay_out(m).states;
    double dx[MECHANISM_STATES] = {0.0}, du[MECHANISM_INPUTS] = {0.0};
    double rates[MECHANISM_STATES], outputs[MECHANISM_OUTPUTS], reaction[6];
    for (int64_t k = first; k < end; k++) {
        double *seed = k < n ? dx + k : du + (k - n);
        *seed = 1.0;
        mechanism_differentiate(m, p, dx, du, rates, outputs, reaction);
        *seed = 0.0;
        int64_t width = k < n ? n : MECHANISM_INPUTS, column = k < n ? k : k - n;
        double *to_rates = k < n ? A : B, *to_outputs = k < n ? C : D, *to_reaction = k < n ? E : F;
        for (int64_t i = 0; i < n; i++)
            to_rates[width * i + column] = rates[i];
        for (int64_t i = 0; i < MECHANISM_OUTPUTS; i++)
            to_outputs[width * i + column] = outputs[i];
        for (int64_t i = 0; i < 6; i++)
            to_reaction[width * i + column] = reaction[i];
    }
}

EXPORT void mechanism_find_masses(const Mechanism *m, const double t[3], const double R[9], const double J_pl[36],
                                  const double *q, double *M, double *m_c, double locked[36])
{
    Layout at = lay_out(m);
    double rigid[144], x[MECHANISM_STATES] = {0.0}, u[MECHANISM_INPUTS] = {0.0};
    EquationsMotion z;
    int64_t n = at.n, place[12];
    if (q != NULL)
        memcpy(x, q, (size_t)n * sizeof *q);
    gather(m, x, u, &z);
    memcpy(z.translation, t, sizeof z.translation);
    memcpy(z.rotation, R, sizeof z.rotation);
    equations_masses((const double *)&m->rigid, (const double *)&z, J_pl, rigid, locked);
    for (int i = 0; i < 3; i++)
        place[i] = at.rods + i, place[3 + i] = FINE + i;
    for (int i = 0; i < 6; i++)
        place[6 + i] = SHIFT + i;
    memset(M, 0, (size_t)(n * n) * sizeof *M);
    for (int i = 0; i < 12; i++)
        for (int k = 0; k < 12; k++)
            M[n * place[i] + place[k]] = rigid[12 * i + k];
    for (int64_t k = 0; k < m->n_bus; k++) {
        const Mode *mode = m->bus + k;
        int64_t at_mode = MODES + k;
        M[n * at_mode + at_mode] = 1.0;
        for (int i = 0; i < 6; i++)
            M[n * at_mode + place[6 + i]] = M[n * place[6 + i] + at_mode] = mode->momentum[i];
    }
    for (int64_t k = 0; k < m->n_payload; k++) {
        const Mode *mode = m->payload + k;
        int64_t at_mode = at.payload + k;
        double force[6], moment[3];
        rotate(R, mode->momentum, force);
        cross(t, force, moment);
        M[n * at_mode + at_mode] = mode->mass;
        for (int i = 0; i < 12; i++) {
            double sum = i < 6 ? 0.0 : force[i - 6] + (i < 9 ? 0.0 : moment[i - 9]);
            for (int j = 0; i < 6 && j < 6; j++)
                sum += J_pl[6 * j + i] * force[j];
            M[n * at_mode + place[i]] = M[n * place[i] + at_mode] = sum;
        }
    }
    for (int64_t i = 0; i < n; i++)
        memcpy(m_c + 3 * i, M + n * i + at.rods, 3 * sizeof *m_c);
}

EXPORT void mechanism_find_momentum(const Mechanism *m, const Point *p, const double *x, double momentum[6], double mass[4])
{
    equations_momentum((const double *)&m->rigid, (const double *)&p->motion, p->J_pl, x + lay_out(m).n + SHIFT, momentum,
                       mass);
}

EXPORT void mechanism_find_relative_momentum(const Mechanism *m, const Place *place, const double *x, const double turn[3],
                                             double momentum[6])
{
    const double none[MECHANISM_INPUTS] = {0.0}, still[3] = {0.0};
    double J_pl[36], mass[4];
    EquationsMotion z;
    gather(m, x, none, &z);
    memcpy(z.translation, place->translation, sizeof z.translation);
    memcpy(z.rotation, place->rotation, sizeof z.rotation);
    memcpy(z.turn, turn, sizeof z.turn);
    mechanism_invert(m, z.translation, z.rotation, J_pl);
    equations_momentum((const double *)&m->rigid, (const double *)&z, J_pl, still, momentum, mass);
}
