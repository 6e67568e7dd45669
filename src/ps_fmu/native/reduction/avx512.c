/* Vectors of eight doubles. */
#define INSTRUCTIONS __attribute__((target("avx512f")))
#define FUNCTIONS functions_avx512
#define WIDTH 8
#define VECTORS 4
#define COMPARED 12
#ifdef __x86_64__
#include "functions.h"
#endif
