/* What faults do to the numbers of an exchange: ../faults/effects.py says what. */

#ifndef EFFECTS_H
#define EFFECTS_H

#include <stdint.h>

typedef enum { OVERRIDE, BIAS, SCALE, ADD, REPLACE_LOST, HOLD, DELAY } EffectKind;

typedef struct {
    int64_t kind;
    int64_t place; /* of the input */
    int64_t length; /* of a delay, steps */
    double value;
    double *memory; /* step of the first use, or -1; step of the last; what is held */
    const double *samples; /* of the steps that the group is prepared for, or NULL */
} Effect;

/* Effects in their order.  The next step is `step`; its samples are in `row`. */
typedef struct {
    const Effect *effects;
    int64_t count;
    int64_t step;
    int64_t row;
} Effects;

void change_doubles(Effects *group, double *inputs);
void change_ints(Effects *group, int *inputs);

#endif
