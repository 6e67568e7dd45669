/* The mechanism: manipulator, payload and bus in any motion.  What is not linear is generated from equations.py
   (equations.h); this file has the state of the plant about it: modes, springs, servos, outputs.

   All in SI units.  B: frame of the base, P: of the payload platform; a rotation maps components in P to components in B
   and is kept row by row.  + - * / and square roots only: the same bits on all processors.  No function keeps anything.

   State x, n = 12 + n_bus + n_payload coordinates:
       x = [q, q', s, s', r]    q = [d_f (3), t_b (3), theta_b (3), x_m (n_bus), e_c (3), x_t (n_payload)]
   d_f: elongation of the fine legs, m.  t_b, theta_b: place (m) and integral of the angular velocity (rad) of B, in B,
   which turns.  q' of these: velocity (m/s) and angular velocity (rad/s) of B, in B.  x_m, x_t: modes of bus and payload.
   e_c: stretch of the coarse rods, m.  s: displacement of the coarse actuators, m; r: their references, m.
   Coordinates that are switched off keep their places; they do not move. */
#ifndef MECHANISM_H
#define MECHANISM_H

#include "../kernel/core.h"
#include "equations.h"

enum {
    MECHANISM_BUS_MODES = 16,
    MECHANISM_PAYLOAD_MODES = 14,
    MECHANISM_COORDINATES = 12 + MECHANISM_BUS_MODES + MECHANISM_PAYLOAD_MODES,
    MECHANISM_STATES = 2 * MECHANISM_COORDINATES + 9,
};

/* Places in the input. */
enum {
    MECHANISM_FINE_FORCE = 0,      /* N, of the voice coils on the fine legs (3) */
    MECHANISM_BASE_WRENCH = 3,     /* N, N.m, on B at its origin, in B (6) */
    MECHANISM_ADDED_FORCE = 9,     /* N, further forces on the fine legs (3) */
    MECHANISM_PAYLOAD_WRENCH = 12, /* N, N.m, on P at its origin, in P (6) */
    MECHANISM_REFERENCE_RATE = 18, /* m/s, of the coarse references (3) */
    MECHANISM_BASE_MOTION = 21,    /* m/s2, rad/s2: accelerations of B where they are prescribed, else zero (6) */
    MECHANISM_INPUTS = 27
};

/* Places in the output; signals.py describes each. */
enum {
    MECHANISM_BASE_ACCELERATION = 0,
    MECHANISM_BASE_ANGULAR_ACCELERATION = 3,
    MECHANISM_BASE_VELOCITY = 6,
    MECHANISM_BASE_ANGULAR_VELOCITY = 9,
    MECHANISM_BASE_POSITION = 12,
    MECHANISM_BASE_ROTATION = 15,
    MECHANISM_PAYLOAD_POSITION = 18,
    MECHANISM_PAYLOAD_ROTATION = 21,
    MECHANISM_FINE_DISPLACEMENT = 24,
    MECHANISM_COARSE_DISPLACEMENT = 27,
    MECHANISM_ORIENTATION = 30,
    MECHANISM_RELATIVE_ORIENTATION = 33,
    MECHANISM_LOS = 36,
    MECHANISM_FINE_VELOCITY = 38,
    MECHANISM_LINE_OF_SIGHT = 41,
    MECHANISM_BASE_ATTITUDE = 43,
    MECHANISM_PAYLOAD_ATTITUDE = 47,
    MECHANISM_OUTPUTS = 51
};

/* A mode: m x'' + c x' + k x = - p . (acceleration of its body) + w . I' w / 2. */
typedef struct Mode {
    double momentum[6];  /* p: of its body by x', linear, angular about the body's origin, in the body's axes */
    double inertia[6];   /* I': of its body by x, xx xy xz yy yz zz; bus: not used */
    double stiffness, damping;
    double mass;         /* m; 1 for modes of the bus */
    double mobility;     /* 1 / m; 0: switched off */
    double sight[2];     /* turn of the line of sight about x and y of P by x, rad; bus: not used */
} Mode;

/* Parameters.  The first fields are what the generated functions take. */
typedef struct Mechanism {
    EquationsParameters rigid;
    double nominal_lengths[6]; /* m */
    double leg_stiffness[6], leg_damping[6]; /* N/m, N.s/m: coarse rods, suspensions of the fine legs */
    double mask[12];           /* 1: moves; 0: does not, or as it is prescribed; rods (3), fine legs (3), base (6) */
    double servo_stiffness, servo_damping; /* 1/s2, 1/s */
    double focal_length;       /* m */
    double radius;             /* m: root mean square of the platform's joints, for the condition of J_lp */
    int64_t n_bus, n_payload;  /* modes that have coordinates */
    Mode bus[MECHANISM_BUS_MODES], payload[MECHANISM_PAYLOAD_MODES];
} Mechanism;

/* Where the platform is, by all legs and by the coarse ones alone (nominal), and the attitude of B: data beside x. */
typedef struct Place {
    double translation[3], rotation[9];                 /* P in B: m, 1 */
    double nominal_translation[3], nominal_rotation[9];
    double attitude[4];                                 /* unit quaternion, scalar first, B to inertial axes */
} Place;

/* All that there is at a state: results, then what derivatives there need. */
typedef struct Point {
    double rates[MECHANISM_STATES];   /* x' */
    double outputs[MECHANISM_OUTPUTS];
    double reaction[6];               /* N, N.m: what the base needs from outside beside the base wrench, in B at its
                                         origin; zero where it moves by forces */
    double twist[6], nominal_twist[6]; /* m/s, rad/s: of both places relative to B, in B; R' = skew(w) R */
    double J_pl[36], nominal_J_pl[36]; /* motion of both places (m, rad, in B) by leg lengths, coarse legs first */
    double accelerations[12], body[6], spin[6], kept[18], lower[66], divisors[12], base_rows[72];
    EquationsMotion motion;
    double velocity[3], turn[3], position[3]; /* of B */
    EquationsPlace place;
} Point;

/* J_pl (36) at a place of the platform.  0: singular, or nearly so, or not finite. */
EXPORT int64_t mechanism_invert(const Mechanism *, const double translation[3], const double rotation[9], double J_pl[36]);

/* The place of the platform with these leg lengths (6, m), from one that is near: Newton's method.
   The rotation stays one.  0: at most 20 steps lead to no place. */
EXPORT int64_t mechanism_find_place(const Mechanism *, const double lengths[6], double translation[3], double rotation[9]);

/* Rates, outputs and all else at a state.  0: a place is singular, or something is not finite. */
EXPORT int64_t mechanism_evaluate(const Mechanism *, const Place *, const double *x, const double u[MECHANISM_INPUTS], Point *);

/* What a change of the inputs (references' rates and servos aside) adds to the rates at a point, exactly. */
EXPORT void mechanism_accelerate(const Mechanism *, const Point *, const double du[MECHANISM_INPUTS], double *d_rates);

/* Derivatives of rates, outputs and reaction along a direction of state and input.  The places move with the legs, the
   attitude turns with theta_b. */
EXPORT void mechanism_differentiate(const Mechanism *, const Point *, const double *dx, const double du[MECHANISM_INPUTS],
                                    double *d_rates, double d_outputs[MECHANISM_OUTPUTS], double d_reaction[6]);

/* A, B, C, D about a state, row by row: (states, states), (states, inputs), (outputs, states), (outputs, inputs); and of
   the reaction (6, states), (6, inputs).  Columns from `first` to before `end` of [A B], [C D], [E F]. */
EXPORT void mechanism_linearise(const Mechanism *, const Point *, double *A, double *B, double *C, double *D, double *E,
                                double *F, int64_t first, int64_t end);

/* Mass matrix M (n, n), inertial coupling of the coarse actuators (n, 3), and mass of legs and payload as one body on the
   base (6, 6), at a place of the platform (J_pl there) and with the modes' displacements in q (NULL: zero).  Coordinates
   that are switched off have their rows. */
EXPORT void mechanism_find_masses(const Mechanism *, const double translation[3], const double rotation[9],
                                  const double J_pl[36], const double *q, double *M, double *m_c, double locked[36]);

/* Momentum of all, linear and angular about the origin of B (6, N.s, N.m.s); mass (kg) and first moment (kg.m) about it. */
EXPORT void mechanism_find_momentum(const Mechanism *, const Point *, const double *x, double momentum[6], double mass[4]);

/* The same at a place, by the state's rates, with B turning as given (rad/s) and its origin at rest. */
EXPORT void mechanism_find_relative_momentum(const Mechanism *, const Place *, const double *x, const double turn[3],
                                             double momentum[6]);

#endif
