/* The step of the pointing controller; pointing.py has the equations. */
#include <math.h>

#include "axes.h"
#include "mechanism.h"
#include "vectors.h"

/* First and second integral of the error (rad.s, rad.s2), command of the payload's rotation and its rate. */
typedef struct {
    Vector integral, second_integral, command, rate;
} Filter;

/* Constants, places in the buffer, and the gains of the orientation mechanism.key. */
typedef struct {
    Mechanism mechanism;
    AxisFilter filter;         /* of what is integrated, and of an integral that is held beside it */
    double acceleration[4];    /* w'' of an axis by its states */
    double limit;              /* N; infinite: none */
    int64_t orientation, kept; /* see find_kept_motion */
    int64_t error;             /* rad, P */
    int64_t states;
    int64_t unlimited;         /* forces before their limit, 3 */
    int64_t locked, enabled;
    int64_t forces;            /* behind them, whether one is at its limit */
    Matrix elongation, rotation, mass; /* of the fine legs by rotation in P; its inverse; (28) */
} Pointing;

static int renew_gains(Pointing *c, Core *core)
{
    Pose pose;
    Motion motion;
    const int found = find_kept_motion(&c->mechanism, core, c->orientation, c->kept, &pose, &motion);
    if (found == RENEWED) {
        find_mass(&c->mechanism, &pose, &motion, c->mass);
        multiply(motion.elongation, pose.R, c->elongation);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                c->rotation[i][k] = pose.R[0][i] * motion.theta[0][k] + pose.R[1][i] * motion.theta[1][k] +
                                    pose.R[2][i] * motion.theta[2][k];
    }
    return found != UNREACHABLE;
}

/* Forces by the command, through the notch. */
static void find_forces(const Pointing *c, const Filter *x, double *force)
{
    Vector second, elongation[3];
    for (int k = 0; k < 3; k++)
        second[k] = c->acceleration[0] * x->integral[k] + c->acceleration[1] * x->second_integral[k] +
                    c->acceleration[2] * x->command[k] + c->acceleration[3] * x->rate[k];
    for (int i = 0; i < 3; i++) {
        elongation[0][i] = dot(c->elongation[i], x->command);
        elongation[1][i] = dot(c->elongation[i], x->rate);
        elongation[2][i] = dot(c->elongation[i], second);
    }
    for (int i = 0; i < 3; i++)
        force[i] = dot(c->mass[i], elongation[2]) + c->mechanism.damping[i] * elongation[1][i] +
                   c->mechanism.stiffness[i] * elongation[0][i];
}

/* What the limit cut off in the last step goes back to the integrals.  Without lock, the first integral is held beside the
   filter, so that neither integral changes.  Disabled, all is 0. */
EXPORT int64_t control_point(void *arguments, Core *core)
{
    Pointing *c = arguments;
    const double *error = core->data + c->error;
    double *unlimited = core->data + c->unlimited, *force = core->data + c->forces, u[INPUTS][AXES] = {{0.0}};
    Filter *x = (Filter *)(core->data + c->states);
    Vector cut;
    force[3] = 0.0;
    if (!renew_gains(c, core))
        return CALL_REFUSED;
    if (core->data[c->enabled] == 0.0) {
        *x = (Filter){{0.0}, {0.0}, {0.0}, {0.0}};
        for (int k = 0; k < 3; k++)
            force[k] = unlimited[k] = 0.0;
        return CALL_DONE;
    }
    for (int k = 0; k < 3; k++) {
        const double before = unlimited[k], most = c->limit;
        cut[k] = (before > most ? before - most : before < -most ? before + most : 0.0) / c->mechanism.stiffness[k];
    }
    const int locked = core->data[c->locked] != 0.0;
    for (int k = 0; k < 3; k++)
        if (locked)
            u[0][k] = error[k] - dot(c->rotation[k], cut);
        else {
            u[1][k] = x->integral[k];
            x->integral[k] = 0.0;
        }
    if (!step_axes(&c->filter, core, x->integral, u))
        return CALL_REFUSED;
    for (int k = 0; k < 3; k++)
        x->integral[k] += u[1][k];
    find_forces(c, x, force);
    for (int k = 0; k < 3; k++)
        unlimited[k] = force[k];
    return CALL_DONE;
}
