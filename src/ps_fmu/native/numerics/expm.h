/* Exact steps of linear systems: the exponential of a matrix, and the map of a step made of it. */
#ifndef EXPM_H
#define EXPM_H

#include "../kernel/core.h"

/* Of x' = A x + B u over a step: x(step) = exponential x(0) + held u where u is held, and + ramp du where u grows evenly by
   du.  Matrices are stored by columns, of `stride` numbers each: n rounded up to whole vectors (core.h, Block), with
   zeros behind them, on cache lines. */
typedef struct {
    int64_t n, m, stride;
    double step;                      /* s */
    const double *A, *B;              /* (n, n), (n, m) */
    double *exponential, *held;       /* (n, n), (n, m) */
    double *ramp;                     /* (n, m); NULL: not asked for */
    double *room;                     /* discretise_room(n) numbers, on a cache line */
    /* How far it is. */
    int64_t stage, column, halvings, doublings, sweeps;
    double largest;
} Discretisation;

/* Numbers of room for n states. */
EXPORT int64_t discretise_room(int64_t n);

/* Begin anew: with other matrices, or another step. */
EXPORT void discretise_begin(Discretisation *d);

enum { DISCRETISE_FAILED = -1, DISCRETISE_ON, DISCRETISE_DONE };

/* Go on, for about `budget` multiplications: it ends with the first column of a matrix that reaches it, so that a part takes
   n stride multiplications more at the most.  DISCRETISE_DONE: the results are there, the same bits whatever the parts
   were.  DISCRETISE_FAILED: A or B is not finite, or the step is so long that few digits would be right. */
EXPORT int64_t discretise(Discretisation *d, int64_t budget);

/* Where make_blocks puts what it makes, for matrices of up to so many columns and so many groups of eight rows. */
typedef struct {
    Block *blocks;    /* (groups) */
    int32_t *columns; /* (groups columns) */
    double *numbers;  /* (8 groups columns), on a cache line */
    double *costs;    /* (groups + 1) */
    int64_t *words;   /* (groups (1 + columns / 64 + 1) + 1) */
} BlockRoom;

/* The blocks of a matrix by columns of `stride` numbers, a multiple of eight, for a map: its n_blocks, blocks, columns and
   numbers.  Returns how many numbers the blocks have. */
EXPORT int64_t make_blocks(const double *by_columns, int64_t n, int64_t stride, const BlockRoom *room, Map *map);

/* A map that belongs to steps of one size. */
typedef struct {
    double step;      /* s; 0: none yet */
    double *by_columns;
    BlockRoom room;
    Map map;
} HeldMap;

enum { HELD_MAPS = 4 };

/* x' = A x + B u with u held over steps of any size: the first map of a core is that of its present step. */
typedef struct {
    Discretisation work;
    HeldMap maps[HELD_MAPS];
    int64_t oldest;
} HeldMaps;

/* A CALL before the map, with HeldMaps as its arguments. */
EXPORT int64_t use_held_map(void *arguments, Core *core);

#endif
