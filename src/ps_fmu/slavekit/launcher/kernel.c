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

typedef bool Product(const double *matrix, int64_t stride, const double *x, int64_t n_x, double *w);

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

/* Clamp the results to their limits. */
static void hold(const Core *core)
{
    bool met = false;
    for (int64_t i = 0; i < core->n_limited; i++) {
        double w = core->work[i];
        if (w < core->lower[i] || w > core->upper[i]) {
            core->work[i] = w < core->lower[i] ? core->lower[i] : core->upper[i];
            met = true;
        }
    }
    if (met && core->limit_flag >= 0)
        core->work[core->limit_flag] = 1.0;
}

static bool step(Core *core, Product *product)
{
    const size_t size = (size_t)core->n_target * sizeof(double);
    if (core->plain == CORE_TABLE) {
        int64_t row = core->count - core->block;
        if (row < 0 || row >= core->n_rows)
            return false;
        memcpy(core->work, core->table + row * core->n_target, size);
    } else if (core->plain != CORE_MAP ||
               !product(core->matrix, core->stride, core->source, core->n_source, core->work)) {
        return false;
    }
    if (core->n_limited > 0)
        hold(core);
    memcpy(core->target, core->work, size);
    return true;
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
