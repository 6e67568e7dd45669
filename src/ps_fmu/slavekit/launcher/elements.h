/* The elements of a step: what is done before and after its map, number by number. */
#ifndef PS_FMU_ELEMENTS_H
#define PS_FMU_ELEMENTS_H

#include <stdbool.h>

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
    double *data;   /* of the core, as are `places` and `values`: not looked up again at each write */
    int64_t *places;
    double *values;
    const Arithmetic *by;
    int64_t n_undo; /* writes so far */
    bool due;       /* a WATCH has found that an event is due */
} Run;

/* Write a number to a place of `data`, so that it can be undone. */
void run_put(Run *run, int64_t place, double value);

/* Do elements in their order; false if a number is not finite or a delay's memory is impossible.  The caller has to undo
   then. */
bool run_elements(Run *run, const Element *elements, int64_t n);

/* Take back all writes but the first n. */
void run_undo(Run *run, int64_t n);

#endif
