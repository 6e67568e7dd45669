/* Equal linear filters of three axes side by side, for steps of any size: x' = A x + B u of each axis, with u held. */
#ifndef PS_FMU_AXES_H
#define PS_FMU_AXES_H

#include "../kernel/kernel.h"
#include "../numerics/expm.h"

enum { AXES = 3, MOST_STATES = 11, INPUTS = 2, SIZES = 4 };

/* The step of one size: rows of states and inputs, and which states a row takes. */
typedef struct {
    double step; /* s; 0: none yet */
    double factor[MOST_STATES][MOST_STATES + INPUTS];
    int64_t first[MOST_STATES], end[MOST_STATES];
} AxisStep;

typedef struct {
    Discretisation work; /* of one axis */
    AxisStep steps[SIZES];
    int64_t oldest;
} AxisFilter;

/* The step of a size; NULL: it is so long that few digits would be right. */
static AxisStep *find_axis_step(AxisFilter *f, double step)
{
    for (int k = 0; k < SIZES; k++)
        if (f->steps[k].step == step)
            return &f->steps[k];
    Discretisation *d = &f->work;
    AxisStep *made = &f->steps[f->oldest];
    made->step = 0.0;
    d->step = step;
    discretise_begin(d);
    if (discretise(d, INT64_MAX) != DISCRETISE_DONE)
        return NULL;
    for (int64_t i = 0; i < d->n; i++) {
        made->first[i] = d->n;
        made->end[i] = 0;
        for (int64_t j = 0; j < d->n; j++) {
            made->factor[i][j] = d->exponential[j * d->stride + i];
            if (made->factor[i][j] != 0.0) {
                made->first[i] = j < made->first[i] ? j : made->first[i];
                made->end[i] = j + 1;
            }
        }
        for (int64_t j = 0; j < INPUTS; j++)
            made->factor[i][MOST_STATES + j] = d->held[j * d->stride + i];
    }
    made->step = step;
    f->oldest = (f->oldest + 1) % SIZES;
    return made;
}

typedef double AxisLanes __attribute__((vector_size(32)));

/* x (n, AXES) after a step with u (INPUTS, AXES); false: the step is refused, for which a message is left. */
static int step_axes(AxisFilter *f, Core *core, double *x, double (*u)[AXES])
{
    const AxisStep *step = find_axis_step(f, core->step);
    const int64_t n = f->work.n;
    AxisLanes before[MOST_STATES], input[INPUTS];
    if (step == NULL) {
        write_message(core, MESSAGE_REFUSAL, "the step of %g s is so long that few digits of its results would be right",
                      core->step);
        return 0;
    }
    for (int64_t j = 0; j < n; j++)
        before[j] = (AxisLanes){x[AXES * j], x[AXES * j + 1], x[AXES * j + 2], 0.0};
    for (int64_t j = 0; j < INPUTS; j++)
        input[j] = (AxisLanes){u[j][0], u[j][1], u[j][2], 0.0};
    for (int64_t i = 0; i < n; i++) {
        const double *factor = step->factor[i];
        AxisLanes sum = factor[MOST_STATES] * input[0] + factor[MOST_STATES + 1] * input[1];
        for (int64_t j = step->first[i]; j < step->end[i]; j++)
            sum += factor[j] * before[j];
        for (int k = 0; k < AXES; k++)
            x[AXES * i + k] = sum[k];
    }
    return 1;
}

#endif
