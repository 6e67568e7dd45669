/* The instructions that every processor has. */
#define INSTRUCTIONS
#define ARITHMETIC arithmetic_sse2
#define WIDTH 2
#define NAME "sse2"
#include "arithmetic.h"
