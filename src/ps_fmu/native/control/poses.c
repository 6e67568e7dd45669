/* Inverse kinematics with the fine legs at rest, section 2.3; inverse_kinematics.py explains it. */
#include "mechanism.h"

#include <math.h>
#include <stdio.h>

#include "../numerics/angles.h"
#include "vectors.h"

static const double STROKE_TOLERANCE = 1e-12; /* m; a pose on the end of the stroke counts as within */

/* (14), P to B. */
static void rotate(const double *orientation, Matrix R)
{
    double c[3], s[3];
    for (int k = 0; k < 3; k++)
        find_cosine_sine(orientation[k], &c[k], &s[k]);
    const double cr = c[0], cp = c[1], cy = c[2], sr = s[0], sp = s[1], sy = s[2];
    R[0][0] = cp * cy, R[0][1] = cy * sr * sp - cr * sy, R[0][2] = cr * cy * sp + sr * sy;
    R[1][0] = cp * sy, R[1][1] = cr * cy + sr * sp * sy, R[1][2] = cr * sp * sy - cy * sr;
    R[2][0] = -sp, R[2][1] = cp * sr, R[2][2] = cr * cp;
}

/* Centres of the spheres that the origin of P lies on. */
static void find_centres(const Geometry *g, const Pose *pose, Vector *centre)
{
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            centre[i][k] = g->base_B[3 + i][k] - pose->arms_B[3 + i][k];
}

/* The common point of three spheres on the nominal side: from the radical centre in the plane of their centres, up or
   down by the height that is left. */
static int trilaterate(const Geometry *g, Vector *c, Pose *pose)
{
    Vector u, v, w, vw, wu, flat;
    for (int k = 0; k < 3; k++) {
        u[k] = c[1][k] - c[0][k];
        v[k] = c[2][k] - c[0][k];
    }
    cross(u, v, w);
    cross(v, w, vw);
    cross(w, u, wu);
    const double r1 = g->length[3], r2 = g->length[4], r3 = g->length[5];
    const double uu = dot(u, u), vv = dot(v, v), ww = dot(w, w), longest = uu > vv ? uu : vv;
    if (!(ww > 1e-24 * longest * longest)) /* the height of the triangle is below rounding of its longest side */
        return POSE_COLLINEAR;
    const double a = 0.5 * (uu + (r1 - r2) * (r1 + r2)), b = 0.5 * (vv + (r1 - r3) * (r1 + r3));
    for (int k = 0; k < 3; k++)
        flat[k] = (a * vw[k] + b * wu[k]) / ww;
    const double square = r1 * r1 - dot(flat, flat);
    if (!(square >= 0.0)) {
        for (int i = 0; i < 3; i++) {
            Vector from;
            for (int k = 0; k < 3; k++)
                from[k] = flat[k] - (i == 0 ? 0.0 : i == 1 ? u[k] : v[k]);
            pose->gap[i] = sqrt(dot(from, from)) - g->length[3 + i];
        }
        return POSE_APART;
    }
    const double up = g->side * sqrt(square / ww);
    for (int k = 0; k < 3; k++)
        pose->t_B[k] = c[0][k] + (flat[k] + up * w[k]);
    return POSE_FOUND;
}

/* 2 / lambda_max(N N') of three directions: Newton from above on the characteristic polynomial, whose roots are real. */
static double find_bound(Vector *n)
{
    const double a = dot(n[0], n[1]), b = dot(n[1], n[2]), c = dot(n[2], n[0]);
    const double p = a * a + b * b + c * c, q = 2.0 * a * b * c; /* (x - 1)^3 - p (x - 1) - q, of the Gram matrix */
    double x = 2.0;
    for (int k = 0; k < 60; k++) {
        const double slope = 3.0 * x * x - p, step = slope > 0.0 ? (x * x * x - p * x - q) / slope : 0.0;
        if (!(step > 1e-16 * x))
            break;
        x -= step;
    }
    return 2.0 / (1.0 + x);
}

/* Algorithm 1: t <- t + mu J e, with the directions J and the length errors e of the fine legs. */
static int descend(const Geometry *g, const Method *method, Vector *centre, Pose *pose)
{
    Vector n[3], t = {g->nominal_B[0], g->nominal_B[1], g->nominal_B[2]};
    const double limit = method->epsilon;
    for (int64_t k = 1; k <= method->most; k++) {
        double e[3], square = 0.0;
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++)
                n[i][j] = t[j] - centre[i][j];
            const double length = sqrt(dot(n[i], n[i]));
            for (int j = 0; j < 3; j++)
                n[i][j] /= length;
            e[i] = g->length[3 + i] - length;
            square += e[i] * e[i];
        }
        if (k == 1) {
            pose->bound = find_bound(n);
            if (!(method->mu > 0.0 && method->mu < pose->bound))
                return POSE_DIVERGES;
        }
        for (int j = 0; j < 3; j++)
            t[j] += method->mu * (e[0] * n[0][j] + e[1] * n[1][j] + e[2] * n[2][j]);
        pose->left = sqrt(square);
        pose->iterations = (double)k;
        if (pose->left < limit) { /* the paper tests the error before the update, and returns the point after it */
            for (int j = 0; j < 3; j++)
                pose->t_B[j] = t[j];
            return POSE_FOUND;
        }
    }
    return POSE_UNFINISHED;
}

void find_pose(const Geometry *g, const Method *method, const double *orientation, Pose *pose)
{
    Vector centre[3];
    pose->iterations = pose->bound = pose->left = 0.0;
    for (int k = 0; k < 3; k++)
        pose->t_B[k] = NAN, pose->gap[k] = 0.0;
    pose->status = POSE_FAR;
    for (int k = 0; k < 6; k++)
        pose->displacement[k] = NAN;
    for (int k = 0; k < 3; k++)
        if (!(fabs(orientation[k]) <= LARGEST_ANGLE))
            return;
    rotate(orientation, pose->R);
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 3; k++)
            pose->arms_B[i][k] = dot(pose->R[k], g->platform_P[i]);
    find_centres(g, pose, centre);
    pose->status = method->most > 0 ? descend(g, method, centre, pose) : trilaterate(g, centre, pose);
    if (pose->status != POSE_FOUND)
        return;
    for (int i = 0; i < 6; i++) {
        double *n = pose->n_B[i];
        for (int k = 0; k < 3; k++)
            n[k] = pose->t_B[k] + pose->arms_B[i][k] - g->base_B[i][k];
        pose->length[i] = sqrt(dot(n, n));
        pose->displacement[i] = pose->length[i] - g->length[i];
        const double inverse = 1.0 / pose->length[i];
        for (int k = 0; k < 3; k++)
            n[k] *= inverse;
    }
}

/* J_lp of (6), with rotations as arcs at the platform joints: rows [n, arm x n / radius]. */
static void find_rows(const Geometry *g, const Pose *pose, double (*J)[6])
{
    const double inverse = 1.0 / g->radius;
    for (int i = 0; i < 6; i++) {
        Vector moment;
        cross(pose->arms_B[i], pose->n_B[i], moment);
        for (int k = 0; k < 3; k++) {
            J[i][k] = pose->n_B[i][k];
            J[i][3 + k] = moment[k] * inverse;
        }
    }
}

/* The condition number of a matrix of six rows, by rotations of pairs of columns (one-sided Jacobi). */
static double find_condition(double (*J)[6])
{
    double low = INFINITY, high = 0.0;
    for (int sweep = 0; sweep < 12; sweep++)
        for (int p = 0; p < 5; p++)
            for (int q = p + 1; q < 6; q++) {
                double pp = 0.0, qq = 0.0, pq = 0.0;
                for (int i = 0; i < 6; i++) {
                    pp += J[i][p] * J[i][p];
                    qq += J[i][q] * J[i][q];
                    pq += J[i][p] * J[i][q];
                }
                if (!(pq * pq > 1e-30 * (pp * qq)))
                    continue;
                const double z = (qq - pp) / (2.0 * pq), s = z < 0.0 ? -1.0 : 1.0;
                const double t = s / (fabs(z) + sqrt(1.0 + z * z)), c = 1.0 / sqrt(1.0 + t * t);
                for (int i = 0; i < 6; i++) {
                    const double a = J[i][p], b = J[i][q];
                    J[i][p] = c * (a - t * b);
                    J[i][q] = c * (t * a + b);
                }
            }
    for (int q = 0; q < 6; q++) {
        double square = 0.0;
        for (int i = 0; i < 6; i++)
            square += J[i][q] * J[i][q];
        low = square < low ? square : low;
        high = square > high ? square : high;
    }
    return low > 0.0 ? sqrt(high / low) : high <= 0.0 ? NAN : INFINITY;
}

/* Above the condition number by a factor of some 10 to 100, in 40 ns: the norm over a lower bound of the smallest
   singular value, |det| ((n - 1) / norm^2)^((n - 1) / 2) (Y. Yu and D. Gu, Linear Algebra Appl. 252, 1997). */
static double bound_condition(double (*J)[6])
{
    Matrix N, inverse, S;
    double square = 0.0;
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++)
            square += J[i][k] * J[i][k];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            N[i][k] = J[3 + i][k];
    double determinant = invert(N, inverse);
    for (int i = 0; i < 3; i++) /* A_c - N_c N_f^-1 A_f */
        for (int k = 0; k < 3; k++)
            S[i][k] = inverse[i][0] * J[3][3 + k] + inverse[i][1] * J[4][3 + k] + inverse[i][2] * J[5][3 + k];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            N[i][k] = J[i][3 + k] - (J[i][0] * S[0][k] + J[i][1] * S[1][k] + J[i][2] * S[2][k]);
    determinant *= invert(N, inverse);
    const double part = 0.2 * square;
    return sqrt(square * part) * part * part / fabs(determinant);
}

static double find_condition_at(const Geometry *g, const Pose *pose)
{
    double J[6][6];
    find_rows(g, pose, J);
    return find_condition(J);
}

static int is_within(const Geometry *g, const Pose *pose)
{
    for (int i = 0; i < 3; i++)
        if (!(find_margin(g, pose->displacement[i]) >= -STROKE_TOLERANCE))
            return 0;
    return 1;
}

int is_reachable(const Geometry *g, const Pose *pose)
{
    double J[6][6];
    if (pose->status != POSE_FOUND || !is_within(g, pose))
        return 0;
    find_rows(g, pose, J);
    return bound_condition(J) <= g->largest_condition || find_condition(J) <= g->largest_condition;
}

/* Which number of three is the largest. */
static int find_largest(const double *x)
{
    int largest = 0;
    for (int i = 1; i < 3; i++)
        largest = x[i] > x[largest] ? i : largest;
    return largest;
}

/* The coarse leg that is nearest to an end of its stroke, or the farthest beyond it. */
static int find_shortest_margin(const Geometry *g, const Pose *pose)
{
    Vector lacking;
    for (int i = 0; i < 3; i++)
        lacking[i] = -find_margin(g, pose->displacement[i]);
    return find_largest(lacking);
}

void explain(const Geometry *g, const Method *method, const double *orientation, const Pose *pose, char *text,
             size_t size)
{
    int n = 0;
    if (pose->status == POSE_FAR)
        n = snprintf(text, size, "an angle is beyond %g rad", LARGEST_ANGLE);
    else if (pose->status == POSE_COLLINEAR)
        n = snprintf(text, size, "the centres of the three spheres of the fine legs lie on a line");
    else if (pose->status == POSE_APART) {
        const int leg = find_largest(pose->gap);
        n = snprintf(text, size, "the three spheres of the fine legs have no common point: fine leg %d is %.4g mm too short",
                     leg + 1, 1e3 * pose->gap[leg]);
    } else if (pose->status == POSE_DIVERGES) {
        snprintf(text, size, "Algorithm 1 diverges with mu = %g: expected 0 < mu < 2/lambda_max(J J^T) = %.4f at the first "
                 "guess", method->mu, pose->bound);
        return;
    } else if (pose->status == POSE_UNFINISHED) {
        snprintf(text, size, "Algorithm 1 stopped after %d iterations with a length error of %.3e m, expected less than "
                 "%.1e m; the fine legs may be unable to reach the orientation, or allow more iterations",
                 (int)method->most, pose->left, method->epsilon);
        return;
    } else if (!is_within(g, pose)) {
        const int leg = find_shortest_margin(g, pose);
        const double d = pose->displacement[leg];
        n = snprintf(text, size, "coarse leg %d would need %+.4f mm, %.4g mm beyond its stroke of %+g to %+g mm,", leg + 1,
                     1e3 * d, -1e3 * find_margin(g, d), 1e3 * g->low, 1e3 * g->high);
    } else
        n = snprintf(text, size, "the six legs are singular (condition number %.2e)", find_condition_at(g, pose));
    if (n > 0 && (size_t)n < size)
        snprintf(text + n, size - (size_t)n, " at roll %.4f, pitch %.4f, yaw %.4f deg", DEGREES * orientation[0],
                 DEGREES * orientation[1], DEGREES * orientation[2]);
}

EXPORT void control_find_poses(const Geometry *g, const Method *method, const double *orientation, int64_t n, Pose *poses)
{
    for (int64_t i = 0; i < n; i++)
        find_pose(g, method, orientation + 3 * i, poses + i);
}

/* Whether each is reachable. */
EXPORT void control_check_poses(const Geometry *g, const Pose *poses, int64_t n, uint8_t *reachable)
{
    for (int64_t i = 0; i < n; i++)
        reachable[i] = (uint8_t)is_reachable(g, poses + i);
}

EXPORT void control_explain(const Geometry *g, const Method *method, const double *orientation, const Pose *pose,
                            char *text, int64_t size)
{
    explain(g, method, orientation, pose, text, (size_t)size);
}
