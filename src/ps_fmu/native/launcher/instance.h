/* Instances of an FMU: pythonfmu's behind them, their messages, how they begin and end. */
#ifndef PS_FMU_INSTANCE_H
#define PS_FMU_INSTANCE_H

#include "../kernel/core.h"
#include "text.h"

#include "fmi2Functions.h"

/* The functions of pythonfmu's library that are used. */
#define WRAPPED(X)                                                                                                     \
    X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode)             \
    X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) X(GetString) X(SetReal) X(SetInteger) X(SetBoolean)   \
    X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize) X(SerializeFMUstate)          \
    X(DeSerializeFMUstate) X(DoStep)

typedef struct {
#define MEMBER(name) fmi2##name##TYPE *name;
    WRAPPED(MEMBER)
#undef MEMBER
    void (*finalise)(void);
} Wrapper;

extern Wrapper wrapper; /* filled once an instance has begun */

typedef struct {
    fmi2Component inner;              /* pythonfmu's */
    fmi2CallbackFunctions callbacks;  /* given to pythonfmu */
    fmi2CallbackFunctions host;
    char *name;
    unsigned long generation;         /* of Python */
    Core *core;                       /* words shared with the slave; NULL: none */
    bool logging;
    char **categories;                /* that the host wants; none: all */
    size_t n_categories;
    fmi2FMUstate *states;             /* handed out and not freed yet */
    size_t n_states;
    fmi2Real time;                    /* end of the last step in Python; NaN: a state was set since */
} Instance;

/* Begin an instance.  m has its name, its host and whether it logs.  False with a reason; without one if pythonfmu has
   told it. */
bool instance_begin(Instance *m, const char *guid, const char *uri, fmi2Boolean visible, Text *why);

/* End it, if it has begun, and free all that belongs to it. */
void instance_end(Instance *m);

void instance_forget_categories(Instance *m);

/* What is wrong with two lists of n items, one of them perhaps of places for results; NULL: nothing. */
const char *fault_of_values(size_t n, const void *references, const void *values);

/* Pass a text on to the host, if it logs the category of this status. */
void instance_tell(const Instance *m, fmi2Status status, const char *text);

/* Tell an error of a function, to the host if it listens and in any case on stderr; fmi2Error. */
fmi2Status instance_refuse(const Instance *m, const char *function, const char *reason);

#endif
