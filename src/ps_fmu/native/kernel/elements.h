/* The elements of a step: what is done before and after its map, number by number. */
#ifndef PS_FMU_ELEMENTS_H
#define PS_FMU_ELEMENTS_H

#include <float.h>
#include <math.h>
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
    bool finished;      /* a CALL has completed the step */
} Run;

/* Have a loop done as it is written: for a few numbers, vectors and what chooses between them cost more than they bring,
   50 ns a step of the plant. */
#ifdef __clang__
#define ONE_BY_ONE _Pragma("clang loop vectorize(disable) unroll(disable)")
#else
#define ONE_BY_ONE
#endif

/* Keep what is rarely done out of the code around it. */
#define NOT_INLINE __attribute__((noinline))

static inline void copy(double *target, const double *source, int64_t n)
{
    enum { FEW = 16 }; /* a call of memcpy takes 3 ns */
    if (n > FEW) {
        memcpy(target, source, (size_t)n * sizeof(double));
        return;
    }
    ONE_BY_ONE
    for (int64_t k = 0; k < n; k++)
        target[k] = source[k];
}

/* Two numbers at once, which every processor of these platforms can do; they lie anywhere. */
typedef double Pair __attribute__((vector_size(16), aligned(8)));
typedef int64_t PairBits __attribute__((vector_size(16)));

/* Numbers that lie side by side: whether all are finite.  x - x is 0 or -0 then, else no number. */
static inline bool are_finite(const double *x, int64_t n)
{
    PairBits any = {0, 0};
    int64_t k = 0;
    for (; k + 2 <= n; k += 2) {
        const Pair pair = *(const Pair *)(x + k);
        any |= (PairBits)(pair - pair);
    }
    if (k < n) {
        const Pair pair = {x[k], 0.0};
        any |= (PairBits)(pair - pair);
    }
    return ((any[0] | any[1]) & INT64_MAX) == 0;
}

/* Whether a number is finite, without a jump: loops ask it of all their results together. */
static inline int is_finite(double value)
{
    return fabs(value) <= DBL_MAX;
}

/* Keep n numbers as they are now, before they are written. */
void run_keep(Run *run, int64_t place, int64_t n);

/* Do elements in their order, up to a CALL that completes the step; false if a number is not finite, a delay's memory is
   impossible or full, or a CALL refuses.  The caller has to undo then. */
bool run_elements(Run *run, const Element *elements, int64_t n);

/* Elements with times of their own (timed.c); see run_elements. */
bool run_sample(Run *run, const Element *e);
bool run_hold(Run *run, const Element *e);
bool run_delay(Run *run, const Element *e);

/* Put back all that was kept. */
void run_undo(Run *run);

#endif
