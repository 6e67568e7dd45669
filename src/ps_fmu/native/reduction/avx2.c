/* Vectors of four doubles. */
#define INSTRUCTIONS __attribute__((target("avx2")))
#define FUNCTIONS functions_avx2
#define WIDTH 4
#define VECTORS 2
#define COMPARED 6
#ifdef __x86_64__
#include "functions.h"
#endif
