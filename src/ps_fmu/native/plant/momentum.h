/* Total momentum and centre of mass, which outer forces alone change; on a base that the host moves, its reaction. */
#ifndef PS_FMU_MOMENTUM_H
#define PS_FMU_MOMENTUM_H

#include "place.h"

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

/* Relative momentum; and momentum of legs and payload as the host has them, locked, while the base turns. */
typedef struct {
    double relative[6], locked[6];
} Carried;

static void find_carried(const Plant *p, const Place *place, const double *x, const double locked[10], const double turn[3],
                         Carried *found)
{
    const double still[3] = {0.0}, *I = locked + 4;
    mechanism_find_relative_momentum(p->mechanism, place, x, still, found->relative);
    cross(turn, locked + 1, found->locked);
    for (int k = 0; k < 3; k++)
        found->locked[k] *= locked[0];
    found->locked[3] = I[0] * turn[0] + I[1] * turn[1] + I[2] * turn[2];
    found->locked[4] = I[1] * turn[0] + I[3] * turn[1] + I[4] * turn[2];
    found->locked[5] = I[2] * turn[0] + I[4] * turn[1] + I[5] * turn[2];
}

/* What the base feels over the next step: mean of W = w_p - dP/dt - w x P - dL/dt, with the wrench w_p on the payload,
   the relative momentum P, and L that of the locked mass, whose own forces the host has.  The impulse that is promised
   leads to the momentum at the end of the next step, as expected; what was promised before is taken back.  So the sum of
   all impulses is what the mechanism has taken, wherever its momentum was linear about a place and is not any more. */
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

#endif
