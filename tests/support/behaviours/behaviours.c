/* Six small models of FMI 2.0, one library: the GUID says which one an instance is.

   decay       x' = -k x by Euler's steps of 0.1 s
   drop        a ball that falls in steps of 0.01 s and bounces: events inside of the communication steps
   through     inputs of all types go to outputs
   resource    the first byte of a file in its resources
   stair       counts the seconds by time events, and ends the simulation when it has counted to ten
   oscillator  x'' = m (1 - x^2) x' - x by Euler's steps of 0.01 s; its outputs are states with start values */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { REALS = 8, LONGEST = 200 };

/* Places of the Reals, by model; the value reference is the place. */
enum { DECAY_X, DECAY_K, DECAY_TOLERANCE };
enum { DROP_H, DROP_V, DROP_G, DROP_E };
enum { OSCILLATOR_X, OSCILLATOR_V, OSCILLATOR_M };

typedef struct {
    char model[16], resource[1000], text[2][LONGEST];
    double real[REALS], own_step, begin;
    int whole[4], flag[2]; /* whole[2] and [3] are of an enumeration */
    double before;         /* the first Real before the last step */
    long done_before;
    long done;             /* own steps so far */
    double successful, event;
    int ended;
    const fmi2CallbackFunctions *host;
} Model;

static int is(const Model *m, const char *name) { return strcmp(m->model, name) == 0; }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static void start(Model *m)
{
    m->own_step = is(m, "decay") ? 0.1 : 0.01;
    if (is(m, "decay"))
        m->real[DECAY_X] = m->real[DECAY_K] = 1.0;
    if (is(m, "drop"))
        m->real[DROP_H] = 1.0, m->real[DROP_G] = -9.81, m->real[DROP_E] = 0.7;
    if (is(m, "oscillator"))
        m->real[OSCILLATOR_X] = 2.0, m->real[OSCILLATOR_M] = 1.0;
    if (is(m, "through"))
        m->whole[2] = 1;
    if (is(m, "stair"))
        m->whole[1] = 1;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    Model *m = calloc(1, sizeof *m);
    (void)name, (void)type, (void)visible, (void)logging;
    snprintf(m->model, sizeof m->model, "%s", guid);
    if (resources != NULL && strncmp(resources, "file://", 7) == 0)
        snprintf(m->resource, sizeof m->resource, "%s/y.txt", resources + 7);
    m->host = host;
    start(m);
    return m;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Model *m = c, fresh = {.host = m->host};
    memcpy(fresh.model, m->model, sizeof fresh.model);
    memcpy(fresh.resource, m->resource, sizeof fresh.resource);
    start(&fresh);
    *m = fresh;
    return fmi2OK;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real begin,
                               fmi2Boolean ends, fmi2Real end)
{
    Model *m = c;
    (void)ends, (void)end;
    if (is(m, "decay"))
        m->real[DECAY_TOLERANCE] = given ? tolerance : -1.0;
    m->begin = begin;
    m->event = begin + 1.0;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Model *m = c;
    if (!is(m, "resource"))
        return fmi2OK;
    FILE *file = fopen(m->resource, "rb");
    if (file == NULL) {
        m->host->logger(m->host->componentEnvironment, "resource", fmi2Error, "", "cannot open %s", m->resource);
        return fmi2Error;
    }
    m->whole[1] = fgetc(file);
    fclose(file);
    return fmi2OK;
}

static void make_own_step(Model *m)
{
    double *x = m->real;
    const double h = m->own_step, before = x[0];
    if (is(m, "decay")) {
        x[DECAY_X] += h * -x[DECAY_K] * before;
    } else if (is(m, "drop")) {
        x[DROP_H] += h * x[DROP_V];
        x[DROP_V] += h * x[DROP_G];
        if (x[DROP_H] <= 0.0 && x[DROP_V] < 0.0) {
            x[DROP_H] = 1e-10;
            x[DROP_V] *= -x[DROP_E];
            if (x[DROP_V] < 0.1)
                x[DROP_V] = x[DROP_G] = 0.0;
        }
    } else if (is(m, "oscillator")) {
        x[OSCILLATOR_X] += h * x[OSCILLATOR_V];
        x[OSCILLATOR_V] += h * (x[OSCILLATOR_M] * (1.0 - before * before) * x[OSCILLATOR_V] - before);
    }
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean forward)
{
    Model *m = c;
    const double end = time + step;
    if (!forward) /* some take that for: make the last step again */
        m->real[0] = m->before, m->done = m->done_before;
    m->before = m->real[0], m->done_before = m->done;
    while (m->begin + (double)(m->done + 1) * m->own_step < end + 1e-9) {
        make_own_step(m);
        m->done++;
    }
    while (is(m, "stair") && m->event < end + 1e-9) {
        m->successful = m->event++;
        if (++m->whole[1] >= 10) {
            m->ended = 1;
            return fmi2Discard;
        }
    }
    return fmi2OK;
}

#define GET(name, expression) \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##name v[]) \
    { \
        Model *m = c; \
        for (size_t i = 0; i < n; i++) \
            v[i] = expression; \
        return fmi2OK; \
    }

#define SET(name, statement) \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##name v[]) \
    { \
        Model *m = c; \
        for (size_t i = 0; i < n; i++) \
            statement; \
        return fmi2OK; \
    }

/* In pairs: an input, and the output that shows it. */
GET(Real, is(m, "through") ? m->real[r[i] & ~1u] : m->real[r[i]])
GET(Integer, is(m, "through") ? m->whole[r[i] & ~1u] : m->whole[r[i]])
GET(Boolean, m->flag[r[i] & ~1u])
GET(String, m->text[r[i] & ~1u])
SET(Real, m->real[r[i]] = v[i])
SET(Integer, m->whole[r[i]] = v[i])
SET(Boolean, m->flag[r[i]] = v[i])
SET(String, snprintf(m->text[r[i]], LONGEST, "%s", v[i]))

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind what, fmi2Real *value)
{
    *value = ((Model *)c)->successful;
    return what == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind what, fmi2Boolean *value)
{
    *value = ((Model *)c)->ended;
    return what == fmi2Terminated ? fmi2OK : fmi2Discard;
}

#define KEPT(c) ((Model *)(c))
#include "../fmi2_rest.h"
ABSENT(GetDirectionalDerivative, const fmi2ValueReference u[], size_t n, const fmi2ValueReference k[], size_t m,
       const double d[], double e[])
ABSENT(SetRealInputDerivatives, const fmi2ValueReference r[], size_t n, const int o[], const double v[])
