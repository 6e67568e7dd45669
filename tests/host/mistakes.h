/* Mistakes that hosts make, at each function of FMI 2.0 for co-simulation. */
#ifndef HOST_MISTAKES_H
#define HOST_MISTAKES_H

#include "fmu.h"

/* Every mistake once.  Each has to be refused, and to change nothing.  `stepping` is an instance that makes steps,
   `begun` one that was instantiated and nothing more. */
void make_mistakes(const Fmu *fmu, fmi2Component stepping, fmi2Component begun);

/* How many were made so far; fails if there is a function at which none was. */
long mistakes_made(void);

#endif
