/* How long each single step of an FMU takes in a host written in C.

   host LIBRARY RESOURCES GUID STEP STEPS PARAMETERS INPUTS

   RESOURCES is a URI, STEP is in s.  PARAMETERS are "type:reference:value" with blanks between them and in no value; the
   type is Real, Boolean or String.  INPUTS are "reference:value:slope", all Real: before step k, value + k slope is set.
   Writes one double for each step: how long fmi2SetReal and fmi2DoStep take together, in us; then one: how many of all
   steps were made in Python.

   By the clock on the wall, which adds 0.05 us to a step; that of the thread's processor time is a call of the kernel and
   adds 0.4.  So other processes are in it, and of several runs the least time of each step is its own. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

#define FUNCTIONS(X)                                                                                                   \
    X(Instantiate) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) X(DoStep) X(SetReal)        \
    X(SetBoolean) X(SetString)
#define POINTER(name) static fmi2##name##TYPE *fmi2##name;
FUNCTIONS(POINTER)
static fmi2Status (*ps_fmu_steps)(fmi2Component, int64_t *native, int64_t *python);

enum { MOST = 64 };

static void fail(const char *what)
{
    fprintf(stderr, "host: %s\n", what);
    _exit(1);
}

#define EXPECT(condition) ((condition) ? (void)0 : fail(#condition))

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)environment, (void)status, (void)category;
    fprintf(stderr, "%s: %s\n", name, message);
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e6 + (double)time.tv_nsec * 1e-3;
}

static void set_parameter(fmi2Component instance, const char *type, fmi2ValueReference reference, const char *value)
{
    if (strcmp(type, "Real") == 0) {
        double number = atof(value);
        EXPECT(fmi2SetReal(instance, &reference, 1, &number) == fmi2OK);
    } else if (strcmp(type, "Boolean") == 0) {
        fmi2Boolean is_true = strcmp(value, "True") == 0;
        EXPECT(fmi2SetBoolean(instance, &reference, 1, &is_true) == fmi2OK);
    } else {
        EXPECT(strcmp(type, "String") == 0);
        EXPECT(fmi2SetString(instance, &reference, 1, &value) == fmi2OK);
    }
}

int main(int argc, char **argv)
{
    EXPECT(argc == 8);
    double step = atof(argv[4]);
    long steps = atol(argv[5]);
    int used;
    fmi2ValueReference inputs[MOST], parameter;
    double first[MOST], slope[MOST], values[MOST];
    char type[8], value[1024];
    size_t n = 0;

    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL)
        fail(dlerror());
#define LOAD(name) EXPECT((*(void **)&fmi2##name = dlsym(library, "fmi2" #name)) != NULL);
    FUNCTIONS(LOAD)
    EXPECT((*(void **)&ps_fmu_steps = dlsym(library, "ps_fmu_steps")) != NULL);
    fmi2Component instance = fmi2Instantiate("host", fmi2CoSimulation, argv[3], argv[2], &callbacks, 0, 1);
    EXPECT(instance != NULL);
    for (const char *text = argv[6]; sscanf(text, " %7[^:]:%u:%1023s%n", type, &parameter, value, &used) == 3; text += used)
        set_parameter(instance, type, parameter, value);
    for (const char *text = argv[7];
         n < MOST && sscanf(text, "%u:%lf:%lf%n", &inputs[n], &first[n], &slope[n], &used) == 3; text += used)
        n++;
    EXPECT(fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
    EXPECT(fmi2EnterInitializationMode(instance) == fmi2OK);
    EXPECT(fmi2ExitInitializationMode(instance) == fmi2OK);

    double *costs = calloc((size_t)steps + 1, sizeof *costs);
    EXPECT(costs != NULL);
    for (long k = 0; k < steps; k++) {
        for (size_t i = 0; i < n; i++)
            values[i] = first[i] + (double)k * slope[i];
        double begin = now();
        EXPECT(fmi2SetReal(instance, inputs, n, values) == fmi2OK);
        EXPECT(fmi2DoStep(instance, (double)k * step, step, fmi2True) == fmi2OK);
        costs[k] = now() - begin;
    }
    int64_t native, python;
    EXPECT(ps_fmu_steps(instance, &native, &python) == fmi2OK && native + python == steps);
    costs[steps] = (double)python;
    EXPECT(fwrite(costs, sizeof *costs, (size_t)steps + 1, stdout) == (size_t)steps + 1);
    fflush(stdout);
    _exit(0);
}
