#include "native.h"

#include <math.h>
#include <stdlib.h>

#include "floats.h"
#include "kernel.h"
#include "python.h"

void native_bind(Instance *m)
{
    static const fmi2ValueReference reference = CORE_REFERENCE;
    fmi2String address = NULL;
    m->core = NULL;
    if (!python_enter(m->generation))
        return;
    bool answered = wrapper.GetString(m->inner, &reference, 1, &address) == fmi2OK;
    python_leave();
    if (!answered)
        return;
    Core *core = (Core *)(uintptr_t)strtoull(address, NULL, 10);
    if (core == NULL)
        return;
    if (core->magic != CORE_MAGIC || core->size != sizeof *core) {
        instance_refuse(m, "fmi2Instantiate", "launcher and model are of different versions: steps are made in Python");
        return;
    }
    core->kernel = (void *)kernel_step;
    m->core = core; /* the slave keeps it, and `inner` keeps the slave */
}

/* The words of an instance; NULL if it has none, and when the host has finalised Python. */
static Core *words_in_any_phase(const Instance *m)
{
    return m != NULL && m->core != NULL && m->generation == python_generation() ? m->core : NULL;
}

/* In its stepping phase; NULL in all others, and where arithmetic may end the process: then steps are made in Python,
   with settings of its own. */
static Core *words(const Instance *m)
{
    Core *core = words_in_any_phase(m);
    return core != NULL && core->stepping && !floats_trap() ? core : NULL;
}

double native_time(const Instance *m)
{
    const Core *core = words_in_any_phase(m);
    return core != NULL ? core->time : m->time;
}

/* The same conditions as in Stepper.do_step. */
bool native_step(Instance *m, double time, double step)
{
    Core *core = words(m);
    if (core == NULL || core->pending || core->finishing || !(fabs(time - core->time) <= core->time_slack) ||
        !(fabs(step - core->step) <= core->step_slack) || !(time <= core->last_start) || !kernel_step(core))
        return false;
    core->time = time + step;
    core->count++;
    core->native_steps++;
    return true;
}

static bool allows(const Core *core, fmi2ValueReference reference, uint8_t kind)
{
    return reference < (uint64_t)core->n_references && (core->kinds[reference] & kind) == kind;
}

static bool allows_value(const Core *core, fmi2ValueReference reference, uint8_t kind, double value)
{
    return allows(core, reference, kind | CORE_SET) && core->low[reference] <= value && value <= core->high[reference];
}

/* A new value of an event input makes an event due; all others just go to their place. */
static void store(Core *core, fmi2ValueReference reference, double value)
{
    if ((core->kinds[reference] & CORE_EVENT) && core->data[reference] != value)
        core->pending = 1;
    core->data[reference] = value;
}

#define GET(name, type, kind, possible, converted)                                                                     \
    bool native_Get##name(const Instance *m, const fmi2ValueReference vr[], size_t n, type value[])                    \
    {                                                                                                                  \
        const Core *core = words(m);                                                                                   \
        if (core == NULL)                                                                                              \
            return false;                                                                                              \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (!allows(core, vr[i], kind))                                                                            \
                return false;                                                                                          \
            double raw = core->data[vr[i]];                                                                            \
            if (!(possible))                                                                                           \
                return false;                                                                                          \
            value[i] = converted;                                                                                      \
        }                                                                                                              \
        return true;                                                                                                   \
    }

#define SET(name, type, kind, converted)                                                                               \
    bool native_Set##name(const Instance *m, const fmi2ValueReference vr[], size_t n, const type value[])              \
    {                                                                                                                  \
        Core *core = words(m);                                                                                         \
        if (core == NULL)                                                                                              \
            return false;                                                                                              \
        for (size_t i = 0; i < n; i++)                                                                                 \
            if (!allows_value(core, vr[i], kind, converted))                                                           \
                return false;                                                                                          \
        for (size_t i = 0; i < n; i++)                                                                                 \
            store(core, vr[i], converted);                                                                             \
        return true;                                                                                                   \
    }

GET(Real, fmi2Real, CORE_REAL, true, raw)
GET(Integer, fmi2Integer, CORE_INTEGER, fabs(raw) <= INT32_MAX, (fmi2Integer)raw)
GET(Boolean, fmi2Boolean, CORE_BOOLEAN, true, raw != 0.0 ? fmi2True : fmi2False)
SET(Real, fmi2Real, CORE_REAL, value[i])
SET(Integer, fmi2Integer, CORE_INTEGER, (double)value[i])
SET(Boolean, fmi2Boolean, CORE_BOOLEAN, value[i] != fmi2False ? 1.0 : 0.0)

fmi2Status ps_fmu_steps(fmi2Component c, int64_t *native, int64_t *python)
{
    const Instance *m = c;
    if (m == NULL || m->core == NULL || m->generation != python_generation())
        return fmi2Error;
    *native = m->core->native_steps;
    *python = m->core->python_steps;
    return fmi2OK;
}
