/* How long each single step of an FMU takes, in a host written in C.

   step_times LIBRARY RESOURCES GUID STEP STEPS PARAMETERS INPUTS

   RESOURCES is a URI, STEP is in s.  PARAMETERS are "reference:value" with blanks between them, INPUTS are
   "reference:value:slope": before step k, value + k slope is set.  All are Reals.  Writes one double for each step: how long
   fmi2SetReal and fmi2DoStep take together, in us.

   By the clock on the wall, which adds 0.05 us to a step; that of the thread's processor time is a call of the kernel and
   adds 0.4.  So other processes are in it, and of several runs the least time of each step is its own. */
#define NAME "step_times"
#define FUNCTIONS(X)                                                                                                   \
    X(Instantiate) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) X(DoStep) X(SetReal)

#include "fmu_host.h"

int main(int argc, char **argv)
{
    EXPECT(argc == 8);
    double step = atof(argv[4]);
    long steps = atol(argv[5]);
    int used;
    fmi2ValueReference references[MOST], parameter;
    double first[MOST], slope[MOST], values[MOST], value;
    size_t n = 0;

    fmi2Component instance = instantiate(argv[1], argv[2], argv[3]);
    for (const char *text = argv[6]; sscanf(text, "%u:%lf%n", &parameter, &value, &used) == 2; text += used)
        EXPECT(fmi2SetReal(instance, &parameter, 1, &value) == fmi2OK);
    for (const char *text = argv[7];
         n < MOST && sscanf(text, "%u:%lf:%lf%n", &references[n], &first[n], &slope[n], &used) == 3; text += used)
        n++;
    initialise(instance);

    double *costs = calloc((size_t)steps, sizeof *costs);
    EXPECT(costs != NULL);
    for (long k = 0; k < steps; k++) {
        for (size_t i = 0; i < n; i++)
            values[i] = first[i] + (double)k * slope[i];
        double begin = now();
        EXPECT(fmi2SetReal(instance, references, n, values) == fmi2OK);
        EXPECT(fmi2DoStep(instance, (double)k * step, step, fmi2True) == fmi2OK);
        costs[k] = now() - begin;
    }
    EXPECT(fwrite(costs, sizeof *costs, (size_t)steps, stdout) == (size_t)steps);
    fflush(stdout);
    _exit(0);
}
