/* The mechanism as controllers and commander take it: poses with the fine legs at rest, and gains there.

   Lengths in m, angles in rad, vectors in the frame of their suffix: B base, P platform.  Rows of six are coarse legs
   1..3, then fine legs 1..3.  Equations are those of the paper.  Nothing here allocates, and nothing is kept from one
   call to the next. */
#ifndef PS_FMU_MECHANISM_H
#define PS_FMU_MECHANISM_H

#include <stddef.h>
#include <stdint.h>

#include "../kernel/core.h"

typedef double Vector[3];
typedef double Matrix[3][3];

/* Joints, nominal pose and stroke; poses.py makes it. */
typedef struct {
    Vector base_B[6], platform_P[6], nominal_B; /* nominal_B: translation at zero roll, pitch and yaw */
    double length[6];                           /* nominal */
    double low, high;                           /* stroke of a coarse leg */
    double side;     /* of the plane of the sphere centres that the nominal pose lies on, 1 or -1 */
    double radius;   /* root-mean-square distance of the platform joints from the origin of P */
    double largest_condition;
} Geometry;

/* How the translation is found: `most` = 0, by trilateration; else by Algorithm 1 with step size mu, until the error is
   below epsilon (m), in at most `most` iterations. */
typedef struct {
    double mu, epsilon;
    int64_t most;
} Method;

/* What a search for a pose comes to, and what forbids a pose that was found. */
enum {
    POSE_FOUND,
    POSE_FAR,       /* an angle beyond LARGEST_ANGLE, or no number */
    POSE_COLLINEAR, /* the centres of the spheres lie on a line */
    POSE_APART,     /* the spheres have no common point */
    POSE_DIVERGES,  /* the step size is beyond `bound` */
    POSE_UNFINISHED /* the iterations end with an error of `left` */
};

#define LARGEST_ANGLE 1e6         /* rad */
#define DEGREES 57.29577951308232 /* deg/rad */

typedef struct {
    double status, iterations;
    Vector t_B;
    Matrix R;               /* P to B */
    Vector arms_B[6];       /* platform joints from the origin of P */
    Vector n_B[6];          /* directions of the legs, from base joint to platform joint */
    double length[6];
    double displacement[6]; /* of all legs, from nominal */
    Vector gap;             /* what each fine leg lacks where the spheres are apart */
    double bound, left;
} Pose;

/* The pose of an orientation: roll, pitch, yaw. */
void find_pose(const Geometry *g, const Method *method, const double *orientation, Pose *pose);

/* What a coarse leg lacks to the nearer end of its stroke; negative beyond it. */
static inline double find_margin(const Geometry *g, double displacement)
{
    const double below = displacement - g->low, above = g->high - displacement;
    return below < above ? below : above;
}

/* Whether a pose was found, within the stroke and away from singularity. */
int is_reachable(const Geometry *g, const Pose *pose);

/* Why a pose is not reachable, in words. */
void explain(const Geometry *g, const Method *method, const double *orientation, const Pose *pose, char *text,
             size_t size);

/* Two slender parts on one line: mass of the upper part (kg), first moments from their own joints (kg.m), second moment
   of both (kg.m2). */
typedef struct {
    double upper_mass, upper_first, lower_first, second;
} Leg;

/* What the gains take. */
typedef struct {
    Geometry geometry;
    Leg legs[6];
    Vector stiffness, damping; /* of the fine legs, N/m, N.s/m */
    double mass;               /* of the payload, kg */
    Vector com_P;
    Matrix inertia_P;          /* about the centre of mass, kg.m2 */
    Vector key;                /* orientation of the gains that are kept beside it */
} Mechanism;

/* How the platform moves with the fine legs, the coarse ones held. */
typedef struct {
    Matrix elongation;    /* J_theta_f^-1 of (13), m/rad: from rotation of the platform, in B */
    Matrix theta, t;      /* J_pf of (9): rotation and translation of the platform, in B, by elongations */
    Matrix left;          /* translation of the origin of P, in B, that a turn of the base leaves where the elongations
                             undo the turn of the platform */
    Vector moment[6];     /* of the directions of the legs, about the origin of P */
} Motion;

/* False: the legs are singular at this pose. */
int find_motion(const Pose *pose, Motion *motion);

/* (52), from the acceleration of B at its origin, translation and rotation, to fine forces. */
void find_acceleration_gain(const Mechanism *m, const Pose *pose, const Motion *motion, double gain[3][6]);

/* J_pf' (M_p + M_alpha) J_pf of (28), kg. */
void find_mass(const Mechanism *m, const Pose *pose, const Motion *motion, Matrix mass);

/* Whether the gains are still those of the orientation that `kept` holds, which follows the input: places in the buffer. */
enum { KEPT, RENEWED, UNREACHABLE };

/* RENEWED: pose and motion are those of a new orientation, and gains have to be computed.  UNREACHABLE: there is no pose,
   and a message tells why the step is refused. */
int find_kept_motion(Mechanism *m, Core *core, int64_t orientation, int64_t kept, Pose *pose, Motion *motion);

#endif
