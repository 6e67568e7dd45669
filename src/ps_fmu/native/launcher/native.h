/* Calls that need no Python: plain steps, and access to numbers, on the words that a slave shares (core.h). */
#ifndef PS_FMU_NATIVE_H
#define PS_FMU_NATIVE_H

#include "instance.h"

/* Have the slave of an instance tell where its words are.  Where it does not, all calls go to it. */
void native_bind(Instance *m);

/* Each of these does all of a call, or nothing: false, and the call has to be made in Python.  So there are no errors
   here, and no messages. */
bool native_step(Instance *m, double time, double step);
bool native_GetReal(const Instance *m, const fmi2ValueReference vr[], size_t n, fmi2Real value[]);
bool native_GetInteger(const Instance *m, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]);
bool native_GetBoolean(const Instance *m, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]);
bool native_SetReal(const Instance *m, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]);
bool native_SetInteger(const Instance *m, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]);
bool native_SetBoolean(const Instance *m, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]);

/* The derivative of some unknowns by some knowns in a direction, see core.h.  NULL, or what is wrong; NOT_PROVIDED: the FMU
   has the variables, but not this derivative. */
extern const char NOT_PROVIDED[];
const char *native_differentiate(const Instance *m, const fmi2ValueReference unknown[], size_t n_unknown,
                                 const fmi2ValueReference known[], size_t n_known, const fmi2Real direction[],
                                 fmi2Real result[]);

/* Whether it needs Python first: LINEAR_REFERENCE. */
bool native_needs_linear(const Instance *m);

/* End of the last successful step; NaN if that is not known. */
double native_time(const Instance *m);

/* For tests and measurements: how many steps an instance has made natively, and how many in Python, since it was made
   or reset.  fmi2Error if it makes all in Python and nobody counts. */
FMI2_Export fmi2Status ps_fmu_steps(fmi2Component c, int64_t *native, int64_t *python);

#endif
