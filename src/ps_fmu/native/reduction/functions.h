/* The functions of reduction.h for one set of INSTRUCTIONS, with FUNCTIONS as the name of their table.

   Every result is rounded after each operation and summed in one order: the same bits with any instructions.  VECTORS:
   sums of a panel, its columns and a tap fit into the registers, 16, or 32 of AVX-512; so do the vectors of columns that
   are COMPARED together: the more, the fewer times the rows are gone over. */
#include "reduction.h"

#include <math.h>
#include <string.h>

/* No fused multiply-add: each operation rounds. */
#pragma STDC FP_CONTRACT OFF

#define INLINE INSTRUCTIONS static inline __attribute__((always_inline))

/* Sums side by side, of each 32nd number, so that vectors of any width give the same bits, and none waits for another;
   numbers that stay in the first cache. */
enum { LANES = 32, CHUNK = 512 };

#include "columns.h"
#include "filter.h"
#include "histogram.h"
#include "moments.h"

const Functions FUNCTIONS = {
    filter_rows, find_peak, complete_rows, add_values, find_moments, widen_bins, weigh_hann,
};
