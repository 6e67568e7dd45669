#include "elements.h"
#include "kernel.h"

#include <stddef.h>
#include <string.h>
#ifdef __x86_64__
#include <cpuid.h>
#endif

/* No fused multiply-add: each operation rounds.  (gcc with -std=c99 makes none.) */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#define INSTRUCTIONS
#define PRODUCT product_sse2
#define WIDTH 2
#include "product.h"

#ifdef __x86_64__ /* elsewhere, the vectors of two that every processor has */
#define INSTRUCTIONS __attribute__((target("avx2")))
#define PRODUCT product_avx2
#define WIDTH 4
#include "product.h"

#define INSTRUCTIONS __attribute__((target("avx512f")))
#define PRODUCT product_avx512
#define WIDTH 8
#include "product.h"
#endif

static const struct {
    const char *name;
    Product *product;
} products[] = {
    {"sse2", product_sse2},
#ifdef __x86_64__
    {"avx2", product_avx2},
    {"avx512", product_avx512},
#endif
};

static int best;

#ifdef __x86_64__
/* Processor and operating system must both support the registers. */
__attribute__((constructor)) static void look_at_processor(void)
{
    enum { OSXSAVE = 1 << 27, AVX2 = 1 << 5, AVX512F = 1 << 16, YMM = 0x6, ZMM = 0xe6 };
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & OSXSAVE))
        return;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return;
    if ((low & YMM) == YMM && (b & AVX2))
        best = 1;
    if ((low & ZMM) == ZMM && (b & AVX512F))
        best = 2;
}
#endif

/* Clamp results to their limits. */
static void hold(const Core *core, double *results)
{
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

/* The next row of the table; NULL: none is left. */
static const double *next_row(const Core *core, int64_t width)
{
    int64_t row = core->count - core->block;
    return row < 0 || row >= core->n_rows ? NULL : core->table + row * width;
}

/* The results, into `work`. */
static bool compute(Core *core, Product *product)
{
    if (core->plain == CORE_MAP)
        return product(core->matrix, core->stride, core->source, core->n_source, core->work);
    const double *row = core->plain == CORE_TABLE ? next_row(core, core->n_target) : NULL;
    if (row == NULL)
        return false;
    memcpy(core->work, row, (size_t)core->n_target * sizeof(double));
    return true;
}

static bool simple_step(Core *core, Product *product)
{
    if (!compute(core, product))
        return false;
    if (core->n_limited > 0)
        hold(core, core->work);
    memcpy(core->target, core->work, (size_t)core->n_target * sizeof(double));
    return true;
}

static bool before_and_map(Run *run)
{
    Core *core = run->core;
    if (core->n_row > 0) {
        const double *row = next_row(core, core->n_row);
        if (row == NULL)
            return false;
        for (int64_t i = 0; i < core->n_row; i++)
            run_put(run, core->row - core->data + i, row[i]);
    }
    if (!run_elements(run, core->before, core->n_before))
        return false;
    if (run->due && core->watching) {
        core->pending = CORE_FOUND_DUE;
        return false;
    }
    return compute(core, run->product);
}

static bool full_step(Core *core, Product *product)
{
    const size_t size = (size_t)core->n_target * sizeof(double);
    Run run = {core, product, 0, false};
    if (!before_and_map(&run)) {
        run_undo(&run, 0);
        return false;
    }
    const int64_t before = run.n_undo;
    memcpy(core->kept, core->target, size);
    memcpy(core->target, core->work, size);
    run.due = false;
    if (!run_elements(&run, core->after, core->n_after)) {
        run_undo(&run, before);
        memcpy(core->target, core->kept, size);
        run_undo(&run, 0);
        return false;
    }
    if (core->n_limited > 0)
        hold(core, core->target);
    if (run.due)
        core->pending = CORE_DUE;
    return true;
}

static bool step(Core *core, Product *product)
{
    return core->n_before + core->n_after + core->n_row > 0 && core->plain != CORE_NOTHING ? full_step(core, product)
                                                                                          : simple_step(core, product);
}

bool kernel_step(Core *core)
{
    return step(core, products[best].product);
}

int ps_fmu_step_by(const char *instructions, Core *core)
{
    for (int i = 0; i <= best; i++)
        if (strcmp(instructions, products[i].name) == 0)
            return step(core, products[i].product);
    return -1;
}
