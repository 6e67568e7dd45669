/* What the processor can do, and the operating system lets it do: for all compiled files of the package. */

#ifndef PROCESSOR_H
#define PROCESSOR_H

#ifdef __x86_64__
#include <cpuid.h>
#endif

/* The widest vectors: two doubles, which every processor has; four; eight (AVX-512 with its parts F and DQ). */
typedef enum { SSE2, AVX2, AVX512 } Instructions;

static inline Instructions find_instructions(void)
{
#ifdef __x86_64__
    enum { OSXSAVE = 1 << 27, HAS_AVX2 = 1 << 5, HAS_AVX512 = 1 << 16 | 1 << 17, YMM = 0x6, ZMM = 0xe6 };
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & OSXSAVE))
        return SSE2;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return SSE2;
    if ((low & ZMM) == ZMM && (b & HAS_AVX512) == HAS_AVX512)
        return AVX512;
    if ((low & YMM) == YMM && (b & HAS_AVX2))
        return AVX2;
#endif
    return SSE2;
}

#endif
