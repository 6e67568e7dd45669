/* Arithmetic on long arrays for the physics, called from Python (library.py), which explains each function.

   Complex numbers are pairs of doubles, arrays are C-contiguous.  No function keeps anything from one call to the next,
   so that any number of threads may call them. */
#ifndef NUMERICS_H
#define NUMERICS_H

#include <stdint.h>

#include "../kernel/core.h"

enum { CHANNELS = 6 /* of a wrench */, NODES = 6 /* of an interpolation */, LANES = 8 /* worked on together */ };

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

/* What all blocks of noise have in common.  A block has CHANNELS / n_terms channels in each of its groups.  Its terms
   are (groups, n, 2, LANES): real and imaginary parts of each line, those of a group side by side, term by term. */
typedef struct {
    const double *share; /* (sources, n) */
    const double *gains; /* complex (n_terms, n) */
    const double *turns; /* complex (phases, n) */
    const double *roots; /* exp(2 pi i k / points), (points) */
    const Run *runs;
    int64_t n, n_terms, phases, points, n_runs;
} Lines;

/* exp(i a) exp(i b), or exp(i a) exp(-i b), of two that are there already. */
typedef struct {
    int64_t one, other, conjugate;
} Product;

/* A force and a torque that turn with the multiples of an angle, each the sum of lines a exp(i multiple angle). */
typedef struct {
    const double *multiples;       /* turns per radian, (n_multiples) */
    const Product *products;       /* what comes after those, (n_products) */
    const int64_t *which;          /* of all these, of each line of the force and, behind them, of the torque, (n_lines) */
    const double *amplitudes;      /* complex (3, n_lines) */
    int64_t n_multiples, n_products, n_force, n_lines;
    double along[4][CHANNELS];     /* of the real and imaginary parts of force and torque */
} Turning;

/* How a wheel's speed goes: constant, linear, constant (rad/s, s); and over which time it is faded in. */
typedef struct {
    double initial, final, start, duration, rise_time;
} Profile;

/* Errors of some sensors in blocks of samples: white noise, and a drift that is linear between places `stride` samples
   apart.  Blocks of the drift are (2, sensors, places): values, and growth to the next place. */
typedef struct {
    double deviation; /* of the white noise */
    int64_t sensors, samples, stride, places;
    uint32_t words[4]; /* that the white noise belongs to; the last one is the number of a block */
} Errors;

/* Recursions of (processes, sensors) over some steps: factors of what was before and of the noise (processes), and of what
   is missing at the end (steps, processes). */
typedef struct {
    const double *decay, *kick, *weight;
    int64_t steps, processes, sensors;
} Bridge;

/* A block of noise that is made part by part: `draws` has room for (2, sources, lines) numbers and three more. */
typedef struct {
    const Lines *lines;
    const double *factor;        /* (CHANNELS, sources) */
    double *draws, *terms, *room;
    const double *sizes;         /* of each phase, (n_terms, points) */
    double *rows;
    const uint32_t *words;       /* that its random numbers belong to */
    int64_t n_words, sources;
    double power;
} NoiseBlock;

/* Arguments of calls; calls.h says what is done with them. */
typedef struct {
    const NoiseBlock *block;
    int64_t first, end;
} Part;

/* Rows that the next call makes: n are left, at most `at_once` are made by a call. */
typedef struct {
    double *rows;
    int64_t n, at_once;
} Progress;

typedef struct {
    Progress left;
    const Tables *tables;
    const double *time; /* of the rows that are left */
    int64_t clear;      /* before they are added to the rows */
} TableRows;

typedef struct {
    Progress left;
    const Turning *turning;
    const Profile *profile;
    const double *time;
    double *room;
} WheelRows;

/* Blocks of normal numbers, 2 half each: one belongs to the words, and the next one to the same with a last word that is
   greater by 1. */
typedef struct {
    Progress left; /* in blocks */
    uint32_t *words;
    int64_t n_words, half;
} KeyedRows;

/* Errors of sensors of one kind, and from which column of the rows on; `drift`: blocks side by side, the first of which is
   number `first_drift`; NULL: there is none. */
typedef struct {
    const Errors *errors;
    const double *const *drift;
    int64_t first_drift, column;
} ErrorKind;

/* Blocks of errors as they are drawn: n of them, from block `first` on. */
typedef struct {
    double *rows;
    int64_t first, n;
} ErrorRoom;

typedef struct {
    Progress left;             /* at_once: blocks */
    ErrorRoom *room;
    const ErrorKind *kinds;
    const int64_t *index;      /* numbers of the samples that are left, rising */
    const double *bias, *gain; /* NULL: none */
    int64_t n_kinds, samples, width;
} ErrorRows;

typedef struct {
    const char *instructions;
    void (*add_rows)(const Tables *, const double *, int64_t, double *);
    void (*draw_lines)(const Lines *, const double *, const double *, int64_t, double, double *, int64_t, int64_t);
    void (*add_turning)(const Turning *, const double *, int64_t, const double *, int64_t, double *, double *);
    void (*draw_keyed)(const uint32_t *, int64_t, int64_t, int64_t, double *);
    void (*connect)(const Bridge *, const double *, const double *, const double *, double *);
    /* Calls. */
    void (*clear_rows)(void *);
    void (*draw_numbers)(void *);
    void (*draw_some_lines)(void *);
    void (*store_phase)(void *);
    void (*add_some_rows)(void *);
    void (*add_some_turns)(void *);
    void (*draw_some_keyed)(void *);
    void (*make_some_errors)(void *);
} Arithmetic;

extern const Arithmetic arithmetic_sse2, arithmetic_avx2, arithmetic_avx512;

#endif
