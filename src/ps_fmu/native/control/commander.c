/* The pointing commander as a step: what becomes of a target, and the commands at the end of the step; commander.py. */
#include <math.h>
#include <stdio.h>

#include "../kernel/kernel.h"
#include "profile.h"
#include "vectors.h"

/* Targets closer than this are one: hosts that interpolate their inputs vary them by rounding at every step. */
static const double TARGET_RESOLUTION = 1e-12; /* rad */

/* Poses of a path: all of them are tried, or those of each interval alone whose ends leave a doubt.  Between two of
   them a leg can go beyond both by 4e-8 m (200 random paths through the workspace). */
enum { INTERVALS = 16, PARTS = 16 };

/* Constants, and places in the buffer of the FMU. */
typedef struct {
    Geometry geometry;
    Method method;
    Limits limits;
    double resolution;  /* of the coarse commands, m; 0: none */
    int64_t follow;     /* the command follows the target at once, without a profile */
    int64_t target, memory, outputs;
} Commander;

/* What the FMU state keeps of the motion. */
typedef struct {
    Profile profile;
    double reachable;  /* 0: the target is refused */
    double waiting;    /* the target is tried again when the present motion has ended */
    Vector last_target;
    double settled;    /* the outputs are those of rest at the end of the profile */
} Memory;

/* In the order of the FMU's outputs. */
typedef struct {
    Vector coarse, orientation, rate, position;
    double residual, margin, time_to_go, reachable, moving;
} Outputs;

static int is_same(const double *a, const double *b)
{
    return fabs(a[0] - b[0]) <= TARGET_RESOLUTION && fabs(a[1] - b[1]) <= TARGET_RESOLUTION &&
           fabs(a[2] - b[2]) <= TARGET_RESOLUTION;
}

/* The nearest multiple of a resolution, of two the even one. */
static double quantise(double value, double resolution)
{
    static const double ROUND = 6755399441055744.0; /* 1.5 * 2^52 */
    const double parts = value / resolution;
    return (fabs(parts) < 2251799813685248.0 ? (parts + ROUND) - ROUND : parts) * resolution;
}

static int try_pose(const Commander *c, const double *orientation, Pose *pose)
{
    find_pose(&c->geometry, &c->method, orientation, pose);
    return is_reachable(&c->geometry, pose);
}

/* Why an orientation is out of reach; false: it is not. */
static int refuse(const Commander *c, const double *orientation, char *why, size_t size)
{
    Pose pose;
    if (try_pose(c, orientation, &pose))
        return 0;
    explain(&c->geometry, &c->method, orientation, &pose, why, size);
    return 1;
}

/* Orientation of a pose of the path, which is tried. */
static int try_on_path(const Commander *c, const Profile *p, int number, double *orientation, Pose *pose)
{
    const double end = profile_end(p), part = number / (double)(INTERVALS * PARTS);
    Motions motions;
    profile_follow(p, number == INTERVALS * PARTS ? end : p->start_time + (end - p->start_time) * part, 0, motions);
    for (int k = 0; k < 3; k++)
        orientation[k] = motions[0][k];
    return try_pose(c, orientation, pose);
}

/* Whether a leg is nearer to an end of its stroke at the ends of an interval than it bends near it: twice the second
   difference; an arc goes beyond its chord by an eighth of it. */
static int is_doubtful(const Commander *c, double (*leg)[3], int last, int interval)
{
    for (int i = 0; i < 3; i++) {
        double bend = 0.0;
        for (int k = interval - 1; k <= interval; k++) {
            if (k < 0 || k + 2 > last)
                continue;
            const double second = fabs(leg[k][i] - 2.0 * leg[k + 1][i] + leg[k + 2][i]);
            bend = second > bend ? second : bend;
        }
        const double one = find_margin(&c->geometry, leg[interval][i]), other = find_margin(&c->geometry, leg[interval + 1][i]);
        if (!((one < other ? one : other) > 2.0 * bend))
            return 1;
    }
    return 0;
}

/* Why the first pose of a path that is out of reach is so; false: there is none. */
static int refuse_path(const Commander *c, const Profile *p, char *why, size_t size)
{
    double leg[INTERVALS + 1][3];
    Vector orientation;
    Pose pose;
    int last = 0, refused = 0;
    for (; last <= INTERVALS && !refused; last++) {
        refused = !try_on_path(c, p, last * PARTS, orientation, &pose);
        for (int i = 0; i < 3; i++)
            leg[last][i] = pose.displacement[i];
    }
    last--; /* the last one that was tried */
    for (int interval = 0; interval < last; interval++) {
        if (!(interval == last - 1 && refused) && !is_doubtful(c, leg, last, interval))
            continue;
        for (int k = 1; k < PARTS; k++)
            if (!try_on_path(c, p, interval * PARTS + k, orientation, &pose)) {
                explain(&c->geometry, &c->method, orientation, &pose, why, size);
                return 1;
            }
    }
    if (refused && try_on_path(c, p, last * PARTS, orientation, &pose) == 0)
        explain(&c->geometry, &c->method, orientation, &pose, why, size);
    return refused;
}

/* A new target at `time`: the motion goes on to it, or as it is; why the target is refused, if it is. */
static void redirect(const Commander *c, Memory *m, double time, const double *target, char *why, size_t size)
{
    m->waiting = 0.0;
    m->reachable = !refuse(c, target, why, size);
    if (m->reachable == 0.0 || is_same(target, m->profile.target))
        return;
    if (c->follow) {
        profile_hold(&m->profile, time, target);
        return;
    }
    Motions now;
    Profile next;
    profile_follow(&m->profile, time, 3, now);
    profile_plan(&next, time, now, target, &c->limits);
    const int n = snprintf(why, size, "on the way, ");
    if (refuse_path(c, &next, why + n, size - (size_t)n)) {
        m->reachable = 0.0;
        m->waiting = profile_remaining(&m->profile, time) > 0.0;
    } else
        m->profile = next;
}

/* The outputs at a time.  A path may touch an end of the stroke: what rounding and the sampled check let pass is cut
   off. */
static void command(const Commander *c, const Memory *m, double time, Outputs *y)
{
    const Geometry *g = &c->geometry;
    Motions motions;
    Pose pose;
    profile_follow(&m->profile, time, 1, motions);
    find_pose(g, &c->method, motions[0], &pose);
    y->residual = 0.0;
    y->margin = INFINITY;
    for (int k = 0; k < 3; k++) {
        const double d = pose.displacement[k], cut = d < g->low ? g->low : d > g->high ? g->high : d;
        const double left = fabs(pose.displacement[3 + k]), margin = find_margin(g, cut);
        y->coarse[k] = c->resolution > 0.0 ? quantise(cut, c->resolution) : cut;
        y->orientation[k] = motions[0][k];
        y->rate[k] = motions[1][k];
        y->position[k] = pose.t_B[k];
        y->residual = left > y->residual ? left : y->residual;
        y->margin = margin < y->margin ? margin : y->margin;
    }
    y->time_to_go = profile_remaining(&m->profile, time);
    y->reachable = m->reachable;
    y->moving = y->time_to_go > 0.0;
}

static void keep(Memory *m, const double *target)
{
    for (int k = 0; k < 3; k++)
        m->last_target[k] = target[k];
    m->settled = 0.0;
}

/* Rest at the target; at the nominal pose if it is out of reach.  For the mode of initialisation. */
EXPORT void control_begin(const Commander *c, Core *core)
{
    static const Vector nominal = {0.0, 0.0, 0.0};
    char why[400];
    const double *target = core->data + c->target;
    Memory *m = (Memory *)(core->data + c->memory);
    m->reachable = !refuse(c, target, why, sizeof why);
    m->waiting = 0.0;
    profile_hold(&m->profile, 0.0, m->reachable != 0.0 ? target : nominal);
    keep(m, target);
    command(c, m, 0.0, (Outputs *)(core->data + c->outputs));
    if (m->reachable == 0.0)
        write_message(core, MESSAGE_WARNING, "initial target (%.6g, %.6g, %.6g) deg refused: %s; at the nominal pose",
                      DEGREES * target[0], DEGREES * target[1], DEGREES * target[2], why);
}

/* A step.  A target that differs from the last one is looked at, and one that waits for the end of a motion. */
EXPORT int64_t control_command(void *arguments, Core *core)
{
    const Commander *c = arguments;
    const double *target = core->data + c->target;
    Memory *m = (Memory *)(core->data + c->memory);
    const double start = core->origin + (double)core->count * core->step;
    if (!is_same(target, m->last_target) || (m->waiting != 0.0 && !(profile_remaining(&m->profile, start) > 0.0))) {
        char why[400];
        const int was_reachable = m->reachable != 0.0;
        redirect(c, m, start, target, why, sizeof why);
        keep(m, target);
        /* A host that leads the target out of reach step by step gets one warning. */
        if (m->reachable == 0.0 && (was_reachable || !c->follow))
            write_message(core, MESSAGE_WARNING, "target (%.6g, %.6g, %.6g) deg refused at t = %.6g s: %s; %s",
                          DEGREES * target[0], DEGREES * target[1], DEGREES * target[2], start, why,
                          m->waiting != 0.0 ? "tried again when the present motion has ended" : "the last one stays");
    }
    if (m->settled == 0.0) {
        const double end = core->origin + (double)(core->count + 1) * core->step;
        command(c, m, end, (Outputs *)(core->data + c->outputs));
        m->settled = !(profile_remaining(&m->profile, end) > 0.0);
    }
    return CALL_DONE;
}
