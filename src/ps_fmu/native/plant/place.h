/* Where the platform is, from step to step. */
#ifndef PS_FMU_PLACE_H
#define PS_FMU_PLACE_H

#include "model.h"
#include "turns.h"

#include <string.h>

/* Places in the state: fine legs; position and turn of B. */
enum { FINE = 0, SHIFT = 3, TURN = 6 };

/* Largest turn of the platform about an axis in an inner step, rad: the series of turn_rotation hold up to 0.5 rad. */
static const double MOST_TURN = 0.25;

/* False: it turns too far. */
static bool move_place(double t[3], double R[9], const double J_pl[36], const double lengths[6])
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
    return largest(move + 3, NULL, 3) <= MOST_TURN;
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
static bool follow(const Plant *p, const double J_pl[36], const double change[6], const double lengths[6], double t[3],
                   double R[9])
{
    double present[6];
    const bool near = move_place(t, R, J_pl, change);
    find_lengths(p, t, R, present);
    for (int k = 0; k < 6; k++)
        present[k] = lengths[k] - present[k];
    return move_place(t, R, J_pl, present) && near;
}

/* False: the platform turns too far. */
static bool follow_legs(const Plant *p, const double *before, const double *x, Place *place)
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
    return follow(p, p->point.J_pl, change, lengths, place->translation, place->rotation) &&
           follow(p, p->point.nominal_J_pl, nominal_change, nominal, place->nominal_translation, place->nominal_rotation);
}

#endif
