/* Steps of the pointing controller around the map of its filter; pointing.py has the equations. */
#include <math.h>

#include "mechanism.h"
#include "vectors.h"

/* First and second integral of the error (rad.s, rad.s2), command of the payload's rotation and its rate. */
typedef struct {
    Vector integral, second_integral, command, rate;
} Filter;

/* Constants, places in the buffer, and the gains of the orientation mechanism.key. */
typedef struct {
    Mechanism mechanism;
    int64_t orientation, kept; /* see find_kept_motion */
    int64_t error;             /* rad, P */
    int64_t driving;           /* what is integrated, 3, and behind it the integral that is held without lock, 3 */
    int64_t filter, forces;
    int64_t unlimited;         /* forces before their limit, 3 */
    int64_t locked, enabled;
    double limit;              /* N; infinite: none */
    double proportional, integral, stiffness, damping; /* w'' = proportional i + integral j - stiffness w - damping w' */
    Matrix elongation, rotation, mass; /* of the fine legs by rotation in P; its inverse; (28) */
} Pointing;

/* Before the map: the gains of the orientation; the error and what goes back to the integrals of the force that the limit
   cut off.  Without lock, the first integral is held beside the map, so that neither integral changes. */
EXPORT int64_t control_drive_pointing(void *arguments, Core *core)
{
    Pointing *c = arguments;
    Mechanism *m = &c->mechanism;
    Pose pose;
    Motion motion;
    const int found = find_kept_motion(m, core, c->orientation, c->kept, &pose, &motion);
    if (found == UNREACHABLE)
        return CALL_REFUSED;
    if (found == RENEWED) {
        find_mass(m, &pose, &motion, c->mass);
        multiply(motion.elongation, pose.R, c->elongation);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                c->rotation[i][k] = pose.R[0][i] * motion.theta[0][k] + pose.R[1][i] * motion.theta[1][k] +
                                    pose.R[2][i] * motion.theta[2][k];
    }
    const double *error = core->data + c->error, *unlimited = core->data + c->unlimited;
    double *driving = core->data + c->driving, *held = driving + 3;
    Filter *x = (Filter *)(core->data + c->filter);
    Vector cut;
    for (int k = 0; k < 3; k++) {
        const double force = unlimited[k], most = c->limit;
        cut[k] = (force > most ? force - most : force < -most ? force + most : 0.0) / m->stiffness[k];
    }
    const int locked = core->data[c->locked] != 0.0;
    for (int k = 0; k < 3; k++) {
        driving[k] = locked ? error[k] - dot(c->rotation[k], cut) : 0.0;
        held[k] = locked ? 0.0 : x->integral[k];
        x->integral[k] = locked ? x->integral[k] : 0.0;
    }
    return CALL_DONE;
}

/* After the map: forces from the command through the notch; all is 0 where the controller is disabled. */
EXPORT int64_t control_add_pointing(void *arguments, Core *core)
{
    const Pointing *c = arguments;
    const int enabled = core->data[c->enabled] != 0.0;
    double *force = core->data + c->forces, *unlimited = core->data + c->unlimited, *held = core->data + c->driving + 3;
    Filter *x = (Filter *)(core->data + c->filter);
    Vector second, elongation[3];
    for (int k = 0; k < 3; k++) {
        x->integral[k] = enabled ? x->integral[k] + held[k] : 0.0;
        x->second_integral[k] = enabled ? x->second_integral[k] : 0.0;
        x->command[k] = enabled ? x->command[k] : 0.0;
        x->rate[k] = enabled ? x->rate[k] : 0.0;
        second[k] = c->proportional * x->integral[k] + c->integral * x->second_integral[k] -
                    c->stiffness * x->command[k] - c->damping * x->rate[k];
    }
    for (int i = 0; i < 3; i++) {
        elongation[0][i] = dot(c->elongation[i], x->command);
        elongation[1][i] = dot(c->elongation[i], x->rate);
        elongation[2][i] = dot(c->elongation[i], second);
    }
    for (int i = 0; i < 3; i++)
        force[i] = unlimited[i] = dot(c->mass[i], elongation[2]) + c->mechanism.damping[i] * elongation[1][i] +
                                  c->mechanism.stiffness[i] * elongation[0][i];
    return CALL_DONE;
}
