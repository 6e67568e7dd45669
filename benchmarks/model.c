/* A linear model as an FMU written in C by hand: no more than the benchmarks ask for, without events.

   resources/model.bin (contenders.py) holds the sizes, the values of all variables at the start, and then a table of
   what each step gives, or a matrix, column by column, that a step multiplies the source with.  With neither, a step
   copies the source to the target. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h" /* no declarations: functions that nobody calls take no arguments below */

enum { LONGEST_PATH = 4096 };

typedef struct {
    int64_t n_data, source, target, n_target, n_rows, n_columns;
} Sizes;

typedef struct {
    Sizes sizes;
    double *data, *numbers, *work;
    int64_t count;
} Model;

static double *take(FILE *file, int64_t n)
{
    double *numbers = calloc((size_t)n + 1, sizeof *numbers);
    return numbers != NULL && fread(numbers, sizeof *numbers, (size_t)n, file) == (size_t)n ? numbers : NULL;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)callbacks, (void)visible, (void)logging;
    char path[LONGEST_PATH];
    snprintf(path, sizeof path, "%s/model.bin", resources + strlen("file://"));
    FILE *file = fopen(path, "rb");
    Model *model = calloc(1, sizeof *model);
    if (file == NULL || model == NULL || fread(&model->sizes, sizeof model->sizes, 1, file) != 1)
        return NULL;
    const Sizes *s = &model->sizes;
    model->data = take(file, s->n_data);
    model->numbers = take(file, (s->n_rows + s->n_columns) * s->n_target);
    model->work = calloc((size_t)s->n_target, sizeof *model->work);
    fclose(file);
    return model->data == NULL || model->numbers == NULL || model->work == NULL ? NULL : model;
}

void fmi2FreeInstance(fmi2Component c)
{
    Model *model = c;
    free(model->data);
    free(model->numbers);
    free(model->work);
    free(model);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state)
{
    (void)time, (void)step, (void)no_set_state;
    Model *model = c;
    const Sizes *s = &model->sizes;
    const double *source = model->data + s->source, *result = source;
    if (s->n_rows > 0) {
        if (model->count >= s->n_rows)
            return fmi2Error;
        result = model->numbers + model->count * s->n_target;
    } else if (s->n_columns > 0) {
        double *restrict work = model->work;
        memset(work, 0, (size_t)s->n_target * sizeof *work);
        for (int64_t j = 0; j < s->n_columns; j++) {
            const double *restrict column = model->numbers + j * s->n_target, x = source[j];
            if (x != 0.0)
                for (int64_t i = 0; i < s->n_target; i++)
                    work[i] += column[i] * x;
        }
        result = work;
    }
    memcpy(model->data + s->target, result, (size_t)s->n_target * sizeof *result);
    model->count++;
    return fmi2OK;
}

#define ACCESS(name, type, convert)                                                                                    \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[])                   \
    {                                                                                                                  \
        const Model *model = c;                                                                                        \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (vr[i] >= model->sizes.n_data)                                                                          \
                return fmi2Error;                                                                                      \
            value[i] = convert model->data[vr[i]];                                                                     \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }                                                                                                                  \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, const type value[])             \
    {                                                                                                                  \
        const Model *model = c;                                                                                        \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (vr[i] >= model->sizes.n_data)                                                                          \
                return fmi2Error;                                                                                      \
            model->data[vr[i]] = value[i];                                                                             \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }

ACCESS(Real, fmi2Real, )
ACCESS(Integer, fmi2Integer, (fmi2Integer))
ACCESS(Boolean, fmi2Boolean, 0.0 !=)

#define ANSWER(name, status)                                                                                           \
    fmi2Status fmi2##name(void)                                                                                        \
    {                                                                                                                  \
        return status;                                                                                                 \
    }
#define REFUSED(name) ANSWER(name, fmi2Error)

/* The state is that of the first step already. */
ANSWER(SetupExperiment, fmi2OK) ANSWER(Terminate, fmi2OK)
ANSWER(EnterInitializationMode, fmi2OK) ANSWER(ExitInitializationMode, fmi2OK)

/* Functions that hosts look for in a library, and that nobody calls in the benchmarks. */

REFUSED(GetTypesPlatform) REFUSED(GetVersion) REFUSED(SetDebugLogging) REFUSED(Reset) REFUSED(GetString)
REFUSED(SetString) REFUSED(GetFMUstate) REFUSED(SetFMUstate) REFUSED(FreeFMUstate) REFUSED(SerializedFMUstateSize)
REFUSED(SerializeFMUstate) REFUSED(DeSerializeFMUstate) REFUSED(GetDirectionalDerivative)
REFUSED(SetRealInputDerivatives) REFUSED(GetRealOutputDerivatives) REFUSED(CancelStep) REFUSED(GetStatus)
REFUSED(GetRealStatus) REFUSED(GetIntegerStatus) REFUSED(GetBooleanStatus) REFUSED(GetStringStatus)
