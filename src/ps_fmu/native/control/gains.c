/* Gains (52) to (54) and the notch of the pointing controller in closed form.

   By blocks, J_lp = [N_c A_c; N_f A_f].  With the coarse legs held, a rotation theta of the platform moves its origin by
   -G theta, G = N_c^-1 A_c, and the fine legs elongate by S theta, S = A_f - N_f G = J_theta_f^-1 (13).  A turn theta_b
   of the base turns the platform with it if all legs are held (39), so that the elongations -S theta_b undo it.  Of the
   base's motion (v, theta_b), the translation v + (G - [t x]) theta_b of the origin of P is then left. */
#include <math.h>

#include "../kernel/kernel.h"
#include "mechanism.h"
#include "vectors.h"

int find_motion(const Pose *pose, Motion *motion)
{
    Matrix N_c, inverse, G;
    for (int i = 0; i < 6; i++)
        cross(pose->arms_B[i], pose->n_B[i], motion->moment[i]);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            N_c[i][k] = pose->n_B[i][k];
    if (!(fabs(invert(N_c, inverse)) > 0.0))
        return 0;
    multiply(inverse, motion->moment, G);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const double *n = pose->n_B[3 + i];
            motion->elongation[i][k] = motion->moment[3 + i][k] - (n[0] * G[0][k] + n[1] * G[1][k] + n[2] * G[2][k]);
        }
    if (!(fabs(invert(motion->elongation, motion->theta)) > 0.0))
        return 0;
    multiply(G, motion->theta, motion->t);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            motion->t[i][k] = -motion->t[i][k];
            motion->left[i][k] = G[i][k];
        }
    const double *t = pose->t_B;
    motion->left[0][1] += t[2], motion->left[0][2] -= t[1];
    motion->left[1][0] -= t[2], motion->left[1][2] += t[0];
    motion->left[2][0] += t[1], motion->left[2][1] -= t[0];
    return 1;
}

/* Forces on the platform by some accelerations, and their moments about the origin of P: (3, N) each. */
#define FORCES(N)                                                                                                      \
    struct {                                                                                                           \
        double force[3][N], moment[3][N];                                                                              \
    }

/* Add forces F, (3, n), at `arm` from the origin of P. */
static inline void add_forces(const double *arm, const double *F, int n, double *force, double *moment)
{
    for (int j = 0; j < n; j++) {
        const double x = F[j], y = F[n + j], z = F[2 * n + j];
        force[j] += x;
        force[n + j] += y;
        force[2 * n + j] += z;
        moment[j] += arm[1] * z - arm[2] * y;
        moment[n + j] += arm[2] * x - arm[0] * z;
        moment[2 * n + j] += arm[0] * y - arm[1] * x;
    }
}

/* J_pf' of forces and moments: what the fine legs feel of them. */
static inline void project(const Motion *motion, const double *force, const double *moment, int n, double *result)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < n; j++)
            result[i * n + j] = motion->t[0][i] * force[j] + motion->t[1][i] * force[n + j] +
                                motion->t[2][i] * force[2 * n + j] + motion->theta[0][i] * moment[j] +
                                motion->theta[1][i] * moment[n + j] + motion->theta[2][i] * moment[2 * n + j];
}

/* Masses that a leg has at its platform joint, (A17), (A23): `own` and `other`, at right angles to the leg, by the
   acceleration of the platform joint and of the base joint; `whole`, in all directions, by that of the platform joint. */
typedef struct {
    double own, other, whole;
} Ends;

static inline Ends find_ends(const Leg *leg, double length)
{
    const double turning = leg->second / (length * length), own = turning - 2.0 * leg->upper_first / length;
    return (Ends){own, (leg->upper_first + leg->lower_first) / length - turning, own + leg->upper_mass};
}

/* The accelerations are those of the base: E and `left` at each platform joint, [E, -[r x]] at the base joint r. */
void find_acceleration_gain(const Mechanism *m, const Pose *pose, const Motion *motion, double gain[3][6])
{
    FORCES(6) sum = {{{0.0}}, {{0.0}}};
    double F[3][6];
    const double(*U)[3] = (const double(*)[3])motion->left;
    for (int i = 0; i < 6; i++) {
        const Ends e = find_ends(&m->legs[i], pose->length[i]);
        const double *n = pose->n_B[i], *r = m->geometry.base_B[i], both = e.own + e.other, all = e.whole + e.other;
        Vector turned;
        cross(r, n, turned); /* n' of a turn of the base at its joint */
        for (int j = 0; j < 3; j++) {
            const double along = both * n[j];
            const double along_turn = e.own * (n[0] * U[0][j] + n[1] * U[1][j] + n[2] * U[2][j]) + e.other * turned[j];
            for (int k = 0; k < 3; k++) {
                F[k][j] = -(n[k] * along);
                F[k][3 + j] = e.whole * U[k][j] - n[k] * along_turn;
            }
            F[j][j] += all;
        }
        F[0][4] += e.other * r[2], F[0][5] -= e.other * r[1];
        F[1][3] -= e.other * r[2], F[1][5] += e.other * r[0];
        F[2][3] += e.other * r[1], F[2][4] -= e.other * r[0];
        add_forces(pose->arms_B[i], &F[0][0], 6, &sum.force[0][0], &sum.moment[0][0]);
    }
    Vector com_B;
    for (int k = 0; k < 3; k++)
        com_B[k] = dot(pose->R[k], m->com_P);
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++) {
            F[k][j] = k == j ? m->mass : 0.0;
            F[k][3 + j] = m->mass * U[k][j];
        }
    add_forces(com_B, &F[0][0], 6, &sum.force[0][0], &sum.moment[0][0]);
    project(motion, &sum.force[0][0], &sum.moment[0][0], 6, &gain[0][0]);
}

/* Acceleration of the point at `arm` from the origin of P, by elongations of the fine legs. */
static void move_point(const Motion *motion, const double *arm, Matrix Q)
{
    for (int j = 0; j < 3; j++) {
        const Vector theta = {motion->theta[0][j], motion->theta[1][j], motion->theta[2][j]};
        Vector v;
        cross(theta, arm, v);
        for (int k = 0; k < 3; k++)
            Q[k][j] = motion->t[k][j] + v[k];
    }
}

void find_mass(const Mechanism *m, const Pose *pose, const Motion *motion, Matrix mass)
{
    FORCES(3) sum = {{{0.0}}, {{0.0}}};
    Matrix Q, F, turning;
    for (int i = 0; i < 6; i++) {
        const Ends e = find_ends(&m->legs[i], pose->length[i]);
        const double *n = pose->n_B[i];
        move_point(motion, pose->arms_B[i], Q);
        for (int j = 0; j < 3; j++) {
            const double along = e.own * (n[0] * Q[0][j] + n[1] * Q[1][j] + n[2] * Q[2][j]);
            for (int k = 0; k < 3; k++)
                F[k][j] = e.whole * Q[k][j] - n[k] * along;
        }
        add_forces(pose->arms_B[i], &F[0][0], 3, &sum.force[0][0], &sum.moment[0][0]);
    }
    Vector com_B;
    for (int k = 0; k < 3; k++)
        com_B[k] = dot(pose->R[k], m->com_P);
    move_point(motion, com_B, Q);
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++) {
            F[k][j] = m->mass * Q[k][j];
            turning[k][j] = pose->R[0][k] * motion->theta[0][j] + pose->R[1][k] * motion->theta[1][j] +
                            pose->R[2][k] * motion->theta[2][j]; /* in P */
        }
    add_forces(com_B, &F[0][0], 3, &sum.force[0][0], &sum.moment[0][0]);
    multiply((double(*)[3])m->inertia_P, turning, F);
    multiply((double(*)[3])pose->R, F, Q);
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            sum.moment[k][j] += Q[k][j];
    project(motion, &sum.force[0][0], &sum.moment[0][0], 3, &mass[0][0]);
}

int find_kept_motion(Mechanism *m, Core *core, int64_t orientation, int64_t kept, Pose *pose, Motion *motion)
{
    static const double SAME_ORIENTATION = 1e-12; /* rad; a plant at rest varies it by rounding */
    static const Method TRILATERATION = {0.0, 0.0, 0};
    const double *now = core->data + orientation;
    double *of = core->data + kept, gap = 0.0;
    int same = 1;
    for (int k = 0; k < 3; k++)
        same = same && fabs(now[k] - of[k]) <= SAME_ORIENTATION;
    if (!same)
        for (int k = 0; k < 3; k++)
            of[k] = now[k];
    if (of[0] == m->key[0] && of[1] == m->key[1] && of[2] == m->key[2])
        return KEPT;
    find_pose(&m->geometry, &TRILATERATION, of, pose);
    if (pose->status == POSE_FOUND && find_motion(pose, motion)) {
        for (int k = 0; k < 3; k++)
            m->key[k] = of[k];
        return RENEWED;
    }
    for (int k = 0; k < 3; k++)
        gap = pose->gap[k] > gap ? pose->gap[k] : gap;
    write_message(core, MESSAGE_REFUSAL, "orientation (%.4g, %.4g, %.4g) deg: no pose with the fine legs at rest; they miss "
                  "each other by %.3g m", DEGREES * of[0], DEGREES * of[1], DEGREES * of[2], gap);
    return UNREACHABLE;
}
