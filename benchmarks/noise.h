/* Gaussian noise as one writes it by hand in C: the same lines, blocks and interpolation as those of our source. */
#ifndef NOISE_H
#define NOISE_H

#include <stdio.h>

typedef struct Noise Noise;

/* From a file that c_noise.py has written; NULL if it is not complete. */
Noise *noise_read(FILE *file);
void noise_free(Noise *noise);

/* Force and torque at a time (s), (6).  Makes blocks when they are needed, each at once. */
void noise_compute(Noise *noise, double time, double *wrench);

#endif
