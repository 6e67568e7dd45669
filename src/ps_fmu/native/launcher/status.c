/* The calls that need no Python: logging, status, and what this FMU does not support. */
#include "native.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean logging, size_t n, const fmi2String categories[])
{
    Instance *m = c;
    if (m == NULL)
        return fmi2Error;
    const char *fault = fault_of_values(n, categories, categories);
    if (fault != NULL)
        return instance_refuse(m, __func__, fault);
    instance_forget_categories(m);
    m->logging = logging != fmi2False;
    m->categories = calloc(n > 0 ? n : 1, sizeof *m->categories);
    for (size_t i = 0; m->categories != NULL && i < n; i++) {
        char *copy = categories[i] != NULL ? strdup(categories[i]) : NULL;
        if (copy != NULL)
            m->categories[m->n_categories++] = copy;
    }
    return fmi2OK;
}

static fmi2Status not_supported(fmi2Component c, const char *function)
{
    return c != NULL ? instance_refuse(c, function, "this FMU does not support it") : fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return not_supported(c, __func__);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return not_supported(c, __func__);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return not_supported(c, __func__);
}

/* Steps are never pending. */
#define NONE(name, type)                                                                                               \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind kind, type *value)                                  \
    {                                                                                                                  \
        (void)c, (void)kind, (void)value;                                                                              \
        return fmi2Discard;                                                                                            \
    }

NONE(Status, fmi2Status)
NONE(IntegerStatus, fmi2Integer)
NONE(StringStatus, fmi2String)

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const Instance *m = c;
    if (m == NULL || value == NULL || kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    double time = native_time(m);
    if (isnan(time))
        return fmi2Discard;
    *value = time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (c == NULL || value == NULL || kind != fmi2Terminated)
        return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}
