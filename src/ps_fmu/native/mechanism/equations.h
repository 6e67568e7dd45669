/* Made by 'make derive' from mechanism/equations.py. */
#ifndef EQUATIONS_H
#define EQUATIONS_H

/* p: parameters. */
typedef struct EquationsParameters {
    /* joints on the base, in B; coarse legs first (m) */
    double base_joint[18];
    /* joints on the platform, in P (m) */
    double platform_joint[18];
    /* mass of upper and lower part, their first moments along the leg from their own joints, second moment of both,
       radial inertias included (kg, kg, kg.m, kg.m, kg.m2) */
    double leg[30];
    /* mass, first moment, inertia xx xy xz yy yz zz about the origin of P, in P (kg, kg.m, kg.m2) */
    double payload[10];
    /* sum p p'/m of its modes (kg, kg.m, kg.m2) */
    double payload_less[36];
    /* sum p I'/m of its modes (kg.m, kg.m2) */
    double payload_turning[36];
    /* as payload, about the origin of B, in B (kg, kg.m, kg.m2) */
    double bus[10];
    /* sum p p'/m of its modes (kg, kg.m, kg.m2) */
    double bus_less[36];
} EquationsParameters;

/* z: what moves, and what moves it; dz: its change along a direction. */
typedef struct EquationsMotion {
    /* origin of P, in B (m) */
    double translation[3];
    /* P to B (1) */
    double rotation[9];
    /* of the legs' lengths (m/s) */
    double rate[6];
    /* angular velocity of B, in B (rad/s) */
    double turn[3];
    /* sum p_t x of the payload's modes, in P (kg.m) */
    double payload_shift[3];
    /* sum p x' (N.s, N.m.s) */
    double payload_flow[6];
    /* sum I' x, xx xy xz yy yz zz (kg.m2) */
    double payload_change[6];
    /* sum I' x' (kg.m2/s) */
    double payload_change_rate[6];
    /* sum p_t x of the bus's modes, in B (kg.m) */
    double bus_shift[3];
    /* sum p x' (N.s, N.m.s) */
    double bus_flow[6];
    /* what acts along the legs' lengths (N) */
    double leg_force[6];
    /* on B at its origin, modes' springs and dampers included (N, N.m) */
    double base_wrench[6];
    /* on P at its origin, in P, modes' springs and dampers included (N, N.m) */
    double payload_wrench[6];
    /* accelerations that are prescribed: of legs and base (m/s2, rad/s2) */
    double given[12];
} EquationsMotion;

/* place: what the outputs that are not linear depend on. */
typedef struct EquationsPlace {
    /* origin of P, in B (m) */
    double translation[3];
    /* P to B (1) */
    double rotation[9];
    /* the same by the coarse legs alone (m) */
    double nominal_translation[3];
    /* the same by the coarse legs alone (1) */
    double nominal_rotation[9];
    /* quaternion of B, scalar first (1) */
    double attitude[4];
    /* of the origin of B since the start, in B (m) */
    double base_position[3];
    /* integral of the angular velocity of B, in B (rad) */
    double base_rotation[3];
} EquationsPlace;

/* Lengths of the legs, J_lp of eq (6), and its inverse by blocks, which divides by the divisor. From p (194), z
   (81): lengths (6), J_lp (36), J_pl (36), divisor (1). */
void equations_legs(const double *p, const double *z, double *restrict lengths, double *restrict J_lp, double
    *restrict J_pl, double *restrict divisor);

/* All accelerations, and what their derivatives take. From p (194), z (81), J_pl (36), mask (12): accelerations
   (12), body (6), spin (6), reaction (6), kept (18), lower (66), divisors (12), base_rows (72). */
void equations_accelerations(const double *p, const double *z, const double *J_pl, const double *mask, double
    *restrict accelerations, double *restrict body, double *restrict spin, double *restrict reaction, double
    *restrict kept, double *restrict lower, double *restrict divisors, double *restrict base_rows);

/* Derivative of the residual along a direction dz, accelerations held. From p (194), z (81), J_pl (36), kept (18),
   accelerations (12), dz (81): residual (12), body (6), spin (6). */
void equations_change(const double *p, const double *z, const double *J_pl, const double *kept, const double
    *accelerations, const double *dz, double *restrict residual, double *restrict body, double *restrict spin);

/* Mass of legs' lengths and base, with all modes held; and of legs and payload as one body on the base. From p
   (194), z (81), J_pl (36): M (144), locked (36). */
void equations_masses(const double *p, const double *z, const double *J_pl, double *restrict M, double *restrict
    locked);

/* Linear and angular momentum of all bodies about the origin of B, mass and first moment. From p (194), z (81),
   J_pl (36), velocity (3): momentum (6), mass (4). */
void equations_momentum(const double *p, const double *z, const double *J_pl, const double *velocity, double
    *restrict momentum, double *restrict mass);

/* Outputs that are not linear in the state. From place (34): y (16). */
void equations_outputs(const double *place, double *restrict y);

/* Their derivative along a direction. From place (34), change (34): dy (16). */
void equations_outputs_change(const double *place, const double *change, double *restrict dy);

#endif
