#include "native.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../kernel/elements.h"
#include "floats.h"
#include "../kernel/kernel.h"
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
    m->core = core; /* the slave keeps it, and `inner` keeps the slave */
}

/* The words of an instance; NULL if it has none, and when the host has finalised Python. */
static Core *words_in_any_phase(const Instance *m)
{
    return m != NULL && m->core != NULL && m->generation == python_generation() ? m->core : NULL;
}

/* In its stepping phase; NULL in all others. */
static Core *words_to_move(const Instance *m)
{
    Core *core = words_in_any_phase(m);
    return core != NULL && core->stepping ? core : NULL;
}

/* The same for arithmetic; NULL, too, where that may end the process: then it is done in Python, with settings of its
   own.  To ask takes 5 ns, since the processor ends all arithmetic under way first: what moves numbers does not ask. */
static Core *words(const Instance *m)
{
    Core *core = words_to_move(m);
    return core != NULL && !floats_trap() ? core : NULL;
}

double native_time(const Instance *m)
{
    const Core *core = words_in_any_phase(m);
    return core != NULL ? core->time : m->time;
}

static int64_t bits_of(double value)
{
    int64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* The bits of |value|, which are in the order of these sizes; those of what is no number are above all. */
static int64_t size_bits(double value)
{
    return bits_of(value) & INT64_MAX;
}

/* The same conditions as in Stepper.do_step. */
static bool is_expected(const Core *core, double time, double step)
{
    return fabs(time - core->time) <= core->time_slack && fabs(step - core->step) <= core->step_slack &&
           time <= core->last_start;
}

/* The distance from a time to the next larger number, s. */
static double find_spacing(double time)
{
    const int64_t bits = size_bits(time) + 1;
    double next;
    memcpy(&next, &bits, sizeof next);
    return next - fabs(time);
}

/* As _compute_time_slack in stepper.py. */
static double find_time_slack(double time, double step)
{
    const double usual = 1e-3 * step, least = 4.0 * find_spacing(time);
    return usual > least ? usual : least;
}

/* As Stepper._check_step. */
static bool is_possible(const Core *core, double time, double step)
{
    const double slack = find_time_slack(time, step);
    return core->stepping && step > 0.0 && fabs(time - core->time) <= slack && time < time + step &&
           time + step <= DBL_MAX && time <= core->stop - step + slack;
}

/* As Stepper._step_carefully, for slaves whose steps are the same whatever their size.  All or nothing. */
NOT_INLINE static bool step_carefully(Core *core, double time, double step)
{
    if (!core->any_step || !is_possible(core, time, step))
        return false;
    const double origin = core->origin, step_before = core->step;
    const int64_t count = core->count;
    const double slack = find_time_slack(time, step_before);
    if (!(fabs(step - step_before) <= SAME_STEP * step_before &&
          fabs(origin + (double)count * step_before - time) <= slack)) {
        core->origin = time;
        core->step = step;
        core->count = 0;
    }
    if (!kernel_step(core)) {
        core->origin = origin;
        core->step = step_before;
        core->count = count;
        return false;
    }
    core->time_slack = find_time_slack(time, core->step);
    core->last_start = core->stop - core->step + core->time_slack;
    core->step_slack = SAME_STEP * core->step;
    return true;
}

/* Pass a warning of the step on. */
NOT_INLINE static void pass_warning(const Instance *m, Core *core)
{
    core->message_status = MESSAGE_NONE;
    char *text = formatted("%s: %s", core->label, core->message);
    if (text != NULL)
        instance_tell(m, fmi2Warning, text);
    free(text);
}

bool native_step(Instance *m, double time, double step)
{
    Core *core = words(m);
    if (core == NULL || core->pending)
        return false;
    if (is_expected(core, time, step)) {
        if (!kernel_step(core))
            return false;
    } else if (!step_carefully(core, time, step))
        return false;
    core->time = time + step;
    core->count++;
    core->native_steps++;
    if (core->message_status != MESSAGE_NONE)
        pass_warning(m, core);
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

/* Whether two numbers differ, without arithmetic. */
static bool differ(double one, double other)
{
    return bits_of(one) != bits_of(other) && (size_bits(one) | size_bits(other)) != 0;
}

/* A new value of an event input makes an event due; all others just go to their place. */
static void store(Core *core, fmi2ValueReference reference, double value)
{
    if ((core->kinds[reference] & CORE_EVENT) && differ(core->data[reference], value))
        core->pending = 1;
    core->data[reference] = value;
}

/* All are looked at before the first is written: a refused call leaves the host's numbers as they were. */
#define GET(name, type, kind, find_words, possible, converted)                                                         \
    bool native_Get##name(const Instance *m, const fmi2ValueReference vr[], size_t n, type value[])                    \
    {                                                                                                                  \
        const Core *core = find_words(m);                                                                              \
        if (core == NULL)                                                                                              \
            return false;                                                                                              \
        for (size_t i = 0; i < n; i++)                                                                                 \
            if (!allows(core, vr[i], kind) || !possible(core->data[vr[i]]))                                            \
                return false;                                                                                          \
        for (size_t i = 0; i < n; i++) {                                                                               \
            const double raw = core->data[vr[i]];                                                                      \
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

#define FITS(raw) (fabs(raw) <= INT32_MAX)
#define ALWAYS(raw) true
GET(Integer, fmi2Integer, CORE_INTEGER, words, FITS, (fmi2Integer)raw)
GET(Boolean, fmi2Boolean, CORE_BOOLEAN, words_to_move, ALWAYS, size_bits(raw) != 0 ? fmi2True : fmi2False)
SET(Integer, fmi2Integer, CORE_INTEGER, (double)value[i])
SET(Boolean, fmi2Boolean, CORE_BOOLEAN, value[i] != fmi2False ? 1.0 : 0.0)

/* Reals are most of the numbers, and mostly lie side by side: they are looked at as runs of neighbours. */
static size_t run_length(const fmi2ValueReference vr[], size_t n)
{
    size_t k = 1;
    while (k < n && vr[k] == vr[0] + k)
        k++;
    return k;
}

/* Whether all of a list, not empty, is one run: without a jump at each, so that the compiler makes vectors of it. */
static bool is_one_run(const fmi2ValueReference vr[], size_t n)
{
    fmi2ValueReference off = 0;
    for (size_t k = 0; k < n; k++)
        off |= vr[k] ^ (vr[0] + (fmi2ValueReference)k);
    return off == 0;
}

/* Whether the n numbers from `first` on exist and allow all that `kind` says. */
static bool allow_run(const Core *core, fmi2ValueReference first, size_t n, uint8_t kind)
{
    if (first + n > (uint64_t)core->n_references)
        return false;
    uint8_t common = kind;
    for (size_t k = 0; k < n; k++)
        common &= core->kinds[first + k];
    return common == kind;
}

bool native_GetReal(const Instance *m, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const Core *core = words_to_move(m);
    if (core == NULL)
        return false;
    if (n > 0 && is_one_run(vr, n)) {
        if (!allow_run(core, vr[0], n, CORE_REAL))
            return false;
        memcpy(value, core->data + vr[0], n * sizeof *value);
        return true;
    }
    for (size_t i = 0, k; i < n; i += k) {
        k = run_length(vr + i, n - i);
        if (!allow_run(core, vr[i], k, CORE_REAL))
            return false;
    }
    for (size_t i = 0; i < n; i++)
        value[i] = core->data[vr[i]];
    return true;
}

/* Whether all values are within their bounds. */
static bool are_within(const Core *core, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t i = 0; i < n; i++)
        if (!(core->low[vr[i]] <= value[i] && value[i] <= core->high[vr[i]])) /* not a number: outside */
            return false;
    return true;
}

/* Whether all of a list may be set to these values; `any`: what one of the references allows, or more.  In one loop, that
   is without arithmetic where the bounds are as far below 0 as above, as those of nearly all inputs are. */
static bool may_set(const Core *core, const fmi2ValueReference vr[], size_t n, const fmi2Real value[], uint8_t *any)
{
    const uint8_t needed = CORE_REAL | CORE_SET;
    uint8_t all = needed, some = 0;
    int inside = 1;
    ONE_BY_ONE
    for (size_t i = 0; i < n; i++) {
        const fmi2ValueReference reference = vr[i];
        if (reference >= (uint64_t)core->n_references)
            return false;
        const int64_t bound = bits_of(core->high[reference]);
        all &= core->kinds[reference];
        some |= core->kinds[reference];
        inside &= size_bits(value[i]) <= bound;
        inside &= bits_of(core->low[reference]) == (bound | INT64_MIN);
    }
    *any = some;
    return all == needed && (inside || (!floats_trap() && are_within(core, vr, n, value)));
}

/* One by one: hosts have often just written the values so, and a vector of such numbers cannot be read before all that
   was written earlier has reached the cache, perhaps a row of results: 40 ns. */
bool native_SetReal(const Instance *m, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Core *core = words_to_move(m);
    uint8_t any;
    if (core == NULL || !may_set(core, vr, n, value, &any))
        return false;
    if (any & CORE_EVENT) {
        for (size_t i = 0; i < n; i++)
            store(core, vr[i], value[i]);
        return true;
    }
    double *data = core->data;
    ONE_BY_ONE
    for (size_t i = 0; i < n; i++)
        data[vr[i]] = value[i];
    return true;
}

bool native_needs_linear(const Instance *m)
{
    const Core *core = words(m);
    return core == NULL || core->linear == NULL || !core->linear_holds;
}

/* The row of an unknown in the linear model; -1: none. */
static int64_t find_row(const Core *core, fmi2ValueReference unknown)
{
    const int64_t reference = unknown, rate = reference - core->first_rate;
    if (rate >= 0 && rate < core->n_rates)
        return rate;
    return reference < core->n_outputs && (core->kinds[reference] & CORE_REAL) ? core->n_rates + reference : -1;
}

/* The column of a known in the linear model; -1: none. */
static int64_t find_column(const Core *core, fmi2ValueReference known)
{
    const int64_t state = (int64_t)known - core->n_outputs, input = (int64_t)known - core->first_input;
    if (state >= 0 && state < core->n_rates)
        return state;
    return input >= 0 && input < core->n_inputs ? core->n_rates + input : -1;
}

const char NOT_PROVIDED[] = "a derivative is not provided: the output is not linear in an input, or depends on the step size";

const char *native_differentiate(const Instance *m, const fmi2ValueReference unknown[], size_t n_unknown,
                                 const fmi2ValueReference known[], size_t n_known, const fmi2Real direction[],
                                 fmi2Real result[])
{
    const Core *core = words_in_any_phase(m);
    if (core == NULL || core->linear == NULL)
        return "this FMU does not support it";
    for (size_t i = 0; i < n_unknown; i++)
        if (find_row(core, unknown[i]) < 0)
            return "an unknown is neither a Real output nor the derivative of a state";
    for (size_t j = 0; j < n_known; j++)
        if (find_column(core, known[j]) < 0)
            return "a known is neither a state nor an input of the linear model";
    const int64_t rows = core->n_rates + core->n_outputs;
    for (size_t i = 0; i < n_unknown; i++) {
        const double *row = core->linear + find_row(core, unknown[i]);
        result[i] = 0.0;
        for (size_t j = 0; j < n_known; j++)
            if (direction[j] != 0.0)
                result[i] += row[find_column(core, known[j]) * rows] * direction[j];
        if (result[i] != result[i])
            return NOT_PROVIDED;
    }
    return NULL;
}

fmi2Status ps_fmu_steps(fmi2Component c, int64_t *native, int64_t *python)
{
    const Instance *m = c;
    if (m == NULL || m->core == NULL || m->generation != python_generation())
        return fmi2Error;
    *native = m->core->native_steps;
    *python = m->core->python_steps;
    return fmi2OK;
}
