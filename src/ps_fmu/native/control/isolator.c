/* The step of the feedforward isolator; feedforward.py has the equations. */
#include "axes.h"
#include "mechanism.h"
#include "vectors.h"

enum { HIGHPASS = 2 /* states */, ORDER = MOST_STATES - HIGHPASS };

/* Constants, places in the buffer, and the gains of the orientation mechanism.key. */
typedef struct {
    Mechanism mechanism;
    AxisFilter filter;         /* high-passed rotation of the base and its rate; the low-pass of the forces by its acceleration */
    double lowpass[ORDER];     /* force of each axis by its states */
    int64_t orientation, kept; /* see find_kept_motion */
    int64_t acceleration;      /* of the base, 6 */
    int64_t states, enabled;
    int64_t forces;            /* behind them, whether one is at its limit */
    double acceleration_gain[3][6];
    Matrix stiffness_gain, damping_gain; /* (54), (53), of rotations of the base: those of translations are 0 */
} Isolator;

/* The filters run whether the isolator is enabled or not. */
EXPORT int64_t control_isolate(void *arguments, Core *core)
{
    Isolator *c = arguments;
    Mechanism *m = &c->mechanism;
    Pose pose;
    Motion motion;
    const int found = find_kept_motion(m, core, c->orientation, c->kept, &pose, &motion);
    if (found == UNREACHABLE)
        return CALL_REFUSED;
    if (found == RENEWED) {
        find_acceleration_gain(m, &pose, &motion, c->acceleration_gain);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) {
                c->stiffness_gain[i][k] = -m->stiffness[i] * motion.elongation[i][k];
                c->damping_gain[i][k] = -m->damping[i] * motion.elongation[i][k];
            }
    }
    const double *a = core->data + c->acceleration, enabled = core->data[c->enabled];
    double *x = core->data + c->states, *force = core->data + c->forces, u[INPUTS][AXES];
    for (int i = 0; i < 3; i++) {
        u[0][i] = a[3 + i];
        u[1][i] = dot(c->acceleration_gain[i], a) + dot(c->acceleration_gain[i] + 3, a + 3);
    }
    if (!step_axes(&c->filter, core, x, u))
        return CALL_REFUSED;
    const double *position = x, *rate = x + AXES, *low = x + AXES * HIGHPASS;
    for (int i = 0; i < 3; i++) {
        double sum = dot(c->stiffness_gain[i], position) + dot(c->damping_gain[i], rate);
        for (int j = 0; j < ORDER; j++)
            sum += c->lowpass[j] * low[AXES * j + i];
        force[i] = enabled == 0.0 ? 0.0 : sum;
    }
    force[3] = 0.0;
    return CALL_DONE;
}
