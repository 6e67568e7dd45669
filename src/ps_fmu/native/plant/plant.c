#include "plant.h"

#include "../kernel/kernel.h"
#include "model.h"

#include <math.h>
#include <string.h>

/* Farthest from a linear model that the legs go before another one is made, m. */
static const double FAR = 2e-3;

/* Longest time over which the references of the servos go to a new command, s. */
static const double RAMP = 1e-2;

/* Longest step at rest that may leave it, s: in a longer one the motion would be linear for too long. */
static const double BRIEF = 1e-3;

/* So many times as far as rest reaches, no step at rest leads. */
static const double SUDDEN = 10.0;

/* Inner steps between two looks at the momentum. */
enum { BALANCE_EVERY = 4 };

/* A servo is at rest when it is this close to its command (m) and this slow (m/s); fine legs, when they are near rest now
   and this much later (s); the base does not turn below this rate (rad/s). */
static const double AT_REST = 1e-12, SOON = 0.01, HARDLY_TURNING = 1e-4;

/* Outputs, with the reaction on the base. */
enum { N_OUTPUTS = MECHANISM_OUTPUTS + 6 };

enum { FINE = 0, SHIFT = 3, TURN = 6 };

/* Of Memory: `moving`. */
enum { RESTS, MOVES, BEGINS /* with the next step */ };

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
    *sine = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0 *
            (1.0 - square / 110.0))));
    *cosine = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0 * (1.0 - square / 90.0 *
              (1.0 - square / 132.0))));
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

/* --- The place of the platform ---------------------------------------------------------------------------------- */

static void move_place(double t[3], double R[9], const double J_pl[36], const double lengths[6])
{
    double move[6];
    for (int i = 0; i < 6; i++) {
        move[i] = 0.0;
        for (int k = 0; k < 6; k++)
            move[i] += J_pl[6 * i + k] * lengths[k];
    }
    for (int i = 0; i < 3; i++)
        t[i] += move[i];
    turn_rotation(R, move + 3);
}

static void find_lengths(const Plant *p, const double t[3], const double R[9], double lengths[6])
{
    const double *arm = p->mechanism->rigid.platform_joint, *base = p->mechanism->rigid.base_joint;
    for (int k = 0; k < 6; k++, arm += 3, base += 3) {
        double square = 0.0;
        for (int i = 0; i < 3; i++) {
            const double along = t[i] + (R[3 * i] * arm[0] + R[3 * i + 1] * arm[1] + R[3 * i + 2] * arm[2]) - base[i];
            square += along * along;
        }
        lengths[k] = sqrt(square);
    }
}

/* By the change of the lengths, and one correction by what they lack then. */
static void follow(const Plant *p, const double J_pl[36], const double change[6], const double lengths[6], double t[3],
                   double R[9])
{
    double present[6];
    move_place(t, R, J_pl, change);
    find_lengths(p, t, R, present);
    for (int k = 0; k < 6; k++)
        present[k] = lengths[k] - present[k];
    move_place(t, R, J_pl, present);
}

static void follow_legs(const Plant *p, const double *before, const double *x, Place *place)
{
    const Mechanism *m = p->mechanism;
    const int64_t n = count_coordinates(p), s = 2 * n, rods = 9 + m->n_bus;
    double change[6], lengths[6], nominal_change[6] = {0.0}, nominal[6];
    for (int k = 0; k < 3; k++) {
        const double stretch = m->mask[k] * x[rods + k], old_stretch = m->mask[k] * before[rods + k];
        nominal_change[k] = x[s + k] - before[s + k];
        change[k] = nominal_change[k] + (stretch - old_stretch);
        change[3 + k] = x[FINE + k] - before[FINE + k];
        nominal[k] = m->nominal_lengths[k] + x[s + k];
        lengths[k] = nominal[k] + stretch;
        nominal[3 + k] = m->nominal_lengths[3 + k];
        lengths[3 + k] = nominal[3 + k] + x[FINE + k];
    }
    follow(p, p->point.J_pl, change, lengths, place->translation, place->rotation);
    follow(p, p->point.nominal_J_pl, nominal_change, nominal, place->nominal_translation, place->nominal_rotation);
}

/* --- Momentum --------------------------------------------------------------------------------------------------- */

/* Wrench of the loads on all, at the origin of B; false: none acts. */
static bool find_outer(const double *input, const Place *place, double wrench[6])
{
    const double *payload = input + MECHANISM_PAYLOAD_WRENCH, *R = place->rotation;
    double force[3], moment[3];
    memcpy(wrench, input + MECHANISM_BASE_WRENCH, 6 * sizeof *wrench);
    for (int i = 0; i < 3; i++) {
        force[i] = R[3 * i] * payload[0] + R[3 * i + 1] * payload[1] + R[3 * i + 2] * payload[2];
        wrench[i] += force[i];
        wrench[3 + i] += R[3 * i] * payload[3] + R[3 * i + 1] * payload[4] + R[3 * i + 2] * payload[5];
    }
    cross(place->translation, force, moment);
    for (int i = 0; i < 3; i++)
        wrench[3 + i] += moment[i];
    return largest(wrench, NULL, 6) != 0.0;
}

/* Carry the true momentum over an inner step. */
static void carry(Memory *w, const double *input, const double middle[4], const double position[3], double mass, double h)
{
    double wrench[6], force[3] = {0.0}, torque[3], arm[3], moment[3];
    const bool acts = find_outer(input, &w->place, wrench);
    if (acts)
        rotate(middle, wrench, false, force);
    for (int k = 0; k < 3; k++)
        w->centre[k] += h / mass * (w->momentum[k] + 0.5 * h * force[k]);
    if (!acts)
        return;
    rotate(middle, wrench + 3, false, torque);
    rotate(middle, position, false, arm);
    cross(arm, force, moment);
    for (int k = 0; k < 3; k++) {
        w->momentum[k] += h * force[k];
        w->angular[k] += h * (torque[k] + moment[k]);
    }
}

/* What the place and the velocities of B lack, by the true momentum. */
static void find_lead(Plant *p, const Model *model, Memory *w, const double *x)
{
    double found[6], mass[4], linear[3], angular[3], centre[3], moment[3], missing[3];
    mechanism_find_momentum(p->mechanism, &p->point, x, found, mass);
    rotate(w->place.attitude, w->momentum, true, linear);
    rotate(w->place.attitude, w->angular, true, angular);
    rotate(w->place.attitude, w->centre, true, centre);
    cross(x + SHIFT, linear, moment);
    for (int k = 0; k < 3; k++) {
        angular[k] -= moment[k] + found[3 + k];
        linear[k] -= found[k];
        missing[k] = mass[1 + k] / mass[0];
        w->lead[k] = centre[k] - (x[SHIFT + k] + missing[k]);
    }
    cross(missing, linear, moment);
    for (int k = 0; k < 3; k++)
        angular[k] -= moment[k];
    double *turn = w->lead + 6;
    for (int i = 0; i < 3; i++)
        turn[i] = model->inverse_inertia[3 * i] * angular[0] + model->inverse_inertia[3 * i + 1] * angular[1] +
                  model->inverse_inertia[3 * i + 2] * angular[2];
    cross(missing, turn, moment);
    for (int k = 0; k < 3; k++)
        w->lead[3 + k] = linear[k] / mass[0] + moment[k];
}

/* The momentum of the state is the true one. */
static void take_momentum(Plant *p, Memory *w, const double *x, bool with_momentum)
{
    double found[6], mass[4], moment[3], centre[3];
    mechanism_find_momentum(p->mechanism, &p->point, x, found, mass);
    for (int k = 0; k < 3; k++)
        centre[k] = x[SHIFT + k] + mass[1 + k] / mass[0];
    rotate(w->place.attitude, centre, false, w->centre);
    if (!with_momentum)
        return;
    cross(x + SHIFT, found, moment);
    for (int k = 0; k < 3; k++)
        found[3 + k] += moment[k];
    rotate(w->place.attitude, found, false, w->momentum);
    rotate(w->place.attitude, found + 3, false, w->angular);
}

/* Momentum of the linear model at rest, angular momentum about its centre of mass, in axes of B at the centre; without what
   the turn since then makes of the momentum of the centre: outer forces alone change it. */
static bool find_linear_momentum(Plant *p, const Model *model, const double *x, double momentum[6])
{
    const Centre *c = &model->centre;
    double mass[4], com[3], carried[3], moment[3], turn[3];
    if (!evaluate_centre(p, model, x + count_coordinates(p), &p->centre))
        return false;
    mechanism_find_momentum(p->mechanism, &p->centre, x, momentum, mass);
    for (int k = 0; k < 3; k++) {
        com[k] = mass[1 + k] / mass[0];
        carried[k] = mass[0] * c->velocity[k];
        turn[k] = x[TURN + k] - c->rotation[k];
    }
    cross(com, momentum, moment);
    for (int k = 0; k < 3; k++)
        momentum[3 + k] -= moment[k];
    cross(turn, carried, moment);
    for (int k = 0; k < 3; k++)
        momentum[k] += moment[k];
    return true;
}

/* Legs and payload as one body on the base, at the present place. */
static void find_locked(const Plant *p, const Point *point, double locked[10])
{
    double M[MECHANISM_COORDINATES * MECHANISM_COORDINATES], m_c[3 * MECHANISM_COORDINATES], body[36];
    mechanism_find_masses(p->mechanism, point->motion.translation, point->motion.rotation, point->J_pl, NULL, M, m_c, body);
    locked[0] = body[0];
    locked[1] = 0.5 * (body[6 * 5 + 1] + body[6 * 1 + 5]) / body[0]; /* skew(first) lies below, its opposite beside it */
    locked[2] = 0.5 * (body[6 * 3 + 2] + body[6 * 2 + 3]) / body[0];
    locked[3] = 0.5 * (body[6 * 4 + 0] + body[6 * 0 + 4]) / body[0];
    for (int i = 0, place = 4; i < 3; i++)
        for (int k = i; k < 3; k++)
            locked[place++] = 0.5 * (body[6 * (3 + i) + 3 + k] + body[6 * (3 + k) + 3 + i]);
}

/* --- A base that the host moves --------------------------------------------------------------------------------- */

/* Where the momentum relative to the base is taken at another place, the impulse promised so far is to it. */
static void keep_promise(const Plant *p, Memory *w, const Place *before, const Place *after, const double *x)
{
    const double still[3] = {0.0};
    double one[6], other[6];
    mechanism_find_relative_momentum(p->mechanism, before, x, still, one);
    mechanism_find_relative_momentum(p->mechanism, after, x, still, other);
    for (int k = 0; k < 6; k++)
        w->promised[k] += one[k] - other[k];
}

/* Relative momentum; and momentum of legs and payload, locked, while the base turns. */
typedef struct {
    double relative[6], locked[6];
} Carried;

static void find_carried(const Plant *p, const Place *place, const double *x, const double turn[3], Carried *found)
{
    const double still[3] = {0.0}, none[MECHANISM_STATES] = {0.0};
    mechanism_find_relative_momentum(p->mechanism, place, x, still, found->relative);
    memset(found->locked, 0, sizeof found->locked);
    if (largest(turn, NULL, 3) != 0.0)
        mechanism_find_relative_momentum(p->mechanism, place, none, turn, found->locked);
}

/* What the base feels over the next step: mean of W = w_p - dP/dt - w x P - dL/dt, with the wrench w_p on the payload,
   the relative momentum P, and L that of the locked mass, whose own forces the host has.  The impulse that is promised
   leads to the momentum at the end of the next step, as expected; what was promised before is taken back. */
static void react(Memory *w, const Carried *start, const Carried *now, const Carried *next, const double *input,
                  const Place *place, const double turn[3], double h, double *reaction)
{
    double wrench[6], crossed[6], expected[6];
    find_outer(input, place, wrench);
    for (int k = 0; k < 6; k++)
        expected[k] = 1.5 * now->relative[k] - 0.5 * start->relative[k];
    cross(turn, expected, crossed);
    cross(turn, expected + 3, crossed + 3);
    for (int k = 0; k < 6; k++) {
        const double impulse = h * (wrench[k] - crossed[k]) - next->relative[k] - (next->locked[k] - now->locked[k]);
        reaction[k] = (impulse - w->promised[k] - (now->locked[k] - start->locked[k])) / h + wrench[k];
        expected[k] = 0.5 * (now->relative[k] + start->relative[k]);
        w->promised[k] = impulse;
    }
    cross(turn, expected, crossed);
    cross(turn, expected + 3, crossed + 3);
    for (int k = 0; k < 6; k++)
        reaction[k] -= crossed[k];
}

/* --- Steps ------------------------------------------------------------------------------------------------------ */

/* Rates and outputs at a state; the same bits whether they were found before or not. */
static bool evaluate(Plant *p, const Place *place, const double *x, const double *input)
{
    const size_t size = sizeof *x * (size_t)count_states(p);
    if (p->evaluated && memcmp(p->x, x, size) == 0 && memcmp(&p->place, place, sizeof *place) == 0 &&
        memcmp(p->u, input, sizeof p->u) == 0)
        return true;
    p->evaluated = mechanism_evaluate(p->mechanism, place, x, input, &p->point);
    p->place = *place;
    memcpy(p->x, x, size);
    memcpy(p->u, input, sizeof p->u);
    return p->evaluated;
}

/* The model about a centre, made if it is not there; NULL: it cannot be made. */
static Model *find_model(Plant *p, const Centre *centre)
{
    for (int k = 0; k < 2; k++) {
        Model *model = p->models + k;
        if (memcmp(&model->centre, centre, sizeof *centre) == 0 && model->stage == MODEL_MADE) {
            p->latest = k;
            return model;
        }
    }
    p->latest = 1 - p->latest;
    Model *model = p->models + p->latest;
    p->models[1 - p->latest].centre.step *= p->models[1 - p->latest].stage == MODEL_MADE; /* they share their room */
    return model_make(p, model, centre, INT64_MAX) == MODEL_READY ? model : NULL;
}

/* A part of the next model, in the place that the present one leaves. */
static bool work_ahead(Plant *p, const Model *present, Memory *w)
{
    Model *model = present == p->models ? p->models + 1 : p->models;
    w->parts += 1.0;
    const int64_t found = model_make(p, model, &w->next, (int64_t)w->parts);
    if (found == MODEL_FAILED)
        return false;
    if (found == MODEL_READY) {
        w->parts = (double)model->parts;
        if (w->next.rest == 0.0) {
            w->present = w->next;
            w->parts = 0.0;
            find_locked(p, &p->point, w->locked);
        }
    }
    return true;
}

static void begin_next(Plant *p, Memory *w, const double *x, double step)
{
    Centre *c = &w->next;
    memset(c, 0, sizeof *c);
    memcpy(c->coarse, x + 2 * count_coordinates(p), sizeof c->coarse);
    memcpy(c->fine, x + FINE, sizeof c->fine);
    c->attitude[0] = 1.0;
    c->step = step;
    w->parts = 0.0;
}

static bool is_far(const Plant *p, const Centre *c, const double *x)
{
    return largest(x + 2 * count_coordinates(p), c->coarse, 3) > FAR || largest(x + FINE, c->fine, 3) > FAR;
}

/* One inner step in motion; what it changes is in w and x. */
static bool move_on(Plant *p, Memory *w, double *x, double h, const double *input)
{
    const int64_t n = count_coordinates(p), n_x = count_states(p);
    const size_t size = sizeof *x * (size_t)n_x;
    const Model *model = find_model(p, &w->present);
    if (model == NULL || !evaluate(p, &w->place, x, w->input))
        return false;
    const double *rates = p->point.rates;
    double *f = p->operand, *change = p->operand + n_x, by_loads[MECHANISM_STATES], changed[MECHANISM_INPUTS];
    /* The change of what the linear model does not explain, the same loads at both ends. */
    memset(change, 0, size);
    if (w->step_before > 0.0) {
        for (int64_t i = 0; i < n_x; i++)
            f[i] = x[i] - w->before[i];
        if (!kernel_product(model->change, pad(3 + n), f, n_x, p->result))
            return false;
        const double scale = h / w->step_before;
        for (int64_t i = 0; i < 3 + n; i++) {
            const int64_t row = i < 3 ? SHIFT + i : n + i - 3;
            change[row] = scale * (p->result[i] + (rates[row] - w->rates_before[row]));
        }
    }
    memcpy(f, rates, size);
    if (p->prescribed)
        memset(change + n + SHIFT, 0, 6 * sizeof *change);
    if (memcmp(input, w->input, sizeof w->input) != 0) {
        for (int k = 0; k < MECHANISM_INPUTS; k++)
            changed[k] = input[k] - w->input[k];
        mechanism_accelerate(p->mechanism, &p->point, changed, by_loads);
        for (int64_t i = 0; i < n_x; i++)
            f[i] += by_loads[i];
    }
    memcpy(w->rates_before, f, size);
    memcpy(w->before, x, size);
    w->step_before = h;
    if (p->prescribed) /* its rate is the mean over the step */
        memset(f + n + SHIFT, 0, 6 * sizeof *f);
    for (int k = 0; k < 3; k++) {
        f[SHIFT + k] += w->lead[k] / h;
        f[n + SHIFT + k] += w->lead[3 + k] / h;
        f[n + TURN + k] += w->lead[6 + k] / h;
    }
    memset(w->lead, 0, sizeof w->lead);
    if (!kernel_product(model->motion, pad(n_x), p->operand, 2 * n_x, p->result))
        return false;
    for (int64_t i = 0; i < n_x; i++)
        x[i] += p->result[i];
    /* The attitude by the mean rate, and what it changes by the order of turns. */
    double turn[3], half[3], middle[4], position[3];
    cross(w->before + n + TURN, x + n + TURN, turn);
    for (int k = 0; k < 3; k++) {
        const double turned = x[TURN + k] - w->before[TURN + k];
        half[k] = 0.5 * turned;
        turn[k] = turned + h * h / 12.0 * turn[k];
        position[k] = 0.5 * (w->before[SHIFT + k] + x[SHIFT + k]);
    }
    memcpy(middle, w->place.attitude, sizeof middle);
    turn_attitude(middle, half);
    follow_legs(p, w->before, x, &w->place);
    memcpy(w->input, input, sizeof w->input);
    if (!p->prescribed)
        carry(w, input, middle, position, model->mass, h);
    turn_attitude(w->place.attitude, turn);
    if (!evaluate(p, &w->place, x, w->input))
        return false;
    w->countdown -= 1.0;
    if (!p->prescribed && w->countdown <= 0.0) {
        find_lead(p, model, w, x);
        w->countdown = BALANCE_EVERY;
    }
    return true;
}

/* A part of the next model, where one is being made, or has to be. */
static bool look_ahead(Plant *p, Memory *w, const double *x)
{
    if (w->parts == 0.0 && !is_far(p, &w->present, x))
        return true;
    if (w->parts == 0.0)
        begin_next(p, w, x, w->present.step);
    return work_ahead(p, find_model(p, &w->present), w);
}

/* The state where the coarse legs have come to rest, and the fine legs will be: whether it is so, and the centre there. */
static bool has_come_to_rest(const Plant *p, const Memory *w, const double *x, const double *command, double step, Centre *c)
{
    const int64_t n = count_coordinates(p), s = 2 * n;
    if (!(largest(x + s + 3, NULL, 3) < AT_REST) || !(largest(x + s, command, 3) < AT_REST) ||
        !(largest(x + s + 6, command, 3) < AT_REST) || largest(x + n + TURN, NULL, 3) > HARDLY_TURNING)
        return false;
    double soon[3];
    for (int k = 0; k < 3; k++)
        soon[k] = x[FINE + k] + SOON * x[n + FINE + k];
    const double near = 0.5 * p->distance, here = largest(x + FINE, NULL, 3), there = largest(soon, NULL, 3);
    if (!(largest(soon, x + FINE, 3) < near))
        return false;
    memset(c, 0, sizeof *c);
    memcpy(c->coarse, command, sizeof c->coarse);
    for (int k = 0; k < 3; k++) {
        c->fine[k] = (here > there ? here : there) < near ? 0.0 : 0.5 * (x[FINE + k] + soon[k]);
        c->velocity[k] = p->prescribed ? 0.0 : x[n + SHIFT + k];
        c->position[k] = p->prescribed ? 0.0 : x[SHIFT + k];
        c->rotation[k] = x[TURN + k];
    }
    memcpy(c->attitude, w->place.attitude, sizeof c->attitude);
    c->step = step;
    c->rest = 1.0;
    return true;
}

/* Whether the motion has left what a map at rest is for, by so many times what is allowed.  Servos that rest away from it have another place. */
static bool has_left(const Plant *p, const Centre *c, const double *x, const double *last, double times)
{
    const int64_t n = count_coordinates(p), s = 2 * n;
    const double apart = largest(x + s, c->coarse, 3);
    return !(apart <= times * p->distance) || !(largest(x + FINE, c->fine, 3) <= times * p->distance) ||
           !(largest(x + TURN, c->rotation, 3) <= times * p->angle) ||
           !(largest(x + s + 3, NULL, 3) <= times * p->speed) ||
           (apart > AT_REST && memcmp(x + s, last, 3 * sizeof *last) == 0);
}

/* From rest to motion: the exact place, and the true momentum, which outer forces have changed in the meantime. */
static bool begin_motion(Plant *p, Memory *w, const double *x)
{
    const int64_t n = count_coordinates(p);
    const Model *model = find_model(p, &w->present);
    if (model == NULL)
        return false;
    const Centre *c = &model->centre;
    double turn[3], now[6], impulse[3], turned[3], before[3], moment[3];
    w->place = model->place;
    for (int k = 0; k < 3; k++)
        turn[k] = x[TURN + k] - c->rotation[k];
    turn_attitude(w->place.attitude, turn);
    if (!find_place(p, x + 2 * n, x + 9 + p->mechanism->n_bus, x + FINE, &w->place))
        return false;
    w->moving = MOVES;
    w->parts = w->step_before = w->countdown = 0.0;
    memset(w->lead, 0, sizeof w->lead);
    if (p->prescribed) {
        keep_promise(p, w, &model->place, &w->place, x);
        return true;
    }
    if (!evaluate(p, &w->place, x, w->input) || !find_linear_momentum(p, model, x, now))
        return false;
    for (int k = 0; k < 6; k++)
        now[k] -= w->at_rest[k];
    rotate(c->attitude, now, false, impulse);
    rotate(c->attitude, now + 3, false, turned);
    cross(w->centre, w->momentum, before);
    for (int k = 0; k < 3; k++)
        w->momentum[k] += impulse[k];
    take_momentum(p, w, x, false);
    cross(w->centre, w->momentum, moment);
    for (int k = 0; k < 3; k++)
        w->angular[k] += turned[k] + (moment[k] - before[k]);
    return true;
}

/* From motion to rest. */
static bool begin_rest(Plant *p, const Model *model, Memory *w, double *x)
{
    const int64_t s = 2 * count_coordinates(p);
    for (int k = 0; k < 3; k++) {
        x[s + k] = x[s + 6 + k] = model->centre.coarse[k];
        x[s + 3 + k] = 0.0;
    }
    w->moving = RESTS;
    w->parts = 0.0;
    w->present = model->centre;
    find_locked(p, &p->point, w->locked);
    if (p->prescribed) {
        keep_promise(p, w, &w->place, &model->place, x);
        return true;
    }
    return find_linear_momentum(p, model, x, w->at_rest);
}

/* The references go to the command over a time, limited in rate. */
static void find_reference_rates(const Plant *p, const double *command, const double *reference, double time, double *input)
{
    for (int k = 0; k < 3; k++)
        input[MECHANISM_REFERENCE_RATE + k] = clip((command[k] - reference[k]) / time, -p->rate_limit, p->rate_limit);
}

/* A step at rest: x and y are written if it is done.  It is not done where it is long and leaves rest. */
enum { REST_REFUSED, REST_DONE, REST_LEFT };

static int rest(Plant *p, Memory *kept, const Model *model, const double *input, double *x, double *y)
{
    const int64_t n_x = count_states(p);
    double *given = p->operand + n_x;
    memcpy(p->operand, x, sizeof *x * (size_t)n_x);
    memcpy(given, input, sizeof *given * MECHANISM_INPUTS);
    given[MECHANISM_INPUTS] = 1.0;
    if (!kernel_map(&model->to_rest))
        return REST_REFUSED;
    memcpy(p->operand, p->result, sizeof *x * (size_t)n_x);
    const bool left = has_left(p, &model->centre, p->operand, x + n_x - 9, 1.0);
    if (left && (model->centre.step > BRIEF || has_left(p, &model->centre, p->operand, x + n_x - 9, SUDDEN)))
        return REST_LEFT;
    if (!kernel_map(&model->to_outputs))
        return REST_REFUSED;
    memcpy(x, p->operand, sizeof *x * (size_t)n_x);
    memcpy(y, p->result, sizeof *y * MECHANISM_OUTPUTS);
    memcpy(kept->input, input, sizeof kept->input);
    kept->present.step = model->centre.step;
    kept->moving = left ? BEGINS : RESTS;
    return REST_DONE;
}

/* All inner steps of a step; `ahead`: with the work on the next model. */
static bool move_through(Plant *p, Memory *w, double step, double *input, const double *command, double *x, bool ahead)
{
    const int64_t parts = count_parts(step, INNER_STEP), ramps = count_parts(step, RAMP), r = count_states(p) - 3;
    if (parts == MOST_PARTS)
        return false;
    for (int64_t k = 0; k < parts; k++) {
        if (k % (parts / ramps) == 0)
            find_reference_rates(p, command, x + r, step / (double)ramps, input);
        if (!move_on(p, w, x, step / (double)parts, input) || (ahead && !look_ahead(p, w, x)))
            return false;
    }
    return true;
}

/* A step in motion, likewise. */
static bool move(Plant *p, Memory *w, double step, double *input, const double *command, double *x, double *y)
{
    Centre settled;
    if (w->present.step != step) { /* maps are for steps of one size */
        w->present.step = step;
        w->parts = 0.0;
    }
    if (!move_through(p, w, step, input, command, x, true))
        return false;
    memcpy(y, p->point.outputs, sizeof p->point.outputs);
    if (!has_come_to_rest(p, w, x, command, step, &settled)) {
        if (w->next.rest != 0.0)
            w->parts = 0.0;
        return true;
    }
    if (w->parts > 0.0 && w->next.rest != 0.0) {
        Model *model = p->models + (memcmp(&p->models[0].centre, &w->next, sizeof w->next) == 0 ? 0 : 1);
        if (memcmp(w->next.coarse, command, sizeof w->next.coarse) != 0)
            w->parts = 0.0;
        else if (model_make(p, model, &w->next, (int64_t)w->parts) == MODEL_READY) {
            if (!has_left(p, &w->next, x, w->last, 1.0))
                return begin_rest(p, model, w, x);
            w->parts = 0.0;
        }
    }
    if (w->parts == 0.0 || w->next.rest == 0.0) {
        w->next = settled;
        w->parts = 0.0;
        return work_ahead(p, find_model(p, &w->present), w);
    }
    return true;
}

static const char *const MOTIONS[] = {
    "prescribed_acceleration", "prescribed_angular_acceleration", "prescribed_angular_velocity", "base_force", "base_torque",
};

/* Which of these are set, and have no effect: bits. */
static int find_unused(const Plant *p, const double *u)
{
    int unused = 0;
    for (int k = 0; k < (p->prescribed ? 2 : 3); k++)
        if (largest(u + (p->prescribed ? MECHANISM_BASE_WRENCH : BASE_MOTION) + 3 * k, NULL, 3) != 0.0)
            unused |= 1 << k;
    return unused;
}

/* Warn of a command beyond the stroke, and of inputs without effect: each time that it is another one. */
static void warn(const Plant *p, Core *core, Memory *kept, const double *u)
{
    double excess[3];
    int worst = 0;
    for (int k = 0; k < 3; k++) {
        excess[k] = u[COMMAND + k] - clip(u[COMMAND + k], p->low, p->high);
        worst = fabs(excess[k]) > fabs(excess[worst]) ? k : worst;
    }
    const int unused = find_unused(p, u);
    if (largest(excess, NULL, 3) != 0.0 && largest(kept->excess, NULL, 3) == 0.0)
        write_message(core, MESSAGE_WARNING, "coarse_command_%d: %.6g m is outside the stroke [%.6g, %.6g] m; held at its end",
                      worst + 1, u[COMMAND + worst], p->low, p->high);
    memcpy(kept->excess, excess, sizeof excess);
    if (unused != 0 && unused != (int)kept->unused) {
        char names[160] = "";
        for (int k = 0; k < 3; k++)
            if (unused & 1 << k) {
                strcat(names, names[0] == '\0' ? "" : ", ");
                strcat(names, MOTIONS[p->prescribed ? 3 + k : k]);
            }
        write_message(core, MESSAGE_WARNING, "base = %s: no effect of %s", p->prescribed ? "prescribed" : "own", names);
    }
    kept->unused = unused;
}

/* The step after one at rest, as far as it is expected: the state then. */
static bool rest_on(Plant *p, const Model *model, const double *x, double *next)
{
    const int64_t n_x = count_states(p);
    memcpy(p->operand, x, sizeof *x * (size_t)n_x); /* behind it are the inputs */
    if (!kernel_map(&model->to_rest))
        return false;
    memcpy(next, p->result, sizeof *x * (size_t)n_x);
    return true;
}

/* A step from w and x to w, x and y; false: refused. */
static bool take_step(Plant *p, Memory *w, double step, double *input, const double *command, const double *turn, double *x,
                      double *y)
{
    const int64_t n = count_coordinates(p), n_x = count_states(p);
    double next[MECHANISM_STATES];
    Carried start, now, after;
    if (p->prescribed)
        memcpy(x + n + TURN, turn, 3 * sizeof *x);
    if (p->prescribed && w->moving == RESTS) {
        Centre centre = w->present;
        centre.step = step;
        const Model *model = find_model(p, &centre);
        if (model == NULL)
            return false;
        find_carried(p, &model->place, x, turn, &start);
        const int done = rest(p, w, model, input, x, y);
        if (done == REST_DONE) {
            find_carried(p, &model->place, x, turn, &now);
            if (!rest_on(p, model, x, next))
                return false;
            find_carried(p, &model->place, next, turn, &after);
            react(w, &start, &now, &after, input, &model->place, turn, step, y + MECHANISM_OUTPUTS);
        }
        if (done != REST_LEFT)
            return done == REST_DONE;
    }
    if (w->moving != MOVES) {
        w->present.step = step;
        if (!begin_motion(p, w, x))
            return false;
    }
    if (p->prescribed)
        find_carried(p, &w->place, x, turn, &start);
    if (!move(p, w, step, input, command, x, y))
        return false;
    if (p->prescribed) {
        Memory expected = *w;
        memcpy(next, x, sizeof *x * (size_t)n_x);
        find_locked(p, &p->point, w->locked);
        find_carried(p, &w->place, x, turn, &now);
        if (!move_through(p, &expected, step, input, command, next, false))
            return false;
        find_carried(p, &expected.place, next, turn, &after);
        react(w, &start, &now, &after, input, &w->place, turn, step, y + MECHANISM_OUTPUTS);
    }
    return true;
}

int64_t plant_step(void *arguments, Core *core)
{
    Plant *p = arguments;
    double *x = core->data + p->state, *y = core->data + p->output;
    const double *u = core->data + p->input;
    Memory *kept = (Memory *)(core->data + p->memory);
    double input[MECHANISM_INPUTS] = {0.0}, command[3];
    memcpy(input, u, sizeof *u * N_LOADS);
    if (p->prescribed) {
        memset(input + MECHANISM_BASE_WRENCH, 0, 6 * sizeof *input);
        memcpy(input + MECHANISM_BASE_MOTION, u + BASE_MOTION, 6 * sizeof *input);
    }
    for (int k = 0; k < 3; k++)
        command[k] = clip(u[COMMAND + k], p->low, p->high);
    find_reference_rates(p, command, x + count_states(p) - 3, core->step, input);
    int done = REST_LEFT;
    if (kept->moving == RESTS && !p->prescribed) {
        Centre centre = kept->present;
        centre.step = core->step;
        const Model *model = find_model(p, &centre);
        done = model == NULL ? REST_REFUSED : rest(p, kept, model, input, x, y);
    }
    if (done == REST_LEFT) {
        Memory w = *kept; /* written back when the step is done */
        double moved[MECHANISM_STATES], outputs[N_OUTPUTS];
        memcpy(moved, x, sizeof *x * (size_t)count_states(p));
        done = take_step(p, &w, core->step, input, command, u + BASE_TURN, moved, outputs);
        if (done) {
            *kept = w;
            memcpy(x, moved, sizeof *x * (size_t)count_states(p));
            memcpy(y, outputs, sizeof *y * (size_t)(p->prescribed ? N_OUTPUTS : MECHANISM_OUTPUTS));
        }
    }
    if (!done) {
        if (count_parts(core->step, INNER_STEP) == MOST_PARTS)
            write_message(core, MESSAGE_REFUSAL, "a step of %g s in motion, or so long that few digits would be right: "
                          "expected less than %g s", core->step, INNER_STEP * MOST_PARTS);
        else
            write_message(core, MESSAGE_REFUSAL, "the step leads to a singular pose of the legs, or to numbers that are not "
                          "finite");
        return CALL_REFUSED;
    }
    memcpy(kept->last, x + count_states(p) - 9, sizeof kept->last);
    memcpy(y + MECHANISM_OUTPUTS + 6, kept->locked, sizeof kept->locked);
    warn(p, core, kept, u);
    return CALL_DONE;
}

int64_t plant_begin(void *arguments, Core *core)
{
    Plant *p = arguments;
    const double *u = core->data + p->input;
    double *x = core->data + p->state, *y = core->data + p->output, attitude[4], momentum[6], mass[4], moment[3];
    Memory *kept = (Memory *)(core->data + p->memory);
    const int64_t n = count_coordinates(p);
    memcpy(attitude, kept->place.attitude, sizeof attitude);
    memset(kept, 0, sizeof *kept);
    kept->place = p->nominal;
    memcpy(kept->place.attitude, attitude, sizeof attitude);
    memcpy(kept->input, u, sizeof *u * N_LOADS);
    p->evaluated = 0;
    if (p->prescribed) {
        memset(kept->input + MECHANISM_BASE_WRENCH, 0, 6 * sizeof *u);
        memcpy(kept->input + MECHANISM_BASE_MOTION, u + BASE_MOTION, 6 * sizeof *u);
    }
    if (!find_place(p, x + 2 * n, NULL, x + FINE, &kept->place) || !evaluate(p, &kept->place, x, kept->input))
        return CALL_REFUSED;
    kept->moving = largest(x + n + TURN, NULL, 3) > 0.0 ? MOVES : RESTS;
    if (kept->moving == MOVES && !p->prescribed) { /* all turns as one body, about its centre of mass */
        mechanism_find_momentum(p->mechanism, &p->point, x, momentum, mass);
        for (int k = 0; k < 3; k++)
            x[n + SHIFT + k] -= momentum[k] / mass[0];
        if (!evaluate(p, &kept->place, x, kept->input))
            return CALL_REFUSED;
    }
    memcpy(y, p->point.outputs, sizeof p->point.outputs);
    find_locked(p, &p->point, kept->locked);
    memcpy(y + MECHANISM_OUTPUTS + 6, kept->locked, sizeof kept->locked);
    Centre *c = &kept->present;
    memcpy(c->coarse, x + 2 * n, sizeof c->coarse);
    memcpy(c->velocity, x + n + SHIFT, sizeof c->velocity);
    memcpy(c->attitude, attitude, sizeof attitude);
    memcpy(kept->last, c->coarse, sizeof kept->last);
    memcpy(kept->start, c->coarse, sizeof kept->start);
    c->rest = 1.0;
    c->step = core->step;
    kept->unused = find_unused(p, u);
    if (p->prescribed)
        return CALL_DONE;
    take_momentum(p, kept, x, true);
    mechanism_find_momentum(p->mechanism, &p->point, x, kept->at_rest, mass);
    for (int k = 0; k < 3; k++)
        momentum[k] = mass[1 + k] / mass[0];
    cross(momentum, kept->at_rest, moment);
    for (int k = 0; k < 3; k++)
        kept->at_rest[3 + k] -= moment[k];
    return CALL_DONE;
}
