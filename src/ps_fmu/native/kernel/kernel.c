#include "../processor.h"
#include "elements.h"
#include "kernel.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

/* No fused multiply-add: each operation rounds.  (gcc with -std=c99 makes none.) */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

/* Whether a number is 0 or -0, by its bits: a comparison of doubles takes more instructions. */
static inline bool is_zero(const double *number)
{
    uint64_t bits;
    memcpy(&bits, number, sizeof bits);
    return bits << 1 == 0;
}

#define INSTRUCTIONS
#define WIDTH 2
#include "product.h"

#ifdef __x86_64__ /* elsewhere, the vectors of two that every processor has */
#define INSTRUCTIONS __attribute__((target("avx2")))
#define WIDTH 4
#include "product.h"

#define INSTRUCTIONS __attribute__((target("avx512f")))
#define WIDTH 8
#include "product.h"
#endif

static const Arithmetic arithmetics[] = {
    [SSE2] = {"sse2", product2, map2},
#ifdef __x86_64__
    [AVX2] = {"avx2", product4, map4},
    [AVX512] = {"avx512", product8, map8},
#endif
};

static int best; /* the last of them that can be used */

__attribute__((constructor)) static void look_at_processor(void)
{
    best = find_instructions();
}

/* Clamp results to their limits. */
static void hold(Core *core)
{
    double *results = core->target;
    bool met = false;
    for (int64_t i = 0; i < core->n_limited; i++) {
        double w = results[i];
        if (w < core->lower[i] || w > core->upper[i]) {
            results[i] = w < core->lower[i] ? core->lower[i] : core->upper[i];
            met = true;
        }
    }
    if (met && core->limit_flag >= 0)
        results[core->limit_flag] = 1.0;
}

/* The results, into `target`.  False: a map is not finite, and those before it have written theirs. */
static bool compute(Core *core, const Arithmetic *by)
{
    for (const Map *map = core->maps; map < core->maps + core->n_maps; map++) {
        if (!by->map(map))
            return false;
        copy(map->target, map->work, map->n_target);
    }
    return core->plain == CORE_MAP;
}

/* The elements before the map. */
static bool prepare(Run *run)
{
    Core *core = run->core;
    if (!run_elements(run, core->before, core->n_before))
        return false;
    if (run->due && core->watching) {
        core->pending = CORE_FOUND_DUE;
        return false;
    }
    run->due = false;
    return true;
}

/* The maps and the elements after them, unless a CALL has done all. */
static bool finish(Run *run)
{
    Core *core = run->core;
    return run->finished || (compute(core, run->by) && run_elements(run, core->after, core->n_after));
}

static bool step(Core *core, const Arithmetic *by)
{
    if (core->plain == CORE_NOTHING)
        return false;
    Run run = {core, core->data, by, core->kept_spans, core->kept_values, false, false};
    if (core->n_maps > 1 || core->n_after > 0) /* else a map that is not finite has written nothing */
        run_keep(&run, core->target - core->data, core->n_target);
    for (const Span *span = core->spans; span < core->spans + core->n_spans; span++)
        run_keep(&run, span->place, span->n);
    if (!prepare(&run) || !finish(&run)) {
        run_undo(&run);
        return false;
    }
    if (core->n_limited > 0)
        hold(core);
    if (run.due)
        core->pending = CORE_DUE;
    return true;
}

bool kernel_map(const Map *map)
{
    if (!arithmetics[best].map(map))
        return false;
    copy(map->target, map->work, map->n_target);
    return true;
}

bool kernel_product(const double *matrix, int64_t stride, const double *x, int64_t n_x, double *w)
{
    return arithmetics[best].product(matrix, stride, x, n_x, w);
}

void write_message(Core *core, int64_t status, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    const int needed = vsnprintf(core->message, sizeof core->message, format, values);
    va_end(values);
    if (needed >= (int)sizeof core->message) { /* do not cut within a character */
        size_t end = sizeof core->message - 1;
        while (end > 0 && (core->message[end - 1] & 0xC0) == 0x80)
            end--;
        core->message[end > 0 ? end - 1 : 0] = '\0';
    }
    core->message_status = status;
}

bool kernel_step(Core *core)
{
    return step(core, &arithmetics[best]);
}

int ps_fmu_step_by(const char *instructions, Core *core)
{
    if (*instructions == '\0')
        return kernel_step(core);
    for (int i = 0; i <= best; i++)
        if (strcmp(instructions, arithmetics[i].name) == 0)
            return step(core, &arithmetics[i]);
    return -1;
}
