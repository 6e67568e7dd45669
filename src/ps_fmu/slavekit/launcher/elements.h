/* The elements of a step: what is done before and after its map, number by number. */
#ifndef PS_FMU_ELEMENTS_H
#define PS_FMU_ELEMENTS_H

#include <stdbool.h>
#include <string.h>

#include "core.h"

/* w <- M x; false if a result is not finite.  See product.h. */
typedef bool Product(const double *matrix, int64_t stride, const double *x, int64_t n_x, double *w);

/* The result of a map, into its `work`; false if one is not finite. */
typedef bool MapProduct(const Map *map);

/* Products by one set of instructions. */
typedef struct {
    const char *name;
    Product *product;
    MapProduct *map;
} Arithmetic;

/* One step under way. */
typedef struct {
    Core *core;
    double *data;       /* of the core */
    const Arithmetic *by;
    Span *kept;         /* the next free ones of the core's kept_spans and kept_values */
    double *kept_value;
    bool due;           /* a WATCH has found that an event is due */
} Run;

static inline void copy(double *target, const double *source, int64_t n)
{
    memcpy(target, source, (size_t)n * sizeof(double));
}

/* Keep n numbers as they are now, before they are written. */
void run_keep(Run *run, int64_t place, int64_t n);

/* Do elements in their order; false if a number is not finite or a delay's memory is impossible.  The caller has to undo
   then. */
bool run_elements(Run *run, const Element *elements, int64_t n);

/* Put back all that was kept. */
void run_undo(Run *run);

#endif
