/* The step of a linear model: one product of matrix and vector, or one row of a table, and elements around it. */
#ifndef PS_FMU_KERNEL_H
#define PS_FMU_KERNEL_H

#include <stdbool.h>

#include "core.h"

#include "fmi2Functions.h"

/* The plain step of a core; without looking at times and events.  All or nothing: false where there is no row left, where
   a result would not be finite, and where an element finds that an event is due before the step: `pending` says so. */
bool kernel_step(Core *core);

/* target <- matrix source of a map, by the best instructions of the processor; false, and target is not written: a result is not
   finite. */
bool kernel_map(const Map *map);

/* w <- M x of a matrix by columns, each of `stride` numbers on a cache line; false: a result is not finite. */
bool kernel_product(const double *matrix, int64_t stride, const double *x, int64_t n_x, double *w);

/* Leave a message of a step, in the words of printf; one that is too long is cut. */
void write_message(Core *core, int64_t status, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* The same as kernel_step for Python, by the instructions that are named, "sse2", "avx2" or "avx512"; "": by those of kernel_step.  1 done,
   0 refused, -1 this processor lacks them.  The results are the same bit for bit. */
FMI2_Export int ps_fmu_step_by(const char *instructions, Core *core);

#endif
