/* Steps of the feedforward isolator around the map of its filters; feedforward.py has the equations. */
#include "mechanism.h"
#include "vectors.h"

/* Constants, places in the buffer, and the gains of the orientation mechanism.key. */
typedef struct {
    Mechanism mechanism;
    int64_t orientation, kept; /* see find_kept_motion */
    int64_t acceleration;      /* of the base, 6 */
    int64_t driven;            /* forces by it, which the map filters, 3 */
    int64_t filtered;          /* high-passed rotation of the base and its rate, 6 */
    int64_t forces, enabled;
    double acceleration_gain[3][6];
    Matrix stiffness_gain, damping_gain; /* (54), (53), of rotations of the base: those of translations are 0 */
} Isolator;

/* Before the map: the gains of the orientation, and what drives the low-pass. */
EXPORT int64_t control_drive_isolator(void *arguments, Core *core)
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
    const double *a = core->data + c->acceleration;
    double *driven = core->data + c->driven;
    for (int i = 0; i < 3; i++)
        driven[i] = dot(c->acceleration_gain[i], a) + dot(c->acceleration_gain[i] + 3, a + 3);
    return CALL_DONE;
}

/* After the map: add what the high-passed motion of the base demands; no force where the isolator is disabled. */
EXPORT int64_t control_add_isolator(void *arguments, Core *core)
{
    const Isolator *c = arguments;
    const double *position = core->data + c->filtered, *rate = position + 3, enabled = core->data[c->enabled];
    double *force = core->data + c->forces;
    for (int i = 0; i < 3; i++)
        force[i] = enabled == 0.0 ? 0.0 : force[i] + (dot(c->stiffness_gain[i], position) + dot(c->damping_gain[i], rate));
    return CALL_DONE;
}
