/* A system of FMUs, stepped as ps_fmu.cosim does by the Jacobi scheme. */
#ifndef HOST_WIRED_H
#define HOST_WIRED_H

#include "fmu.h"

enum { MOST_INSTANCES = 8, MOST_VARIABLES = 128, MOST_SETS = 64, MOST_GROUPS = 64 };

/* All outputs, or all connected inputs.  Values of Integers and Booleans are in whole; neighbours counts those from one
   on that one call does for. */
typedef struct {
    size_t n, instance[MOST_VARIABLES], neighbours[MOST_VARIABLES];
    char type[MOST_VARIABLES]; /* R, I, B */
    fmi2ValueReference reference[MOST_VARIABLES];
    fmi2Real real[MOST_VARIABLES];
    fmi2Integer whole[MOST_VARIABLES];
} Variables;

typedef struct {
    long step;
    size_t instance;
    char type[16], value[1024];
    fmi2ValueReference reference;
} Set;

typedef struct {
    int passes;
    size_t n, inputs[MOST_VARIABLES];
} Group;

typedef struct {
    double step;
    long index; /* of the communication point */
    size_t n_instances, n_sets, n_groups, sources[MOST_VARIABLES];
    Fmu fmus[MOST_INSTANCES];
    char names[MOST_INSTANCES][64];
    fmi2Component components[MOST_INSTANCES];
    Variables outputs, inputs;
    Set sets[MOST_SETS];
    Group groups[MOST_GROUPS];
} System;

/* Read a system from a file with lines of words:

       step SECONDS
       fmu NAME PATH                                 an instance, loaded in this order; PATH: see read_fmu
       set STEP INSTANCE TYPE REFERENCE VALUE        before this step; start values: step -1
       output INSTANCE TYPE REFERENCE
       input INSTANCE TYPE REFERENCE OUTPUT          with the output that it is connected to
       initial PASSES INPUT...                       connections that pass initial values on together

   TYPE: Real, Integer, Boolean, String.  Instances, outputs and inputs are counted from 0; outputs of one instance and
   one type are neighbours, and so are inputs. */
void read_system(const char *path, System *s);

void load_all(System *s);
void unload_all(System *s);

/* Instances up to their first communication point, at 0 s, with initial values that agree. */
void begin(System *s);

void advance(System *s, long n);

/* Read all outputs at the communication point. */
void get_outputs(System *s);

/* These outputs as numbers. */
void row(const System *s, double *values);

void end(System *s);

#endif
