/* Linear models of the plant about a centre, and their maps, made in parts. */
#include "model.h"

#include "../kernel/kernel.h"

#include <math.h>
#include <string.h>

enum { COLUMNS_A_PART = 2, BUDGET = 12000 /* multiplications */ };

const double INNER_STEP = 2.5e-4;

/* What is made, in this order. */
enum { BEGIN, COLUMNS, MOTION, REST, REST_BLOCKS, OUTPUT_BLOCKS, READY = MODEL_MADE };

int64_t pad(int64_t n)
{
    return (n + 7) / 8 * 8;
}

int64_t count_coordinates(const Plant *p)
{
    return 12 + p->mechanism->n_bus + p->mechanism->n_payload;
}

int64_t count_states(const Plant *p)
{
    return 2 * count_coordinates(p) + 9;
}

int64_t count_parts(double step, double longest)
{
    int64_t n = 1;
    while (n < MOST_PARTS && step > (1.0 + 1e-9) * longest * (double)n)
        n *= 2;
    return n;
}

/* The state at a centre. */
static void find_state(const Plant *p, const Centre *c, double *x)
{
    const int64_t n = count_coordinates(p);
    memset(x, 0, sizeof *x * (size_t)count_states(p));
    for (int k = 0; k < 3; k++) {
        x[k] = c->fine[k];
        x[3 + k] = c->position[k];
        x[6 + k] = c->rotation[k];
        x[n + 3 + k] = c->velocity[k];
        x[2 * n + k] = x[2 * n + 6 + k] = c->coarse[k];
    }
}

bool find_place(const Plant *p, const double coarse[3], const double stretch[3], const double fine[3], Place *place)
{
    double lengths[6], nominal[6];
    const double *l = p->mechanism->nominal_lengths;
    for (int k = 0; k < 3; k++) {
        nominal[k] = l[k] + coarse[k];
        lengths[k] = nominal[k] + (stretch == NULL ? 0.0 : p->mechanism->mask[k] * stretch[k]);
        nominal[3 + k] = l[3 + k];
        lengths[3 + k] = l[3 + k] + fine[k];
    }
    return mechanism_find_place(p->mechanism, nominal, place->nominal_translation, place->nominal_rotation) &&
           mechanism_find_place(p->mechanism, lengths, place->translation, place->rotation);
}

/* The forces that hold the fine legs at a centre.  Without them, derivatives by places would have springs that turn with
   the legs, and actuators that do not: a force on the whole that is not there. */
static double find_holding_force(const Plant *p, const Centre *c, int leg)
{
    return p->mechanism->leg_stiffness[3 + leg] * c->fine[leg];
}

bool evaluate_centre(Plant *p, const Model *model, const double *speeds, Point *point)
{
    double x[MECHANISM_STATES], u[MECHANISM_INPUTS] = {0.0};
    find_state(p, &model->centre, x);
    for (int k = 0; k < 3; k++)
        u[MECHANISM_FINE_FORCE + k] = find_holding_force(p, &model->centre, k);
    if (speeds != NULL) {
        const int64_t n = count_coordinates(p);
        memcpy(x + n, speeds, sizeof *x * (size_t)n);
        memcpy(x + 2 * n + 3, speeds + n + 3, 3 * sizeof *x);
    }
    return mechanism_evaluate(p->mechanism, &model->place, x, u, point);
}

/* 1 / a symmetric matrix. */
static void invert3(const double a[9], double b[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            b[3 * j + i] = a[3 * i1 + j1] * a[3 * i2 + j2] - a[3 * i1 + j2] * a[3 * i2 + j1];
        }
    const double determinant = a[0] * b[0] + a[1] * b[3] + a[2] * b[6];
    for (int k = 0; k < 9; k++)
        b[k] /= determinant;
}

/* Mass and inertia of all as one body: its momentum while it turns. */
static void find_inertia(Plant *p, Model *model)
{
    double x[MECHANISM_STATES] = {0.0}, inertia[9], momentum[6], mass[4], square = 0.0;
    Point *point = &p->centre;
    const EquationsMotion kept = point->motion;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            point->motion.turn[i] = i == k;
        mechanism_find_momentum(p->mechanism, point, x, momentum, mass);
        for (int i = 0; i < 3; i++)
            inertia[3 * i + k] = momentum[3 + i];
    }
    point->motion = kept;
    model->mass = mass[0];
    for (int k = 0; k < 3; k++)
        square += mass[1 + k] * mass[1 + k] / mass[0];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            inertia[3 * i + k] -= (i == k ? square : 0.0) - mass[1 + i] * mass[1 + k] / mass[0];
    invert3(inertia, model->inverse_inertia);
}

static int64_t begin(Plant *p, Model *model)
{
    const Centre *c = &model->centre;
    model->place = p->nominal; /* always from there: the same bits whatever came before */
    memcpy(model->place.attitude, c->attitude, sizeof model->place.attitude);
    if (!find_place(p, c->coarse, NULL, c->fine, &model->place) || !evaluate_centre(p, model, NULL, &p->centre))
        return MODEL_FAILED;
    find_inertia(p, model);
    model->column = 0;
    return MODEL_ON;
}

/* Columns of A and B, and of C and D where they are needed. */
static void make_columns(Plant *p, Model *model)
{
    const int64_t n = count_states(p), stride = pad(n), all = n + (model->centre.rest != 0.0 ? MECHANISM_INPUTS : 0);
    double dx[MECHANISM_STATES], du[MECHANISM_INPUTS], rates[MECHANISM_STATES], y[MECHANISM_OUTPUTS], reaction[6];
    for (int k = 0; k < COLUMNS_A_PART && model->column < all; k++, model->column++) {
        const int64_t j = model->column;
        memset(dx, 0, sizeof dx);
        memset(du, 0, sizeof du);
        *(j < n ? dx + j : du + (j - n)) = 1.0;
        mechanism_differentiate(p->mechanism, &p->centre, dx, du, rates, y, reaction);
        if (p->prescribed) { /* the base has neither place nor velocity of its own, and its rate is given */
            memset(rates + 3, 0, 3 * sizeof *rates);
            memset(rates + count_coordinates(p) + 3, 0, 6 * sizeof *rates);
        }
        memcpy(model->A + stride * j, rates, sizeof *rates * (size_t)n);
        if (model->centre.rest != 0.0)
            memcpy(model->outputs + pad(MECHANISM_OUTPUTS) * j, y, sizeof y);
    }
    if (model->column < all)
        return;
    const int64_t coordinates = count_coordinates(p), rows = 3 + coordinates;
    for (int64_t j = 0; j < n; j++) /* place and accelerations of the base, and all other accelerations, by minus the state */
        for (int64_t i = 0; i < rows; i++)
            model->change[pad(rows) * j + i] = -model->A[stride * j + (i < 3 ? 3 + i : coordinates + i - 3)];
    if (model->centre.rest != 0.0) { /* by the constant 1: what is not by the distance from the centre */
        double x[MECHANISM_STATES + MECHANISM_INPUTS] = {0.0}, *by_one = model->A + stride * all,
               *of_one = model->outputs + pad(MECHANISM_OUTPUTS) * all;
        find_state(p, &model->centre, x);
        for (int k = 0; k < 3; k++)
            x[n + MECHANISM_FINE_FORCE + k] = find_holding_force(p, &model->centre, k);
        memcpy(by_one, p->centre.rates, sizeof *by_one * (size_t)n);
        memcpy(of_one, p->centre.outputs, sizeof p->centre.outputs);
        for (int64_t j = 0; j < all; j++)
            if (x[j] != 0.0) {
                for (int64_t i = 0; i < n; i++)
                    by_one[i] -= model->A[stride * j + i] * x[j];
                for (int64_t i = 0; i < MECHANISM_OUTPUTS; i++)
                    of_one[i] -= model->outputs[pad(MECHANISM_OUTPUTS) * j + i] * x[j];
            }
    }
    model->stage = MOTION;
    model->column = -1;
}

/* A part of a discretisation. */
static int64_t work_on(Plant *p, Model *model, double step, const double *B, int64_t m, double *exponential, double *held,
                       double *ramp, int64_t next)
{
    Discretisation *d = &p->work;
    if (model->column < 0) {
        d->n = count_states(p);
        d->stride = pad(d->n);
        d->m = m, d->step = step, d->A = model->A, d->B = B;
        d->exponential = exponential, d->held = held, d->ramp = ramp;
        discretise_begin(d);
        model->column = 0;
    }
    const int64_t found = discretise(d, BUDGET);
    if (found == DISCRETISE_FAILED)
        return MODEL_FAILED;
    if (found == DISCRETISE_DONE) {
        model->stage = next;
        model->column = -1;
    }
    return MODEL_ON;
}

static void make_map(Plant *p, const double *matrix, int64_t columns, int64_t rows, const BlockRoom *room, Map *map)
{
    make_blocks(matrix, columns, pad(rows), room, map);
    map->source = p->operand;
    map->target = map->work = p->result;
    map->n_target = rows;
}

static int64_t model_work(Plant *p, Model *model)
{
    const int64_t n = count_states(p), stride = pad(n);
    const bool rest = model->centre.rest != 0.0;
    int64_t found = MODEL_ON;
    model->parts++;
    switch (model->stage) {
    case BEGIN:
        found = begin(p, model);
        model->stage = COLUMNS;
        break;
    case COLUMNS:
        make_columns(p, model);
        break;
    case MOTION: {
        const double step = model->centre.step / (double)count_parts(model->centre.step, INNER_STEP);
        found = work_on(p, model, step, p->unit, n, model->rest, model->motion, model->motion + n * stride,
                        rest ? REST : READY);
        break;
    }
    case REST:
        found = work_on(p, model, model->centre.step, model->A + n * stride, MECHANISM_INPUTS + 1, model->rest,
                        model->rest + n * stride, NULL, REST_BLOCKS);
        break;
    case REST_BLOCKS:
        make_map(p, model->rest, n + MECHANISM_INPUTS + 1, n, &model->rooms[0], &model->to_rest);
        model->stage = OUTPUT_BLOCKS;
        break;
    default:
        make_map(p, model->outputs, n + MECHANISM_INPUTS + 1, MECHANISM_OUTPUTS, &model->rooms[1], &model->to_outputs);
        model->stage = READY;
    }
    if (found == MODEL_ON && model->stage == READY)
        return MODEL_READY;
    if (found == MODEL_FAILED)
        model->centre.step = 0.0;
    return found;
}

static void model_begin(Model *model, const Centre *centre)
{
    model->centre = *centre;
    model->stage = BEGIN;
    model->parts = 0;
}

static bool model_is_of(const Model *model, const Centre *centre)
{
    return memcmp(&model->centre, centre, sizeof *centre) == 0;
}

int64_t model_make(Plant *p, Model *model, const Centre *centre, int64_t parts)
{
    if (!model_is_of(model, centre) || model->parts > parts)
        model_begin(model, centre);
    int64_t found = model->stage == READY ? MODEL_READY : MODEL_ON;
    while (found == MODEL_ON && model->parts < parts)
        found = model_work(p, model);
    return found;
}
