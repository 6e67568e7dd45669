/* The step of the toy Pendulum: as many parts of at most 1 ms as the step has room for.  It warns once past half of the largest
   angle, and refuses beyond it. */
#include "kernel/core.h"

#include <stdio.h>

typedef struct {
    int64_t states, torque, locked, angle, passes, memory;
    double rate, most;
} Arguments;

int64_t swing(void *given, Core *core)
{
    const Arguments *a = given;
    double *data = core->data, *x = data + a->states, *kept = data + a->memory;
    const double locked = data[a->locked];
    if (locked != kept[0])
        data[a->passes] += 1.0;
    kept[0] = locked;
    const int64_t parts = (int64_t)(core->step * 1e3) + 1;
    const double h = core->step / (double)parts;
    for (int64_t k = 0; k < parts && locked == 0.0; k++) {
        x[1] += h * (data[a->torque] - a->rate * a->rate * (x[0] - x[0] * x[0] * x[0] / 6.0));
        x[0] += h * x[1];
    }
    data[a->angle] = x[0];
    if (x[0] > a->most) {
        core->message_status = MESSAGE_REFUSAL;
        snprintf(core->message, sizeof core->message, "angle %.2f rad: at most %.2f rad, 100 %%", x[0], a->most);
        return CALL_REFUSED;
    }
    if (x[0] > 0.5 * a->most && kept[1] == 0.0) {
        kept[1] = 1.0;
        core->message_status = MESSAGE_WARNING;
        snprintf(core->message, sizeof core->message, "at t = %g s past 50 %%", core->time);
    }
    return CALL_FINISHED;
}
