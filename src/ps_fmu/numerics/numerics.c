/* What Python calls: the functions for the instructions that this processor has. */
#include "numerics.h"

#include <string.h>

#ifdef __x86_64__
#include <cpuid.h>
#endif

static const Arithmetic *const known[] = {
    &arithmetic_sse2,
#ifdef __x86_64__
    &arithmetic_avx2,
    &arithmetic_avx512,
#endif
};

static int best; /* the last of them that can be used */

#ifdef __x86_64__
/* Processor and operating system must both support the registers. */
__attribute__((constructor)) static void look_at_processor(void)
{
    enum { OSXSAVE = 1 << 27, AVX2 = 1 << 5, AVX512 = 1 << 16 | 1 << 17 /* F, DQ */, YMM = 0x6, ZMM = 0xe6 };
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & OSXSAVE))
        return;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return;
    if ((low & YMM) == YMM && (b & AVX2))
        best = 1;
    if ((low & ZMM) == ZMM && (b & AVX512) == AVX512)
        best = 2;
}
#endif

/* The functions for a set of instructions, "": the best.  NULL: unknown, or this processor lacks them. */
EXPORT const Arithmetic *numerics_find(const char *instructions)
{
    for (int i = best; i >= 0; i--)
        if (instructions[0] == '\0' || strcmp(instructions, known[i]->instructions) == 0)
            return known[i];
    return NULL;
}
