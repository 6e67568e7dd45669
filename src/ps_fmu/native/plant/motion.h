/* Inner steps in motion, with the linear models that they are about. */
#ifndef PS_FMU_MOTION_H
#define PS_FMU_MOTION_H

#include "../kernel/kernel.h"
#include "momentum.h"

/* Farthest from a linear model that the legs go before another one is made, m. */
static const double FAR = 2e-3;

/* The references of the servos go to a new command over the step, if it is no longer than this, s: commands that a
   host samples give no jerks.  In longer steps they are there sooner, so that the motion is that of short steps. */
static const double LONGEST_RAMP = 2e-2, SHORT_RAMP = 1e-2;

/* Inner steps between two looks at the momentum. */
enum { BALANCE_EVERY = 4 };

/* Rates and outputs at a state; the same bits whether they were found before or not. */
static bool evaluate(Plant *p, const Place *place, const double *x, const double *input)
{
    const size_t size = sizeof *x * (size_t)count_states(p);
    if (p->evaluated && memcmp(p->x, x, size) == 0 && memcmp(&p->place, place, sizeof *place) == 0 &&
        memcmp(p->u, input, sizeof p->u) == 0)
        return true;
    p->evaluated = mechanism_evaluate(p->mechanism, place, x, input, &p->point);
    p->place = *place;
    memcpy(p->x, x, size);
    memcpy(p->u, input, sizeof p->u);
    return p->evaluated;
}

/* The model about a centre, made if it is not there; NULL: it cannot be made. */
static Model *find_model(Plant *p, const Centre *centre)
{
    for (int k = 0; k < 2; k++) {
        Model *model = p->models + k;
        if (memcmp(&model->centre, centre, sizeof *centre) == 0 && model->stage == MODEL_MADE) {
            p->latest = k;
            return model;
        }
    }
    p->latest = 1 - p->latest;
    Model *model = p->models + p->latest;
    p->models[1 - p->latest].centre.step *= p->models[1 - p->latest].stage == MODEL_MADE; /* they share their room */
    return model_make(p, model, centre, INT64_MAX) == MODEL_READY ? model : NULL;
}

/* Parts of the next model that are to be made; all, where a state was made up. */
static int64_t count_wanted(double parts)
{
    return parts >= 0.0 && parts < 1e9 ? (int64_t)parts : INT64_MAX;
}

/* A part of the next model, in the place that the present one leaves. */
static bool work_ahead(Plant *p, const Model *present, Memory *w)
{
    Model *model = present == p->models ? p->models + 1 : p->models;
    w->parts += 1.0;
    const int64_t found = model_make(p, model, &w->next, count_wanted(w->parts));
    if (found == MODEL_FAILED)
        return false;
    if (found == MODEL_READY) {
        w->parts = (double)model->parts;
        if (w->next.rest == 0.0) {
            w->present = w->next;
            w->parts = 0.0;
            find_locked(p, &p->point, w->locked);
        }
    }
    return true;
}

static void begin_next(Plant *p, Memory *w, const double *x, double step)
{
    Centre *c = &w->next;
    memset(c, 0, sizeof *c);
    memcpy(c->coarse, x + 2 * count_coordinates(p), sizeof c->coarse);
    memcpy(c->fine, x + FINE, sizeof c->fine);
    c->attitude[0] = 1.0;
    c->step = step;
    w->parts = 0.0;
}

static bool is_far(const Plant *p, const Centre *c, const double *x)
{
    return largest(x + 2 * count_coordinates(p), c->coarse, 3) > FAR || largest(x + FINE, c->fine, 3) > FAR;
}

/* One inner step in motion; what it changes is in w and x. */
static bool move_on(Plant *p, Memory *w, double *x, double h, const double *input)
{
    const int64_t n = count_coordinates(p), n_x = count_states(p);
    const size_t size = sizeof *x * (size_t)n_x;
    const Model *model = find_model(p, &w->present);
    if (model == NULL || !evaluate(p, &w->place, x, w->input))
        return false;
    const double *rates = p->point.rates;
    double *f = p->operand, *change = p->operand + n_x, by_loads[MECHANISM_STATES], changed[MECHANISM_INPUTS];
    /* The change of what the linear model does not explain, the same loads at both ends. */
    memset(change, 0, size);
    if (w->step_before > 0.0) {
        for (int64_t i = 0; i < n_x; i++)
            f[i] = x[i] - w->before[i];
        if (!kernel_product(model->change, pad(3 + n), f, n_x, p->result))
            return false;
        const double scale = h / w->step_before;
        for (int64_t i = 0; i < 3 + n; i++) {
            const int64_t row = i < 3 ? SHIFT + i : n + i - 3;
            change[row] = scale * (p->result[i] + (rates[row] - w->rates_before[row]));
        }
    }
    memcpy(f, rates, size);
    if (p->prescribed)
        memset(change + n + SHIFT, 0, 6 * sizeof *change);
    for (int k = 0; k < 3; k++) /* a change of these accelerates nothing */
        f[n_x - 3 + k] = input[MECHANISM_REFERENCE_RATE + k];
    if (memcmp(input, w->input, MECHANISM_REFERENCE_RATE * sizeof *input) != 0 ||
        memcmp(input + MECHANISM_BASE_MOTION, w->input + MECHANISM_BASE_MOTION, 6 * sizeof *input) != 0) {
        for (int k = 0; k < MECHANISM_INPUTS; k++)
            changed[k] = input[k] - w->input[k];
        mechanism_accelerate(p->mechanism, &p->point, changed, by_loads);
        for (int64_t i = 0; i < n_x - 3; i++)
            f[i] += by_loads[i];
    }
    memcpy(w->rates_before, f, size);
    memcpy(w->before, x, size);
    w->step_before = h;
    if (p->prescribed) /* its rate is the mean over the step */
        memset(f + n + SHIFT, 0, 6 * sizeof *f);
    for (int k = 0; k < 3; k++) {
        f[SHIFT + k] += w->lead[k] / h;
        f[n + SHIFT + k] += w->lead[3 + k] / h;
        f[n + TURN + k] += w->lead[6 + k] / h;
    }
    memset(w->lead, 0, sizeof w->lead);
    if (!kernel_product(model->motion, pad(n_x), p->operand, 2 * n_x, p->result))
        return false;
    for (int64_t i = 0; i < n_x; i++)
        x[i] += p->result[i];
    /* The attitude by the mean rate, and what it changes by the order of turns. */
    double turn[3], half[3], middle[4], position[3];
    cross(w->before + n + TURN, x + n + TURN, turn);
    for (int k = 0; k < 3; k++) {
        const double turned = x[TURN + k] - w->before[TURN + k];
        half[k] = 0.5 * turned;
        turn[k] = turned + h * h / 12.0 * turn[k];
        position[k] = 0.5 * (w->before[SHIFT + k] + x[SHIFT + k]);
    }
    memcpy(middle, w->place.attitude, sizeof middle);
    turn_attitude(middle, half);
    if (!follow_legs(p, w->before, x, &w->place))
        return false;
    memcpy(w->input, input, sizeof w->input);
    if (!p->prescribed)
        carry(w, input, middle, position, model->mass, h);
    turn_attitude(w->place.attitude, turn);
    if (!evaluate(p, &w->place, x, w->input))
        return false;
    w->countdown -= 1.0;
    if (!p->prescribed && w->countdown <= 0.0) {
        find_lead(p, model, w, x);
        w->countdown = BALANCE_EVERY;
    }
    return true;
}

/* A part of the next model, where one is being made, or has to be. */
static bool look_ahead(Plant *p, Memory *w, const double *x)
{
    if (w->parts == 0.0 && !is_far(p, &w->present, x))
        return true;
    if (w->parts == 0.0)
        begin_next(p, w, x, w->present.step);
    return work_ahead(p, find_model(p, &w->present), w);
}

/* The references go to the command over a time, limited in rate. */
static void find_reference_rates(const Plant *p, const double *command, const double *reference, double time, double *input)
{
    for (int k = 0; k < 3; k++)
        input[MECHANISM_REFERENCE_RATE + k] = clip((command[k] - reference[k]) / time, -p->rate_limit, p->rate_limit);
}

/* All inner steps of a step; `ahead`: with the work on the next model. */
static bool move_through(Plant *p, Memory *w, double step, double *input, const double *command, double *x, bool ahead)
{
    const int64_t parts = count_parts(step, INNER_STEP), ramps = step <= LONGEST_RAMP ? 1 : count_parts(step, SHORT_RAMP), r = count_states(p) - 3;
    if (parts == MOST_PARTS)
        return false;
    for (int64_t k = 0; k < parts; k++) {
        if (k % (parts / ramps) == 0)
            find_reference_rates(p, command, x + r, step / (double)ramps, input);
        if (!move_on(p, w, x, step / (double)parts, input) || (ahead && !look_ahead(p, w, x)))
            return false;
    }
    return true;
}

#endif
