/* A host of one FMU, for programs that time its calls: the functions of the library, messages, the clock.

   NAME is the program's, for messages; FUNCTIONS(X) the functions of FMI 2.0 that it calls, X(Instantiate) first. */

#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

#define POINTER(name) static fmi2##name##TYPE *fmi2##name;
FUNCTIONS(POINTER)
#undef POINTER

enum { MOST = 64 };

static void fail(const char *what)
{
    fprintf(stderr, NAME ": %s\n", what);
    _exit(1);
}

#define EXPECT(condition) ((condition) ? (void)0 : fail(#condition))

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)environment, (void)status, (void)category;
    va_list arguments;
    va_start(arguments, message);
    fprintf(stderr, "%s: ", name);
    vfprintf(stderr, message, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e6 + (double)time.tv_nsec * 1e-3;
}

static fmi2Component instantiate(const char *file, fmi2String resources, fmi2String guid)
{
    void *library = dlopen(file, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL)
        fail(dlerror());
#define LOAD(name) EXPECT((*(void **)&fmi2##name = dlsym(library, "fmi2" #name)) != NULL);
    FUNCTIONS(LOAD)
#undef LOAD
    fmi2Component instance = fmi2Instantiate(NAME, fmi2CoSimulation, guid, resources, &callbacks, 0, 1);
    EXPECT(instance != NULL);
    return instance;
}

static void initialise(fmi2Component instance)
{
    EXPECT(fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
    EXPECT(fmi2EnterInitializationMode(instance) == fmi2OK);
    EXPECT(fmi2ExitInitializationMode(instance) == fmi2OK);
}
