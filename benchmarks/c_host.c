/* What calls of an FMU cost in a host written in C: median over rounds of the mean of a round, in us.

   c_host LIBRARY RESOURCES GUID STEP ROUNDS CALLS INPUTS OUTPUTS

   RESOURCES is a URI, STEP is in s.  INPUTS are "reference:value:value" with blanks between them, whose two values are
   set by turns; OUTPUTS are references.  Prints the costs of fmi2DoStep, of fmi2SetReal of all inputs and of fmi2GetReal
   of all outputs. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

#define FUNCTIONS(X)                                                                                                   \
    X(Instantiate) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) X(DoStep) X(SetReal) X(GetReal)

#define POINTER(name) static fmi2##name##TYPE *fmi2##name;
FUNCTIONS(POINTER)
#undef POINTER

enum { MOST = 64 };

static void fail(const char *what)
{
    fprintf(stderr, "c_host: %s\n", what);
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

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int n)
{
    qsort(values, (size_t)n, sizeof *values, compare);
    return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

int main(int argc, char **argv)
{
    EXPECT(argc == 9);
    double step = atof(argv[4]);
    int rounds = atoi(argv[5]), calls = atoi(argv[6]), used;
    fmi2ValueReference inputs[MOST], outputs[MOST];
    double values[2][MOST], results[MOST];
    size_t n_inputs = 0, n_outputs = 0;
    const char *text = argv[7];
    while (n_inputs < MOST && sscanf(text, "%u:%lf:%lf%n", &inputs[n_inputs], &values[0][n_inputs],
                                     &values[1][n_inputs], &used) == 3) {
        text += used;
        n_inputs++;
    }
    text = argv[8];
    while (n_outputs < MOST && sscanf(text, "%u%n", &outputs[n_outputs], &used) == 1) {
        text += used;
        n_outputs++;
    }

    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL)
        fail(dlerror());
#define LOAD(name) EXPECT((*(void **)&fmi2##name = dlsym(library, "fmi2" #name)) != NULL);
    FUNCTIONS(LOAD)
#undef LOAD
    fmi2Component instance = fmi2Instantiate("c_host", fmi2CoSimulation, argv[3], argv[2], &callbacks, 0, 1);
    EXPECT(instance != NULL);
    EXPECT(fmi2SetupExperiment(instance, 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
    EXPECT(fmi2EnterInitializationMode(instance) == fmi2OK);
    EXPECT(fmi2ExitInitializationMode(instance) == fmi2OK);

    double *costs[3];
    for (int k = 0; k < 3; k++)
        EXPECT((costs[k] = calloc((size_t)rounds, sizeof(double))) != NULL);
    for (long round = 0; round < rounds; round++) {
        double times[4];
        times[0] = now();
        for (long k = round * calls; k < (round + 1) * calls; k++)
            EXPECT(fmi2DoStep(instance, (double)k * step, step, fmi2True) == fmi2OK);
        times[1] = now();
        for (long k = 0; k < calls; k++)
            EXPECT(fmi2SetReal(instance, inputs, n_inputs, values[k % 2]) == fmi2OK);
        times[2] = now();
        for (long k = 0; k < calls; k++)
            EXPECT(fmi2GetReal(instance, outputs, n_outputs, results) == fmi2OK);
        times[3] = now();
        for (int k = 0; k < 3; k++)
            costs[k][round] = (times[k + 1] - times[k]) / calls;
    }
    printf("%.3f %.3f %.3f\n", median(costs[0], rounds), median(costs[1], rounds), median(costs[2], rounds));
    fflush(stdout);
    _exit(0); /* pythonfmu's library alone would abort at exit */
}
