/* The plant over a step: at rest a linear map about a pose, in motion the mechanism itself.

   In motion x' = f(x, u) is stepped about a linear model at rest at a pose nearby, x' = A x + B u, whose stiff part the
   exponential takes exactly, and what is left explicitly: the exponential method of Adams and Bashforth of order two
   (M. Hochbruck, A. Ostermann, Acta Numerica 19, 2010, section 2.7):

       x(t + h) = x(t) + h phi1(h A) f + h phi2(h A) dg,    dg = change of f - A x over the last step

   f is evaluated once a step, at its end, where the outputs are wanted, too.  Long steps of the host are divided.  When
   the legs have moved away from the linear model, another is made in parts of a few microseconds; until it is ready the
   present one serves.

   Total momentum and centre of mass are kept beside the state by the impulse of outer forces, and the base is led to
   them.  All that a step needs lies in the state and in Memory; matrices are made again where a state was set. */
#ifndef PS_FMU_PLANT_H
#define PS_FMU_PLANT_H

#include "../kernel/core.h"
#include "../mechanism/mechanism.h"
#include "../numerics/expm.h"

/* Places among the inputs of the FMU. */
enum { LOADS = 0, N_LOADS = 18, BASE_MOTION = 18, BASE_TURN = 24, COMMAND = 27, N_INPUTS = 30 };

/* What a linear model is about: everything at rest, but for a constant velocity of B. */
typedef struct {
    double coarse[3], fine[3];                     /* m, from nominal lengths */
    double velocity[3], position[3], rotation[3];  /* m/s, m, rad: of B, in B, as in the state */
    double attitude[4];                            /* of B */
    double step;                                   /* s: of the host, that its maps are for */
    double rest;                                   /* 1: it has a map for rest */
} Centre;

/* What the plant keeps from step to step: numbers of the FMU state.  The same as the class Memory in plant.py. */
typedef struct {
    double moving;                                 /* 1: in motion */
    Centre present, next;                          /* in use; being made */
    double parts;                                  /* of the next one that are made; 0: none is being made */
    Place place;
    double input[MECHANISM_INPUTS];                /* of the last inner step */
    double before[MECHANISM_STATES], rates_before[MECHANISM_STATES]; /* at the start of the last inner step */
    double step_before;                            /* s; 0: there was none in this motion */
    double momentum[3], angular[3], centre[3];     /* N.s, N.m.s, m: true ones, about where B was at the start; inertial */
    double at_rest[6];                             /* N.s, N.m.s: when it came to rest, in B, about the centre of mass */
    double lead[9];                                /* m, m/s, rad/s: what position, velocity, turn of B lack */
    double promised[6];                            /* N.s, N.m.s: impulse to a base that the host moves */
    double countdown;                              /* inner steps to the next look at the momentum */
    double locked[10];                             /* outputs: mass, centre of mass, inertia of legs and payload */
    double start[3];                               /* m: coarse actuators at the start */
    double last[3], excess[3], unused;             /* m: actuators, commands beyond the stroke; what has no effect */
} Memory;

/* Maps about a centre. */
typedef struct {
    Centre centre;
    int64_t parts, stage, column;                  /* how far it is */
    Place place;
    double mass, inverse_inertia[9];               /* kg, 1/(kg.m2): about the centre of mass */
    double *A;                                     /* and B, by columns: (states, states + 28) */
    double *motion, *change;                       /* by columns: of a step in motion; of what is left, by the state */
    double *rest, *outputs;                        /* of the maps at rest */
    BlockRoom rooms[2];
    Map to_rest, to_outputs;
} Model;

/* Arguments of plant_step, all made by plant.py. */
typedef struct {
    const Mechanism *mechanism;
    int64_t prescribed;                            /* 1: the base moves as the host says */
    int64_t state, input, output, memory;          /* places in `data` */
    Place nominal;                                 /* with all legs at nominal length */
    double rate_limit, low, high;                  /* m/s, m */
    double distance, angle, speed;                 /* m, rad, m/s: how far rest reaches */
    Model models[2];
    int64_t latest;                                /* of the models: which was used last */
    Discretisation work;
    double *unit;                                  /* the identity, by columns */
    double *operand;                               /* of maps: (2 states + 28) */
    double *result;                                /* of maps */
    /* What was evaluated last, and where. */
    int64_t evaluated;
    Place place;
    double x[MECHANISM_STATES], u[MECHANISM_INPUTS];
    Point point, centre;
} Plant;

/* A CALL: one step. */
EXPORT int64_t plant_step(void *arguments, Core *core);

/* At the start: places, model, outputs for the state and inputs in `data`.  0: no pose has these lengths. */
EXPORT int64_t plant_begin(void *arguments, Core *core);

#endif
