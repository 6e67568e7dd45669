/* What the processor can do, and the operating system lets it do. */

#ifndef PROCESSOR_H
#define PROCESSOR_H

#include <cpuid.h>

typedef enum { SSE2, AVX2, AVX512 } Instructions;

static inline Instructions find_instructions(void)
{
    enum { OSXSAVE = 1 << 27, HAS_AVX2 = 1 << 5, HAS_AVX512F = 1 << 16, YMM = 0x6, ZMM = 0xe6 };
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & OSXSAVE))
        return SSE2;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return SSE2;
    if ((low & ZMM) == ZMM && (b & HAS_AVX512F))
        return AVX512;
    return (low & YMM) == YMM && (b & HAS_AVX2) ? AVX2 : SSE2;
}

#endif
