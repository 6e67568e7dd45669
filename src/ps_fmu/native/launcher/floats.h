/* The settings of floating-point arithmetic, which belong to the host: some have overflows and invalid operations end the
   process (feenableexcept).  Python and numpy overflow now and then, and say so in their own way. */
#ifndef PS_FMU_FLOATS_H
#define PS_FMU_FLOATS_H

#include <stdbool.h>
#include <stdint.h>

/* The default settings until floats_give_back, for this thread; pairs of calls may be within each other. */
void floats_take(void);
void floats_give_back(void);

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

/* Would an overflow, or an operation that is invalid, end the process?  A read of one register: 1 ns alone, 5 ns
   among arithmetic, which has to end first. */
static inline bool floats_trap(void)
{
#if defined(__x86_64__)
    enum { ALL_MASKED = 0x1F80 };
    return (_mm_getcsr() & ALL_MASKED) != ALL_MASKED;
#elif defined(__aarch64__)
    enum { ANY_ENABLED = 0x9F00 };
    uint64_t control;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return (control & ANY_ENABLED) != 0;
#else
    return false;
#endif
}

#endif
