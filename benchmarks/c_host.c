/* What calls of an FMU cost in a host written in C: median over rounds of the mean of a round, in us.

   c_host LIBRARY RESOURCES GUID STEP ROUNDS CALLS INPUTS OUTPUTS

   RESOURCES is a URI, STEP is in s.  INPUTS are "reference:value:value" with blanks between them, whose two values are
   set by turns; OUTPUTS are references.  Prints the costs of fmi2DoStep, of fmi2SetReal of all inputs and of fmi2GetReal
   of all outputs. */
#define NAME "c_host"
#define FUNCTIONS(X)                                                                                                   \
    X(Instantiate) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) X(DoStep) X(SetReal) X(GetReal)

#include "fmu_host.h"

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

    fmi2Component instance = instantiate(argv[1], argv[2], argv[3]);
    initialise(instance);

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
