/* The functions of numerics.h for one set of INSTRUCTIONS, with ARITHMETIC as the name of their table.

   Every result is rounded after each operation and summed in one order: the same bits with any instructions. */
#include "angles.h"
#include "numerics.h"
#include "../kernel/kernel.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

/* No fused multiply-add: each operation rounds. */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#define INLINE INSTRUCTIONS static inline __attribute__((always_inline))

enum { PART = 64 /* numbers worked on together: they stay in the first cache; library.py, too */ };

/* The nearest whole number of |x| < 2^51. */
INLINE double round_to_whole(double x)
{
    return (x + ROUND) - ROUND;
}

typedef double Vector __attribute__((vector_size(8 * WIDTH), aligned(8))); /* arrays of Python lie anywhere */

#include "elementary.h"
#include "random.h"
#include "keyed.h"
#include "tables.h"
#include "transform.h"
#include "noise.h"
#include "turning.h"
#include "source.h"
#include "errors.h"
#include "instruments.h"

const Arithmetic ARITHMETIC = {
    NAME, add_rows, draw_lines, draw_keyed, add_sources, make_errors, make_white, find_tracker_noise,
    explain_alias, exponential_less_one,
    add_noise, add_wheel, add_tone, add_chirp, add_multisine, add_recording,
    step_source, step_inertial, step_tracker, step_coils,
};
