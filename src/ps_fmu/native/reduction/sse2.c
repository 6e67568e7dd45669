/* The instructions that every processor has. */
#define INSTRUCTIONS
#define FUNCTIONS functions_sse2
#define WIDTH 2
#define VECTORS 2
#define COMPARED 6
#include "functions.h"
