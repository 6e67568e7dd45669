/* Motion profiles: smooth paths of roll, pitch and yaw from any state of motion to rest at a target.

   From rest, a profile is the polynomial of degree 7 in time whose rate, acceleration and jerk vanish at both ends.  A
   profile that replaces another one midway is the sum of two such polynomials that begin together: a *brake* takes up
   position, rate, acceleration and jerk of the start and comes to rest at its natural stop, and a *transfer* from rest to
   rest covers the distance from that stop to the target.  Position, rate, acceleration and jerk are continuous, and a new
   target does not carry the motion further astray than the brake needs (one polynomial for both would: its rate limit
   asks for a long duration, and that lets the initial rate act for long).

   With tau = (t - t_0)/T, each part is, relative to its end, x(tau) = (1 - tau)^4 (b_0 + b_1 tau + b_2 tau^2 + b_3 tau^3),
   where b is the product of the start's Taylor polynomial and (1 - tau)^-4 = 1 + 4 tau + 10 tau^2 + 20 tau^3 + ..., cut
   after tau^3.  The factor makes the end exact, without cancellation.

   The fourth derivative jumps at the ends, by 840 D/T^4 for a transfer over D.  This is what shakes a lightly damped mode
   of circular frequency omega well above 1/T: it is left with an angle of at most 1680 D/(omega T)^4. */
#ifndef PS_FMU_PROFILE_H
#define PS_FMU_PROFILE_H

#include "mechanism.h"

/* Position, rate, acceleration and jerk: rad, rad/s, rad/s2, rad/s3. */
typedef Vector Motions[4];

/* Motion from `start` at start_time (s) to rest at `target`.  N_PROFILE doubles, as the state of the FMU keeps them. */
typedef struct {
    double start_time;
    double brake;    /* duration, s; 0 where the start is at rest */
    double transfer; /* duration, s; 0 where there is none */
    Motions start;
    Vector target;
} Profile;

enum { N_PROFILE = 18 };

/* What a profile may demand of the Euclidean norm of each derivative over roll, pitch and yaw, and its shortest duration:
   rad/s, rad/s2, rad/s3, s. */
typedef struct {
    double rate, acceleration, jerk, min_duration;
} Limits;

/* Rest at a position from a time on. */
void profile_hold(Profile *p, double time, const double *position);

static inline double profile_end(const Profile *p)
{
    return p->start_time + (p->brake > p->transfer ? p->brake : p->transfer);
}

/* Time until rest, s; 0 throughout for a profile without duration. */
static inline double profile_remaining(const Profile *p, double time)
{
    const double end = profile_end(p);
    return (p->brake > 0.0 || p->transfer > 0.0) && end > time ? end - time : 0.0;
}

/* Position and its derivatives up to an order, at most 3.  The end is exact. */
EXPORT void profile_follow(const Profile *p, double time, int order, Motions motions);

/* The shortest profile from `start` to rest at `target` within the limits, from `time` (s) on.

   From rest the duration follows in closed form.  Else it is the shortest brake within the limits, then the shortest
   transfer with which the sum exceeds them by at most 10 %; durations are tried in steps of 3 %, 100 and 60 of them at
   most.  A limit that the start itself exceeds is raised to what the start has. */
EXPORT void profile_plan(Profile *p, double time, Motions start, const double *target, const Limits *limits);

#endif
