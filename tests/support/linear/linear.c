/* An FMU in C that is exact within its steps: x' = A x + B u, y = C x + D u, each u a line in time.

   model.h has the sizes NX, NU, NY, the matrices, by rows, and the time ENDS [s] at which it ends the simulation.  Value references: outputs from 0 on, then inputs, then states.
   A step takes u and its slope where it begins; at its end u is where the line has got to, and the slope is 0. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "model.h"

enum { N = NX + 2 * NU, U = NX, SLOPE = NX + NU };

typedef struct {
    double now[N]; /* states, inputs, slopes */
} State;

typedef struct {
    State state;
    double length, map[N][N]; /* exp(M h), for the h of the last step */
    double reached;           /* s, where it has ended the simulation */
} Instance;

static void multiply(double result[N][N], double left[N][N], double right[N][N])
{
    double product[N][N];
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            product[i][j] = 0.0;
            for (int k = 0; k < N; k++)
                product[i][j] += left[i][k] * right[k][j];
        }
    memcpy(result, product, sizeof product);
}

/* exp([A B 0; 0 0 1; 0 0 0] h) by its series and doubling. */
static void find_map(Instance *m, double h)
{
    enum { DOUBLINGS = 12, TERMS = 12 };
    double scaled[N][N] = {{0.0}}, term[N][N] = {{0.0}};
    const double part = ldexp(h, -DOUBLINGS);
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++)
            scaled[i][j] = A[i * NX + j] * part;
        for (int j = 0; j < NU; j++)
            scaled[i][U + j] = B[i * NU + j] * part;
    }
    for (int j = 0; j < NU; j++)
        scaled[U + j][SLOPE + j] = part;
    memset(m->map, 0, sizeof m->map); /* the map less 1, which keeps its digits in the doublings */
    for (int i = 0; i < N; i++)
        term[i][i] = 1.0;
    for (int k = 1; k <= TERMS; k++) {
        multiply(term, term, scaled);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                term[i][j] /= k;
                m->map[i][j] += term[i][j];
            }
    }
    for (int k = 0; k < DOUBLINGS; k++) {
        double square[N][N];
        multiply(square, m->map, m->map);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                m->map[i][j] = 2.0 * m->map[i][j] + square[i][j];
    }
    m->length = h;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)location, (void)callbacks, (void)visible, (void)logging;
    Instance *m = calloc(1, sizeof *m);
    memcpy(m->state.now, X0, NX * sizeof *X0);
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2Reset(fmi2Component c)
{
    memset(&((Instance *)c)->state, 0, sizeof(State));
    memcpy(((Instance *)c)->state.now, X0, NX * sizeof *X0);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean only_forward)
{
    Instance *m = c;
    double next[N];
    (void)only_forward;
    if (m->length != step)
        find_map(m, step);
    for (int i = 0; i < N; i++) {
        next[i] = m->state.now[i];
        for (int j = 0; j < N; j++)
            next[i] += m->map[i][j] * m->state.now[j];
    }
    memcpy(m->state.now, next, sizeof next);
    memset(m->state.now + SLOPE, 0, NU * sizeof(double));
    m->reached = time + step;
    return m->reached > ENDS - 1e-9 ? fmi2Discard : fmi2OK;
}

/* Asked for where a step is said to be discarded. */
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind what, fmi2Boolean *value)
{
    *value = ((Instance *)c)->reached > ENDS - 1e-9;
    return what == fmi2Terminated ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind what, fmi2Real *value)
{
    *value = ((Instance *)c)->reached;
    return what == fmi2LastSuccessfulTime ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[])
{
    for (size_t k = 0; k < n; k++) {
        if (r[k] < NY || r[k] >= NY + NU + NX)
            return fmi2Error;
        ((Instance *)c)->state.now[r[k] < NY + NU ? U + r[k] - NY : r[k] - NY - NU] = v[k];
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real v[])
{
    for (size_t k = 0; k < n; k++) {
        if (!INTERPOLATES || r[k] < NY || r[k] >= NY + NU || order[k] != 1)
            return fmi2Error;
        ((Instance *)c)->state.now[SLOPE + r[k] - NY] = v[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
{
    const double *now = ((Instance *)c)->state.now;
    for (size_t k = 0; k < n; k++) {
        if (r[k] >= NY) {
            v[k] = now[r[k] < NY + NU ? U + r[k] - NY : r[k] - NY - NU];
            continue;
        }
        v[k] = 0.0;
        for (size_t j = 0; j < NX; j++)
            v[k] += C[r[k] * NX + j] * now[j];
        for (size_t j = 0; j < NU; j++)
            v[k] += D[r[k] * NU + j] * now[U + j];
    }
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real result[])
{
    (void)c;
    for (size_t k = 0; k < n_unknown; k++) {
        result[k] = 0.0;
        for (size_t j = 0; j < n_known; j++)
            result[k] += D[unknown[k] * NU + known[j] - NY] * seed[j];
    }
    return fmi2OK;
}

#define DONE(name) fmi2Status fmi2##name(fmi2Component c) { (void)c; return fmi2OK; }
DONE(EnterInitializationMode)
DONE(ExitInitializationMode)
DONE(Terminate)

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real start, fmi2Boolean e, fmi2Real f)
{
    (void)c, (void)a, (void)b, (void)start, (void)e, (void)f;
    return fmi2OK;
}

#define KEPT(c) (&((Instance *)(c))->state)
#include "../fmi2_rest.h"
ABSENT(SetInteger, const fmi2ValueReference r[], size_t n, const int v[])
ABSENT(SetBoolean, const fmi2ValueReference r[], size_t n, const int v[])
ABSENT(SetString, const fmi2ValueReference r[], size_t n, const fmi2String v[])
ABSENT(GetInteger, const fmi2ValueReference r[], size_t n, int v[])
ABSENT(GetBoolean, const fmi2ValueReference r[], size_t n, int v[])
ABSENT(GetString, const fmi2ValueReference r[], size_t n, fmi2String v[])
