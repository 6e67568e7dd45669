#ifndef PS_FMU_MODEL_H
#define PS_FMU_MODEL_H

#include "plant.h"

#include <stdbool.h>

enum { MODEL_FAILED = -1, MODEL_ON, MODEL_READY };

/* Of Model: `stage`. */
enum { MODEL_MADE = 99 };

/* Rows of a matrix by columns, with those that fill its vectors. */
int64_t pad(int64_t n);

/* Coordinates and states of the mechanism. */
int64_t count_coordinates(const Plant *p);
int64_t count_states(const Plant *p);

/* Longest inner step, s. */
extern const double INNER_STEP;

/* Parts of a step, a power of two, that are no longer than `longest`, s; MOST_PARTS of one that is too long. */
enum { MOST_PARTS = 1 << 21 };

int64_t count_parts(double step, double longest);

/* The place of the platform with displacements of coarse actuators, rods (NULL: none) and fine legs, m, from one that is
   near. */
bool find_place(const Plant *p, const double coarse[3], const double stretch[3], const double fine[3], Place *place);

/* All at the centre of a model, with the speeds of a state or at rest (NULL). */
bool evaluate_centre(Plant *p, const Model *model, const double *speeds, Point *point);

/* Make a model of a centre until so many parts of it are made; the parts of another one are dropped. */
int64_t model_make(Plant *p, Model *model, const Centre *centre, int64_t parts);

#endif
