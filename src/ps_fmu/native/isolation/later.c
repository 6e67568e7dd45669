/* The calls of the steps, which put off what they can: to set values costs no exchange, and a step takes along the
   reads that followed the step before.  So a step is one exchange, and the FMUs of a Jacobi step run side by side.  A status
   then comes back with a later call than the one it belongs to; `get_outcome` tells whose it is. */

#include <stdlib.h>
#include <string.h>

#include "client.h"

void forget_reads(Client *c)
{
    while (c->n_learnt > 0)
        free(c->learnt[--c->n_learnt].references);
}

static void learn(Client *c, Kind kind, const fmi2ValueReference *references, size_t n)
{
    if (c->n_learnt == MOST_LEARNT || c->n_read != c->n_learnt)
        return;
    Learnt *read = &c->learnt[c->n_learnt];
    if ((read->references = malloc(n * sizeof *references + 1)) == NULL)
        return;
    memcpy(read->references, references, n * sizeof *references);
    read->kind = kind;
    read->n = n;
    c->n_read = ++c->n_learnt;
}

static int later_get(Client *c, Kind kind, const fmi2ValueReference *references, size_t n, void *values)
{
    const int status = settle_batch(c);
    if (c->fate != ALIVE)
        return fmi2Fatal;
    if (status > fmi2Warning || status < fmi2OK) {
        forget_reads(c); /* they were not carried out */
        c->n_read = 0;
        return status;
    }
    const Learnt *read = &c->learnt[c->n_read];
    if (c->n_read < c->n_learnt && c->complete && read->kind == kind && read->n == n
        && memcmp(read->references, references, n * sizeof *references) == 0) {
        memcpy(values, at(c, read->values), n * width(kind));
        c->n_read++;
        return status;
    }
    const int answer = get_values(c, kind, references, n, values);
    learn(c, kind, references, n);
    return answer;
}

EXPORTED int later_SetReal(Client *c, const fmi2ValueReference *r, size_t n, const double *v)
{
    return set_values(c, SET_REAL, r, n, v);
}

EXPORTED int later_SetInteger(Client *c, const fmi2ValueReference *r, size_t n, const int *v)
{
    return set_values(c, SET_INTEGER, r, n, v);
}

EXPORTED int later_SetBoolean(Client *c, const fmi2ValueReference *r, size_t n, const int *v)
{
    return set_values(c, SET_BOOLEAN, r, n, v);
}

EXPORTED int later_SetRealInputDerivatives(
    Client *c, const fmi2ValueReference *r, size_t n, const int *orders, const double *v)
{
    int status;
    Operation *o = begin_operation(c, SET_DERIVATIVES, n * (sizeof *r + sizeof *orders + sizeof *v), &status);
    if (o == NULL)
        return status;
    o->count = n;
    o->references = reserve_place(c, n * sizeof *r);
    o->orders = reserve_place(c, n * sizeof *orders);
    o->values = reserve_place(c, n * sizeof *v);
    memcpy(at(c, o->references), r, n * sizeof *r);
    memcpy(at(c, o->orders), orders, n * sizeof *orders);
    memcpy(at(c, o->values), v, n * sizeof *v);
    return status;
}

EXPORTED int later_GetReal(Client *c, const fmi2ValueReference *r, size_t n, double *v)
{
    return later_get(c, GET_REAL, r, n, v);
}

EXPORTED int later_GetInteger(Client *c, const fmi2ValueReference *r, size_t n, int *v)
{
    return later_get(c, GET_INTEGER, r, n, v);
}

EXPORTED int later_GetBoolean(Client *c, const fmi2ValueReference *r, size_t n, int *v)
{
    return later_get(c, GET_BOOLEAN, r, n, v);
}

EXPORTED int later_DoStep(Client *c, double time, double step, int only_forward)
{
    int status;
    Operation *o = begin_operation(c, DO_STEP, 0, &status);
    if (o == NULL)
        return status;
    o->time = time;
    o->step = step;
    o->only_forward = (uint64_t)only_forward;
    if (c->n_read != c->n_learnt) /* they were not read again: the master has another plan */
        forget_reads(c);
    c->n_read = 0;
    for (uint32_t k = 0; k < c->n_learnt; k++) {
        Learnt *read = &c->learnt[k];
        Operation *get = add_operation(c, read->kind, read->n * (sizeof *read->references + width(read->kind)) + 64);
        if (get == NULL) { /* the others are read one by one */
            while (c->n_learnt > k)
                free(c->learnt[--c->n_learnt].references);
            break;
        }
        get->count = read->n;
        get->references = reserve_place(c, read->n * sizeof *read->references);
        get->values = read->values = reserve_place(c, read->n * width(read->kind));
        memcpy(at(c, get->references), read->references, read->n * sizeof *read->references);
    }
    post_batch(c);
    return c->n_learnt > 0 ? status : collect_batch(c, c->step_ns);
}
