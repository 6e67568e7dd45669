/* Vectors of eight doubles. */
#define INSTRUCTIONS __attribute__((target("avx512f,avx512dq")))
#define ARITHMETIC arithmetic_avx512
#define WIDTH 8
#define NAME "avx512"
#ifdef __x86_64__
#include "arithmetic.h"
#endif
