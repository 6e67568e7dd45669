/* What the hosts in this folder share: FMUs of FMI 2.0 as libraries, their log, and how a host fails. */
#ifndef HOST_FMU_H
#define HOST_FMU_H

#include <stddef.h>

#include "fmi2Functions.h"

/* All of FMI 2.0 for co-simulation but fmi2GetTypesPlatform and fmi2GetVersion. */
#define FUNCTIONS(X)                                                                                                   \
    X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode)             \
    X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) X(GetString) X(SetReal) X(SetInteger) X(SetBoolean)   \
    X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize) X(SerializeFMUstate)          \
    X(DeSerializeFMUstate) X(DoStep) X(SetDebugLogging) X(GetRealStatus) X(GetBooleanStatus) X(GetStatus)              \
    X(GetIntegerStatus) X(GetStringStatus) X(CancelStep) X(GetDirectionalDerivative) X(SetRealInputDerivatives)        \
    X(GetRealOutputDerivatives)

enum { MOST = 128 };

typedef struct {
    char library[1024], uri[1024], guid[128];
    double step;
    fmi2ValueReference inputs[MOST], outputs[MOST];
    size_t n_inputs, n_outputs;
    void *handle;
#define MEMBER(name) fmi2##name##TYPE *name;
    FUNCTIONS(MEMBER)
#undef MEMBER
} Fmu;

extern int leaving; /* exit() is being called: errors are as they have to be */

/* End the process with exit code 1. */
void fail(const char *what) __attribute__((noreturn));

#define EXPECT(condition) ((condition) ? (void)0 : fail(#condition))

/* Read what a host has to know of an FMU, a text file with library=, uri=, guid=, step= (s), inputs= and outputs=
   (value references of Reals, separated by blanks). */
void read_fmu(const char *path, Fmu *fmu);

/* Load the library and look all its functions up. */
void load(Fmu *fmu);

extern const fmi2CallbackFunctions callbacks;

/* An instance with logging on; where there is none, the process ends with exit code 3. */
fmi2Component new_instance(const Fmu *fmu, const char *name);

/* Have a handler for SIGINT; and, later: is it still there, and are locale and environment as they were? */
void handle_signals(void);
void expect_belongings(void);

#endif
