/* How the processor computes with floating-point numbers in this thread, without the flags of what has happened: the
   rounding, what traps, and whether numbers below 2.2e-308 are taken for zero.  The start-up code that gcc links to what
   is compiled with -ffast-math sets the last for all that the thread computes. */

#pragma once

#if defined(__x86_64__)
#include <xmmintrin.h>
static unsigned long read_control_word(void)
{
    return _mm_getcsr() & ~0x3Fu;
}
static void write_control_word(unsigned long word)
{
    _mm_setcsr((unsigned)word);
}
#elif defined(__aarch64__)
static unsigned long read_control_word(void)
{
    unsigned long word;
    __asm__ volatile("mrs %0, fpcr" : "=r"(word));
    return word;
}
static void write_control_word(unsigned long word)
{
    __asm__ volatile("msr fpcr, %0" : : "r"(word));
}
#else
static unsigned long read_control_word(void)
{
    return 0;
}
static void write_control_word(unsigned long word)
{
    (void)word;
}
#endif

/* Returns 1 if it was another one. */
static int put_control_word_back(unsigned long word)
{
    if (read_control_word() == word)
        return 0;
    write_control_word(word);
    return 1;
}
