#include "plant.h"

#include "../kernel/kernel.h"
#include "model.h"
#include "motion.h"

#include <math.h>
#include <string.h>

/* Longest step at rest that may leave it, s: in a longer one the motion would be linear for too long. */
static const double BRIEF = 1e-3;

/* So many times as far as rest reaches, no step at rest leads. */
static const double SUDDEN = 10.0;

/* A servo is at rest when it is this close to its command (m) and this slow (m/s); fine legs, when they are near rest now
   and this much later (s); the base does not turn below this rate (rad/s). */
static const double AT_REST = 1e-12, SOON = 0.01, HARDLY_TURNING = 1e-4;

/* Outputs, with the reaction on the base. */
enum { N_OUTPUTS = MECHANISM_OUTPUTS + 6 };

/* Of Memory: `moving`. */
enum { RESTS, MOVES, BEGINS /* with the next step */ };

/* The state where the coarse legs have come to rest, and the fine legs will be: whether it is so, and the centre there. */
static bool has_come_to_rest(const Plant *p, const Memory *w, const double *x, const double *command, double step, Centre *c)
{
    const int64_t n = count_coordinates(p), s = 2 * n;
    if (!(largest(x + s + 3, NULL, 3) < AT_REST) || !(largest(x + s, command, 3) < AT_REST) ||
        !(largest(x + s + 6, command, 3) < AT_REST) || largest(x + n + TURN, NULL, 3) > HARDLY_TURNING)
        return false;
    double soon[3];
    for (int k = 0; k < 3; k++)
        soon[k] = x[FINE + k] + SOON * x[n + FINE + k];
    const double near = 0.5 * p->distance, here = largest(x + FINE, NULL, 3), there = largest(soon, NULL, 3);
    if (!(largest(soon, x + FINE, 3) < near))
        return false;
    memset(c, 0, sizeof *c);
    memcpy(c->coarse, command, sizeof c->coarse);
    for (int k = 0; k < 3; k++) {
        c->fine[k] = (here > there ? here : there) < near ? 0.0 : 0.5 * (x[FINE + k] + soon[k]);
        c->velocity[k] = p->prescribed ? 0.0 : x[n + SHIFT + k];
        c->position[k] = p->prescribed ? 0.0 : x[SHIFT + k];
        c->rotation[k] = x[TURN + k];
    }
    memcpy(c->attitude, w->place.attitude, sizeof c->attitude);
    c->step = step;
    c->rest = 1.0;
    return true;
}

/* Whether the motion has left what a map at rest is for, by so many times what is allowed.  Servos that rest away from it
   have another place. */
static bool has_left(const Plant *p, const Centre *c, const double *x, const double *last, double times)
{
    const int64_t n = count_coordinates(p), s = 2 * n;
    const double apart = largest(x + s, c->coarse, 3);
    return !(apart <= times * p->distance) || !(largest(x + FINE, c->fine, 3) <= times * p->distance) ||
           !(largest(x + TURN, c->rotation, 3) <= times * p->angle) ||
           !(largest(x + s + 3, NULL, 3) <= times * p->speed) ||
           (apart > AT_REST && memcmp(x + s, last, 3 * sizeof *last) == 0);
}

/* From rest to motion: the exact place, and the true momentum, which outer forces have changed in the meantime. */
static bool begin_motion(Plant *p, Memory *w, const double *x)
{
    const int64_t n = count_coordinates(p);
    const Model *model = find_model(p, &w->present);
    if (model == NULL)
        return false;
    const Centre *c = &model->centre;
    double turn[3], now[6], impulse[3], turned[3], before[3], moment[3];
    w->place = model->place;
    for (int k = 0; k < 3; k++)
        turn[k] = x[TURN + k] - c->rotation[k];
    turn_attitude(w->place.attitude, turn);
    if (!find_place(p, x + 2 * n, x + 9 + p->mechanism->n_bus, x + FINE, &w->place))
        return false;
    w->moving = MOVES;
    w->parts = w->step_before = w->countdown = 0.0;
    memset(w->lead, 0, sizeof w->lead);
    if (p->prescribed)
        return true;
    if (!evaluate(p, &w->place, x, w->input) || !find_linear_momentum(p, model, x, now))
        return false;
    for (int k = 0; k < 6; k++)
        now[k] -= w->at_rest[k];
    rotate(c->attitude, now, false, impulse);
    rotate(c->attitude, now + 3, false, turned);
    cross(w->centre, w->momentum, before);
    for (int k = 0; k < 3; k++)
        w->momentum[k] += impulse[k];
    take_momentum(p, w, x, false);
    cross(w->centre, w->momentum, moment);
    for (int k = 0; k < 3; k++)
        w->angular[k] += turned[k] + (moment[k] - before[k]);
    return true;
}

/* From motion to rest. */
static bool begin_rest(Plant *p, const Model *model, Memory *w, double *x)
{
    const int64_t s = 2 * count_coordinates(p);
    for (int k = 0; k < 3; k++) {
        x[s + k] = x[s + 6 + k] = model->centre.coarse[k];
        x[s + 3 + k] = 0.0;
    }
    w->moving = RESTS;
    w->parts = 0.0;
    w->present = model->centre;
    find_locked(p, &p->point, w->locked);
    return p->prescribed || find_linear_momentum(p, model, x, w->at_rest);
}

/* A step at rest: x and y are written if it is done.  It is not done where it is long and leaves rest. */
enum { REST_REFUSED, REST_DONE, REST_LEFT };

static int rest(Plant *p, Memory *kept, const Model *model, const double *input, double *x, double *y)
{
    const int64_t n_x = count_states(p);
    double *given = p->operand + n_x;
    if (model->centre.rest == 0.0) /* a state that was made up: there is no map */
        return REST_LEFT;
    memcpy(p->operand, x, sizeof *x * (size_t)n_x);
    memcpy(given, input, sizeof *given * MECHANISM_INPUTS);
    given[MECHANISM_INPUTS] = 1.0;
    if (!kernel_map(&model->to_rest))
        return REST_REFUSED;
    memcpy(p->operand, p->result, sizeof *x * (size_t)n_x);
    const bool left = has_left(p, &model->centre, p->operand, x + n_x - 9, 1.0);
    if (left && (model->centre.step > BRIEF || has_left(p, &model->centre, p->operand, x + n_x - 9, SUDDEN)))
        return REST_LEFT;
    if (!kernel_map(&model->to_outputs))
        return REST_REFUSED;
    memcpy(x, p->operand, sizeof *x * (size_t)n_x);
    memcpy(y, p->result, sizeof *y * MECHANISM_OUTPUTS);
    memcpy(kept->input, input, sizeof kept->input);
    kept->present.step = model->centre.step;
    kept->moving = left ? BEGINS : RESTS;
    return REST_DONE;
}

/* A step in motion, likewise. */
static bool move(Plant *p, Memory *w, double step, double *input, const double *command, double *x, double *y)
{
    Centre settled;
    if (w->present.step != step) { /* maps are for steps of one size */
        w->present.step = step;
        w->parts = 0.0;
    }
    if (!move_through(p, w, step, input, command, x, true))
        return false;
    memcpy(y, p->point.outputs, sizeof p->point.outputs);
    if (!has_come_to_rest(p, w, x, command, step, &settled)) {
        if (w->next.rest != 0.0)
            w->parts = 0.0;
        return true;
    }
    if (w->parts > 0.0 && w->next.rest != 0.0) {
        Model *model = p->models + (memcmp(&p->models[0].centre, &w->next, sizeof w->next) == 0 ? 0 : 1);
        if (memcmp(w->next.coarse, command, sizeof w->next.coarse) != 0)
            w->parts = 0.0;
        else if (model_make(p, model, &w->next, count_wanted(w->parts)) == MODEL_READY) {
            if (!has_left(p, &w->next, x, w->last, 1.0))
                return begin_rest(p, model, w, x);
            w->parts = 0.0;
        }
    }
    if (w->parts == 0.0 || w->next.rest == 0.0) {
        w->next = settled;
        w->parts = 0.0;
        return work_ahead(p, find_model(p, &w->present), w);
    }
    return true;
}

static const char *const MOTIONS[] = {
    "prescribed_acceleration", "prescribed_angular_acceleration", "prescribed_angular_velocity", "base_force", "base_torque",
};

/* Which of these are set, and have no effect: bits. */
static int find_unused(const Plant *p, const double *u)
{
    int unused = 0;
    for (int k = 0; k < (p->prescribed ? 2 : 3); k++)
        if (largest(u + (p->prescribed ? MECHANISM_BASE_WRENCH : BASE_MOTION) + 3 * k, NULL, 3) != 0.0)
            unused |= 1 << k;
    return unused;
}

/* Warn of a command beyond the stroke, and of inputs without effect: each time that it is another one. */
static void warn(const Plant *p, Core *core, Memory *kept, const double *u)
{
    double excess[3];
    int worst = 0;
    for (int k = 0; k < 3; k++) {
        excess[k] = u[COMMAND + k] - clip(u[COMMAND + k], p->low, p->high);
        worst = fabs(excess[k]) > fabs(excess[worst]) ? k : worst;
    }
    const int unused = find_unused(p, u);
    if (largest(excess, NULL, 3) != 0.0 && largest(kept->excess, NULL, 3) == 0.0)
        write_message(core, MESSAGE_WARNING, "coarse_command_%d: %.6g m is outside the stroke [%.6g, %.6g] m; held at its end",
                      worst + 1, u[COMMAND + worst], p->low, p->high);
    memcpy(kept->excess, excess, sizeof excess);
    if (unused != 0 && (double)unused != kept->unused) {
        char names[160] = "";
        for (int k = 0; k < 3; k++)
            if (unused & 1 << k) {
                strcat(names, names[0] == '\0' ? "" : ", ");
                strcat(names, MOTIONS[p->prescribed ? 3 + k : k]);
            }
        write_message(core, MESSAGE_WARNING, "base = %s: no effect of %s", p->prescribed ? "prescribed" : "own", names);
    }
    kept->unused = unused;
}

/* The step after one at rest, as far as it is expected: the state then. */
static bool rest_on(Plant *p, const Model *model, const double *x, double *next)
{
    const int64_t n_x = count_states(p);
    memcpy(p->operand, x, sizeof *x * (size_t)n_x); /* behind it are the inputs */
    if (!kernel_map(&model->to_rest))
        return false;
    memcpy(next, p->result, sizeof *x * (size_t)n_x);
    return true;
}

/* A step in motion on a base that the host moves, and the reaction: the next step is expected with the same inputs. */
static bool move_carried(Plant *p, Memory *w, double step, double *input, const double *command, const double *turn,
                         Carried *start, double *x, double *y)
{
    double next[MECHANISM_STATES], locked[10];
    Carried now, after;
    if (!move(p, w, step, input, command, x, y))
        return false;
    Memory expected = *w;
    memcpy(next, x, sizeof *x * (size_t)count_states(p));
    find_locked(p, &p->point, w->locked);
    find_carried(p, &w->place, x, w->locked, turn, &now);
    if (!move_through(p, &expected, step, input, command, next, false))
        return false;
    find_locked(p, &p->point, locked);
    find_carried(p, &expected.place, next, locked, turn, &after);
    react(w, start, &now, &after, input, &w->place, turn, step, y + MECHANISM_OUTPUTS);
    return true;
}

/* A step from w and x to w, x and y; false: refused. */
static bool take_step(Plant *p, Memory *w, double step, double *input, const double *command, const double *turn, double *x,
                      double *y)
{
    double next[MECHANISM_STATES];
    Carried start, now, after;
    if (p->prescribed) {
        memcpy(x + count_coordinates(p) + TURN, turn, 3 * sizeof *x);
        if (w->moving == MOVES)
            find_carried(p, &w->place, x, w->locked, turn, &start);
        else {
            Centre centre = w->present;
            centre.step = step;
            const Model *model = find_model(p, &centre);
            if (model == NULL)
                return false;
            find_carried(p, &model->place, x, w->locked, turn, &start);
            const int done = w->moving == RESTS ? rest(p, w, model, input, x, y) : REST_LEFT;
            if (done == REST_DONE) {
                find_carried(p, &model->place, x, w->locked, turn, &now);
                if (!rest_on(p, model, x, next))
                    return false;
                find_carried(p, &model->place, next, w->locked, turn, &after);
                react(w, &start, &now, &after, input, &model->place, turn, step, y + MECHANISM_OUTPUTS);
            }
            if (done != REST_LEFT)
                return done == REST_DONE;
        }
    }
    if (w->moving != MOVES) {
        w->present.step = step;
        if (!begin_motion(p, w, x))
            return false;
    }
    return p->prescribed ? move_carried(p, w, step, input, command, turn, &start, x, y)
                         : move(p, w, step, input, command, x, y);
}

int64_t plant_step(void *arguments, Core *core)
{
    Plant *p = arguments;
    double *x = core->data + p->state, *y = core->data + p->output;
    const double *u = core->data + p->input;
    Memory *kept = (Memory *)(core->data + p->memory);
    double input[MECHANISM_INPUTS] = {0.0}, command[3];
    memcpy(input, u, sizeof *u * N_LOADS);
    if (p->prescribed) {
        memset(input + MECHANISM_BASE_WRENCH, 0, 6 * sizeof *input);
        memcpy(input + MECHANISM_BASE_MOTION, u + BASE_MOTION, 6 * sizeof *input);
    }
    for (int k = 0; k < 3; k++)
        command[k] = clip(u[COMMAND + k], p->low, p->high);
    find_reference_rates(p, command, x + count_states(p) - 3, core->step, input);
    int done = REST_LEFT;
    if (kept->moving == RESTS && !p->prescribed) {
        Centre centre = kept->present;
        centre.step = core->step;
        const Model *model = find_model(p, &centre);
        done = model == NULL ? REST_REFUSED : rest(p, kept, model, input, x, y);
    }
    if (done == REST_LEFT) {
        const Memory before = *kept; /* written back when the step is refused */
        double start[MECHANISM_STATES], outputs[N_OUTPUTS];
        memcpy(start, x, sizeof *x * (size_t)count_states(p));
        done = take_step(p, kept, core->step, input, command, u + BASE_TURN, x, outputs);
        if (done)
            memcpy(y, outputs, sizeof *y * (size_t)(p->prescribed ? N_OUTPUTS : MECHANISM_OUTPUTS));
        else {
            *kept = before;
            memcpy(x, start, sizeof *x * (size_t)count_states(p));
        }
    }
    if (!done) {
        if (count_parts(core->step, INNER_STEP) == MOST_PARTS)
            write_message(core, MESSAGE_REFUSAL, "a step of %g s in motion, or so long that few digits would be right: "
                          "expected less than %g s", core->step, INNER_STEP * MOST_PARTS);
        else
            write_message(core, MESSAGE_REFUSAL, "the step leads to a singular pose of the legs, or to numbers that are not "
                          "finite");
        return CALL_REFUSED;
    }
    memcpy(kept->last, x + count_states(p) - 9, sizeof kept->last);
    memcpy(y + MECHANISM_OUTPUTS + 6, kept->locked, sizeof kept->locked);
    warn(p, core, kept, u);
    return CALL_DONE;
}

int64_t plant_begin(void *arguments, Core *core)
{
    Plant *p = arguments;
    const double *u = core->data + p->input;
    double *x = core->data + p->state, *y = core->data + p->output, attitude[4], momentum[6], mass[4], moment[3];
    Memory *kept = (Memory *)(core->data + p->memory);
    const int64_t n = count_coordinates(p);
    memcpy(attitude, kept->place.attitude, sizeof attitude);
    memset(kept, 0, sizeof *kept);
    kept->place = p->nominal;
    memcpy(kept->place.attitude, attitude, sizeof attitude);
    memcpy(kept->input, u, sizeof *u * N_LOADS);
    p->evaluated = 0;
    if (p->prescribed) {
        memset(kept->input + MECHANISM_BASE_WRENCH, 0, 6 * sizeof *u);
        memcpy(kept->input + MECHANISM_BASE_MOTION, u + BASE_MOTION, 6 * sizeof *u);
    }
    if (!find_place(p, x + 2 * n, NULL, x + FINE, &kept->place) || !evaluate(p, &kept->place, x, kept->input))
        return CALL_REFUSED;
    kept->moving = largest(x + n + TURN, NULL, 3) > 0.0 ? MOVES : RESTS;
    if (kept->moving == MOVES && !p->prescribed) { /* all turns as one body, about its centre of mass */
        mechanism_find_momentum(p->mechanism, &p->point, x, momentum, mass);
        for (int k = 0; k < 3; k++)
            x[n + SHIFT + k] -= momentum[k] / mass[0];
        if (!evaluate(p, &kept->place, x, kept->input))
            return CALL_REFUSED;
    }
    memcpy(y, p->point.outputs, sizeof p->point.outputs);
    find_locked(p, &p->point, kept->locked);
    memcpy(y + MECHANISM_OUTPUTS + 6, kept->locked, sizeof kept->locked);
    Centre *c = &kept->present;
    memcpy(c->coarse, x + 2 * n, sizeof c->coarse);
    memcpy(c->velocity, x + n + SHIFT, sizeof c->velocity);
    memcpy(c->attitude, attitude, sizeof attitude);
    memcpy(kept->last, c->coarse, sizeof kept->last);
    memcpy(kept->start, c->coarse, sizeof kept->start);
    c->rest = 1.0;
    c->step = core->step;
    kept->unused = find_unused(p, u);
    if (p->prescribed)
        return CALL_DONE;
    take_momentum(p, kept, x, true);
    mechanism_find_momentum(p->mechanism, &p->point, x, kept->at_rest, mass);
    for (int k = 0; k < 3; k++)
        momentum[k] = mass[1 + k] / mass[0];
    cross(momentum, kept->at_rest, moment);
    for (int k = 0; k < 3; k++)
        kept->at_rest[3 + k] -= moment[k];
    return CALL_DONE;
}
