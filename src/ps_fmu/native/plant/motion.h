/* The plant over a step: at rest one linear map about a pose, in motion the mechanism itself.

   In motion x' = f(x, u) is stepped about the linear model at rest at a pose nearby, x' = A x + B u, whose stiff part the
   exponential takes exactly, and the rest g = f - A x explicitly (exponential Adams-Bashforth method of order two;
   M. Hochbruck, A. Ostermann, Acta Numerica 19, 2010, section 2.7):

       x(t + h) = x(t) + h phi1(h A) f + h phi2(h A) (g(t) - g(t - h))

   Long steps of the host are divided.  f is evaluated once a step: at its end, where the outputs are wanted, too.  A
   further linear model is made when the legs have moved away from the present one, in parts that each take a few
   microseconds; until it is ready the present one serves. */
#ifndef PS_FMU_PLANT_MOTION_H
#define PS_FMU_PLANT_MOTION_H

#include "../kernel/core.h"
#include "../mechanism/mechanism.h"
#include "../numerics/expm.h"

enum { MOST_COORDINATES = 42, MOST_STATES = 2 * MOST_COORDINATES + 9, N_LOADS = 18, N_PLANT_OUTPUTS = 53 };

/* What a linear model is about: everything at rest, base included, but for a constant velocity of its origin. */
typedef struct {
    double coarse[3], fine[3];                     /* m, from nominal lengths */
    double velocity_B[3], position_B[3];           /* m/s, m: of the origin of B, in B */
    double rotation_B[3], attitude[4];             /* rad; quaternion from B to inertial axes */
    double rest;                                   /* 1: map of rest, with outputs; 0: for motion */
    double step;                                   /* s, that its map is for; 0: there is none */
} Centre;

/* Where the platform is relative to B. */
typedef struct {
    double translation[3], rotation[9];            /* m; P to B, row by row */
} Pose;

/* What the plant keeps from step to step, numbers of the FMU state; PlantMemory in plant_memory.py. */
typedef struct {
    double moving;                                 /* 1: in motion */
    Centre present, next;                          /* linear models: of the map in use; of the one being made */
    double parts;                                  /* that have been made of the next one's; 0: none is being made */
    Pose pose, nominal;                            /* by all legs; by the coarse actuators alone */
    double attitude[4];                            /* of B */
    double J_pl[36], nominal_J_pl[36];             /* row by row */
    double rates[MOST_STATES];                     /* f after the last step, and the loads that acted in it */
    double loads[N_LOADS];
    double before[MOST_STATES], rates_before[MOST_STATES]; /* state at the start of the last inner step, f there */
    double step_before;                            /* s; 0: there was none */
    double momentum[3], angular_momentum[3];       /* N.s, N.m.s, about where the origin of B was at the start; inertial */
    double centre_of_mass[3];                      /* m from there; inertial */
    double at_rest[6];                             /* momentum of the linear model when it came to rest, in B */
    double countdown;                              /* inner steps until momentum is looked at */
    double excess[3], last[3];                     /* of the commands beyond the stroke, m; servos after the last step, m */
} Memory;
#endif
