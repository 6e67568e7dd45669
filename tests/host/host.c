/* A small FMI 2.0 host without Python: loads FMUs, runs them in the ways that hosts do, prints what came out.

   host MODE N FMU...     FMU: a text file, see read_fmu

   run      N steps, all FMUs side by side, two instances of each; prints the outputs of the first instances
   reload   N times: load, run ten steps, unload
   faults   all mistakes N times, then reset and ten steps; prints as well by how many kB memory grew over the second
            half of them, and how many that were
   threads  eight threads, each with its own instances, N steps
   leave    exit() while four threads step
   keep     instances and libraries are never freed
   embed    runs Python itself, from the library HOST_LIBPYTHON, which other libraries do not see; finalises it, and
            frees an instance even later
*/
#include "fmu.h"
#include "mistakes.h"

#include <dlfcn.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct {
    Fmu *fmu;
    fmi2Component component;
    double results[MOST];
} Run;

static void instantiate(Run *run, Fmu *fmu)
{
    run->fmu = fmu;
    run->component = new_instance(fmu, "host 100%s");
}

static void initialise(Run *run)
{
    const Fmu *fmu = run->fmu;
    EXPECT(fmu->SetupExperiment(run->component, 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
    EXPECT(fmu->EnterInitializationMode(run->component) == fmi2OK);
    EXPECT(fmu->ExitInitializationMode(run->component) == fmi2OK);
}

static void step(Run *run, long i)
{
    const Fmu *fmu = run->fmu;
    double values[MOST];
    for (size_t k = 0; k < fmu->n_inputs; k++)
        values[k] = sin(0.01 * (double)i + (double)k);
    EXPECT(fmu->SetReal(run->component, fmu->inputs, fmu->n_inputs, values) == fmi2OK);
    EXPECT(fmu->DoStep(run->component, (double)i * fmu->step, fmu->step, fmi2True) == fmi2OK);
    EXPECT(fmu->GetReal(run->component, fmu->outputs, fmu->n_outputs, run->results) == fmi2OK);
}

static void finish(Run *run)
{
    double end;
    EXPECT(run->fmu->GetRealStatus(run->component, fmi2LastSuccessfulTime, &end) == fmi2OK && end > 0.0);
    EXPECT(run->fmu->Terminate(run->component) == fmi2OK);
    run->fmu->FreeInstance(run->component);
}

static void print(const Run *run)
{
    flockfile(stdout); /* a line in one piece: other threads print, too */
    for (size_t k = 0; k < run->fmu->n_outputs; k++)
        printf("%.17g ", run->results[k]);
    printf("\n");
    funlockfile(stdout);
}

static void run_all(Fmu *fmus, int n_fmus, long n, int end)
{
    Run runs[2 * MOST];
    for (int i = 0; i < 2 * n_fmus; i++) {
        instantiate(&runs[i], &fmus[i / 2]);
        initialise(&runs[i]);
    }
    for (long k = 0; k < n; k++)
        for (int i = 0; i < 2 * n_fmus; i++)
            step(&runs[i], k);
    for (int i = 0; i < 2 * n_fmus; i++) {
        EXPECT(memcmp(runs[i].results, runs[i - i % 2].results, fmus[i / 2].n_outputs * sizeof(double)) == 0);
        if (i % 2 == 0)
            print(&runs[i]);
        if (end)
            finish(&runs[i]);
    }
}

static long resident(void)
{
    long size = 0, pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    EXPECT(file != NULL && fscanf(file, "%ld %ld", &size, &pages) == 2);
    fclose(file);
    return pages * sysconf(_SC_PAGESIZE) / 1024;
}

static void states(Run *run)
{
    const Fmu *f = run->fmu;
    fmi2Component c = run->component;
    fmi2FMUstate state = NULL, copy = NULL;
    size_t size = 0;
    EXPECT(f->GetFMUstate(c, &state) == fmi2OK);
    EXPECT(f->GetFMUstate(c, &state) == fmi2OK); /* in place of the first */
    EXPECT(f->SerializedFMUstateSize(c, state, &size) == fmi2OK && size > 0);
    char *bytes = malloc(size);
    EXPECT(f->SerializeFMUstate(c, state, bytes, size - 1) == fmi2Error);
    EXPECT(f->SerializeFMUstate(c, state, bytes, size) == fmi2OK);
    EXPECT(f->DeSerializeFMUstate(c, bytes, size, &copy) == fmi2OK);
    EXPECT(f->SetFMUstate(c, copy) == fmi2OK);
    EXPECT(f->FreeFMUstate(c, &state) == fmi2OK && state == NULL);
    EXPECT(f->FreeFMUstate(c, &state) == fmi2OK);
    EXPECT(f->FreeFMUstate(c, &copy) == fmi2OK);
    EXPECT(f->GetFMUstate(c, &state) == fmi2OK); /* freed with the instance */
    free(bytes);
}

static void faults(Fmu *fmu, long n)
{
    Run run, begun;
    instantiate(&run, fmu);
    initialise(&run);
    instantiate(&begun, fmu);
    for (long i = 0; i < n / 2; i++)
        make_mistakes(fmu, run.component, begun.component);
    long before = resident(), first = mistakes_made();
    for (long i = 0; i < n / 2; i++)
        make_mistakes(fmu, run.component, begun.component);
    long growth = resident() - before, n_made = mistakes_made() - first;
    fmu->FreeInstance(begun.component);
    EXPECT(fmu->Reset(run.component) == fmi2OK);
    initialise(&run);
    states(&run);
    for (long i = 0; i < 10; i++)
        step(&run, i);
    print(&run);
    finish(&run);
    printf("%ld %ld\n", growth, n_made);
}

typedef struct {
    Fmu *fmus;
    int n_fmus;
    long n;
} Work;

static void *work(void *argument)
{
    const Work *w = argument;
    run_all(w->fmus, w->n_fmus, w->n, 1);
    return NULL;
}

static void threads(Work *w, int n_threads, int join)
{
    pthread_t ids[8];
    for (int i = 0; i < n_threads; i++)
        EXPECT(pthread_create(&ids[i], NULL, work, w) == 0);
    for (int i = 0; i < n_threads && join; i++)
        pthread_join(ids[i], NULL);
}

static void embed(Fmu *fmus, int n_fmus, long n)
{
    void (*initialise_python)(int), (*restore)(void *), *(*save)(void);
    int (*finalise)(void);
    void *python = dlopen(getenv("HOST_LIBPYTHON"), RTLD_NOW | RTLD_LOCAL);
    EXPECT(python != NULL);
    *(void **)&initialise_python = dlsym(python, "Py_InitializeEx");
    *(void **)&save = dlsym(python, "PyEval_SaveThread");
    *(void **)&restore = dlsym(python, "PyEval_RestoreThread");
    *(void **)&finalise = dlsym(python, "Py_FinalizeEx");
    initialise_python(0);
    void *state = save();
    Work all = {fmus, n_fmus, n};
    Run late;
    run_all(fmus, n_fmus, n, 1);
    threads(&all, 2, 1);
    instantiate(&late, fmus);
    restore(state);
    EXPECT(finalise() == 0);
    EXPECT(fmus->SetupExperiment(late.component, 0, 0.0, 0.0, 0, 0.0) == fmi2Error);
    fmus->FreeInstance(late.component);
}

int main(int argc, char **argv)
{
    static Fmu fmus[MOST];
    EXPECT(argc >= 4 && argc <= MOST);
    const char *mode = argv[1];
    long n = atol(argv[2]);
    int n_fmus = argc - 3;
    handle_signals();
    for (int i = 0; i < n_fmus; i++)
        read_fmu(argv[3 + i], &fmus[i]);
    if (strcmp(mode, "reload") == 0) {
        for (long k = 0; k < n; k++) {
            for (int i = 0; i < n_fmus; i++)
                load(&fmus[i]);
            run_all(fmus, n_fmus, 10, 1);
            for (int i = 0; i < n_fmus; i++)
                dlclose(fmus[i].handle);
        }
    } else {
        for (int i = 0; i < n_fmus; i++)
            load(&fmus[i]);
        Work all = {fmus, n_fmus, n}, endless = {fmus, n_fmus, 1L << 40};
        if (strcmp(mode, "run") == 0)
            run_all(fmus, n_fmus, n, 1);
        else if (strcmp(mode, "keep") == 0)
            run_all(fmus, n_fmus, n, 0);
        else if (strcmp(mode, "faults") == 0)
            faults(fmus, n);
        else if (strcmp(mode, "embed") == 0) {
            embed(fmus, n_fmus, n);
            return 0; /* locale and handlers are this host's own doing */
        } else if (strcmp(mode, "threads") == 0)
            threads(&all, 8, 1);
        else if (strcmp(mode, "leave") == 0) {
            Run run; /* Python is up before the threads are */
            instantiate(&run, fmus);
            threads(&endless, 4, 0);
            usleep(300000);
            leaving = 1;
            return 0;
        } else
            fail("which mode?");
    }
    expect_belongings();
    return 0;
}
