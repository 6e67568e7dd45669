/* What Python calls: the functions for the instructions that this processor has. */
#include "../processor.h"
#include "numerics.h"

#include <string.h>

static const Arithmetic *const known[] = {
    [SSE2] = &arithmetic_sse2,
#ifdef __x86_64__
    [AVX2] = &arithmetic_avx2,
    [AVX512] = &arithmetic_avx512,
#endif
};

static int best; /* the last of them that can be used */

__attribute__((constructor)) static void look_at_processor(void)
{
    best = find_instructions();
}

/* The functions for a set of instructions, "": the best.  NULL: unknown, or this processor lacks them. */
EXPORT const Arithmetic *numerics_find(const char *instructions)
{
    for (int i = best; i >= 0; i--)
        if (instructions[0] == '\0' || strcmp(instructions, known[i]->instructions) == 0)
            return known[i];
    return NULL;
}
