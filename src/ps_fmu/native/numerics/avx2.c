/* Vectors of four doubles. */
#define INSTRUCTIONS __attribute__((target("avx2")))
#define ARITHMETIC arithmetic_avx2
#define WIDTH 4
#define NAME "avx2"
#ifdef __x86_64__
#include "arithmetic.h"
#endif
