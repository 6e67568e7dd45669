/* Arithmetic on long arrays for the physics, called from Python (library.py), which explains each function.

   Complex numbers are pairs of doubles, arrays are C-contiguous.  No function keeps anything from one call to the next,
   so that any number of threads may call them. */
#ifndef NUMERICS_H
#define NUMERICS_H

#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { CHANNELS = 6 /* of a wrench */, NODES = 6 /* of an interpolation */ };

/* One or two tables of rows (n, CHANNELS) on one grid, to be added. */
typedef struct {
    const double *one, *other; /* other: NULL if there is none */
    int64_t n, shift_one, shift_other;
    double start, rate; /* s, Hz */
} Tables;

/* Lines that go to bins side by side. */
typedef struct {
    int64_t first, end; /* lines */
    int64_t bin;        /* of the first */
    int64_t mirrored;   /* bins descend, and conjugates go there */
} Run;

/* Random lines of a block. */
typedef struct {
    const double *draws; /* (2, sources, lines), from 0 to below 1 */
    const double *factor; /* (channels, sources) */
    const double *share;  /* (lines) */
    const double *gains;  /* complex (n_terms, lines) */
    double *terms;        /* complex (channels, n_terms, lines) */
    int64_t sources, channels, lines, n_terms;
    double power;         /* mean square of an amplitude */
} Draws;

/* What turns with the multiples of an angle. */
typedef struct {
    const double *multiples; /* turns per radian, (n) */
    const double *along;     /* of cosine and sine, (n_terms, n, 2, CHANNELS) */
    int64_t n, n_terms;
} Turning;

typedef struct {
    const char *instructions;
    void (*add_rows)(const Tables *, const double *, int64_t, double *);
    void (*draw_lines)(const Draws *, int64_t, int64_t);
    void (*fold)(const double *, const double *, int64_t, int64_t, const Run *, int64_t, double *, int64_t);
    void (*weigh)(const double *, const double *, int64_t, int64_t, int64_t, double *, int64_t);
    void (*draw_normal)(const double *, int64_t, int64_t, double *);
    void (*add_turning)(const Turning *, const double *, int64_t, const double *, double *);
} Arithmetic;

extern const Arithmetic arithmetic_sse2, arithmetic_avx2, arithmetic_avx512;

#endif
