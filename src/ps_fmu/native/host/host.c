/* The life of an FMU for co-simulation in a program that knows FMI 2.0 and no particular FMU.

   host TASK REPORT      the files are described in task.h and report.h

   Exit code: 0 unless a stage failed that no other can follow.  Messages of the FMU go to stderr. */
#include <dlfcn.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "task.h"
#include "report.h"
#include "settings.h"

#define USED(X)                                                                                                        \
    X(GetVersion) X(GetTypesPlatform) X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode)     \
    X(ExitInitializationMode) X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) X(GetString) X(SetReal)     \
    X(SetInteger) X(SetBoolean) X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize)   \
    X(SerializeFMUstate) X(DeSerializeFMUstate) X(DoStep)

#define POINTER(name) static fmi2##name##TYPE *fmi2##name;
USED(POINTER)
#undef POINTER

static const char *const unused[] = { /* section 2.3: all functions have to be there */
    "fmi2SetDebugLogging", "fmi2GetDirectionalDerivative", "fmi2SetRealInputDerivatives",
    "fmi2GetRealOutputDerivatives", "fmi2CancelStep", "fmi2GetStatus", "fmi2GetRealStatus", "fmi2GetIntegerStatus",
    "fmi2GetBooleanStatus", "fmi2GetStringStatus",
};

enum { STEPS = 10 };

/* Values of all outputs. */
typedef struct {
    fmi2Real *reals;
    fmi2Integer *integers;
    fmi2Boolean *booleans;
    char **strings;
} Values;

static Task task;

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)environment;
    va_list arguments;
    fprintf(stderr, "%s, status %d, %s: ", name != NULL ? name : "?", (int)status, category != NULL ? category : "-");
    va_start(arguments, message);
    vfprintf(stderr, message, arguments); /* the message is a printf format */
    va_end(arguments);
    fputc('\n', stderr);
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

static void check(fmi2Status status, const char *function)
{
    static const char *const names[] = {"fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending"};
    if (status != fmi2OK && status != fmi2Warning)
        report_failure("%s answers %s", function, status <= fmi2Pending ? names[status] : "with no status of FMI 2.0");
}

#define CALL(function, ...) check(function(__VA_ARGS__), #function)

static void *load(void)
{
    void *library = dlopen(task.library, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL)
        report_failure("%s", dlerror());
    char missing[1024] = "";
#define LOAD(name)                                                                                                     \
    if ((*(void **)&fmi2##name = dlsym(library, "fmi2" #name)) == NULL)                                                \
        strncat(missing, " fmi2" #name, sizeof missing - strlen(missing) - 1);
    USED(LOAD)
#undef LOAD
    if (missing[0] != '\0')
        report_failure("the library lacks%s", missing);
    if (strcmp(fmi2GetVersion(), "2.0") != 0 || strcmp(fmi2GetTypesPlatform(), "default") != 0)
        report_failure("the library is for FMI %s with the types of platform %s, expected 2.0 and default",
                       fmi2GetVersion(), fmi2GetTypesPlatform());
    for (size_t k = 0; k < sizeof unused / sizeof *unused; k++) {
        if (dlsym(library, unused[k]) != NULL)
            continue;
        strncat(missing, " ", sizeof missing - strlen(missing) - 1);
        strncat(missing, unused[k], sizeof missing - strlen(missing) - 1);
    }
    if (missing[0] != '\0')
        report_note("the library lacks%s, which need not work but have to be there (FMI 2.0.4, section 2.3)", missing);
    return library;
}

/* scheme: what comes before the absolute path of the resources. */
static fmi2Component instantiate(const char *name, const char *scheme)
{
    char *uri = malloc(strlen(scheme) + strlen(task.resources) + 1);
    strcat(strcpy(uri, scheme), task.resources);
    fmi2Component instance = fmi2Instantiate(name, fmi2CoSimulation, task.guid, uri, &callbacks, fmi2False, fmi2True);
    if (instance == NULL)
        report_failure("fmi2Instantiate returns no instance (resources at %s)", uri);
    free(uri);
    return instance;
}

static Values new_values(void)
{
    const Variables *v = task.outputs;
    Values values = {
        calloc(v[REAL].n + 1, sizeof(fmi2Real)),
        calloc(v[INTEGER].n + 1, sizeof(fmi2Integer)),
        calloc(v[BOOLEAN].n + 1, sizeof(fmi2Boolean)),
        calloc(v[STRING].n + 1, sizeof(char *)),
    };
    return values;
}

static void read_outputs(fmi2Component instance, Values *values)
{
    const Variables *v = task.outputs;
    if (v[REAL].n > 0)
        CALL(fmi2GetReal, instance, v[REAL].references, v[REAL].n, values->reals);
    if (v[INTEGER].n > 0)
        CALL(fmi2GetInteger, instance, v[INTEGER].references, v[INTEGER].n, values->integers);
    if (v[BOOLEAN].n > 0)
        CALL(fmi2GetBoolean, instance, v[BOOLEAN].references, v[BOOLEAN].n, values->booleans);
    if (v[STRING].n > 0) {
        fmi2String *strings = calloc(v[STRING].n, sizeof *strings);
        CALL(fmi2GetString, instance, v[STRING].references, v[STRING].n, strings);
        for (size_t k = 0; k < v[STRING].n; k++) {
            free(values->strings[k]);
            values->strings[k] = strdup(strings[k] != NULL ? strings[k] : "");
        }
        free(strings);
    }
    for (size_t k = 0; k < v[REAL].n; k++)
        if (!isfinite(values->reals[k]))
            report_failure("output %s is not finite", v[REAL].texts[k]);
}

static void expect_same(const Values *values, const Values *expected, const char *when)
{
    const Variables *v = task.outputs;
    for (size_t k = 0; k < v[REAL].n; k++)
        if (values->reals[k] != expected->reals[k])
            report_failure("%s: output %s is %.17g, before it was %.17g", when, v[REAL].texts[k], values->reals[k],
                           expected->reals[k]);
    for (size_t k = 0; k < v[INTEGER].n; k++)
        if (values->integers[k] != expected->integers[k])
            report_failure("%s: output %s is %d, before it was %d", when, v[INTEGER].texts[k], values->integers[k],
                           expected->integers[k]);
    for (size_t k = 0; k < v[BOOLEAN].n; k++)
        if (values->booleans[k] != expected->booleans[k])
            report_failure("%s: output %s is %d, before it was %d", when, v[BOOLEAN].texts[k], values->booleans[k],
                           expected->booleans[k]);
    for (size_t k = 0; k < v[STRING].n; k++)
        if (strcmp(values->strings[k], expected->strings[k]) != 0)
            report_failure("%s: output %s is '%s', before it was '%s'", when, v[STRING].texts[k], values->strings[k],
                           expected->strings[k]);
}

static bool has_inputs(void)
{
    size_t n = 0;
    for (int k = 0; k < N_TYPES; k++)
        n += task.inputs[k].n;
    return n > 0;
}

/* Inputs to their start values. */
static void set_inputs(fmi2Component instance)
{
    const Variables *v = task.inputs;
    for (size_t k = 0; k < v[REAL].n; k++) {
        fmi2Real value = atof(v[REAL].texts[k]);
        CALL(fmi2SetReal, instance, &v[REAL].references[k], 1, &value);
    }
    for (size_t k = 0; k < v[INTEGER].n; k++) {
        fmi2Integer value = atoi(v[INTEGER].texts[k]);
        CALL(fmi2SetInteger, instance, &v[INTEGER].references[k], 1, &value);
    }
    for (size_t k = 0; k < v[BOOLEAN].n; k++) {
        fmi2Boolean value = strcmp(v[BOOLEAN].texts[k], "true") == 0 || strcmp(v[BOOLEAN].texts[k], "1") == 0;
        CALL(fmi2SetBoolean, instance, &v[BOOLEAN].references[k], 1, &value);
    }
    for (size_t k = 0; k < v[STRING].n; k++) {
        fmi2String value = v[STRING].texts[k];
        CALL(fmi2SetString, instance, &v[STRING].references[k], 1, &value);
    }
}

static void initialise(fmi2Component instance, bool with_inputs)
{
    CALL(fmi2SetupExperiment, instance, fmi2False, 0.0, task.start, fmi2False, 0.0);
    CALL(fmi2EnterInitializationMode, instance);
    if (with_inputs)
        set_inputs(instance);
    CALL(fmi2ExitInitializationMode, instance);
}

static void steps(fmi2Component instance, int first, int n, bool with_inputs)
{
    for (int k = first; k < first + n; k++) {
        if (with_inputs)
            set_inputs(instance);
        CALL(fmi2DoStep, instance, task.start + k * task.step, task.step, fmi2True);
    }
}

/* A run from the start gives the same outputs as the run before. */
static void run_again(fmi2Component instance, bool with_inputs, const Values *begin, const Values *end)
{
    Values values = new_values();
    initialise(instance, with_inputs);
    read_outputs(instance, &values);
    expect_same(&values, begin, "after initialisation");
    steps(instance, 0, STEPS, with_inputs);
    read_outputs(instance, &values);
    expect_same(&values, end, "after the steps");
}

/* Make steps, set the state back, and make them again in the same instance. */
static void set_back(fmi2Component instance)
{
    fmi2FMUstate state = NULL;
    Values expected = new_values(), values = new_values();
    CALL(fmi2GetFMUstate, instance, &state);
    steps(instance, STEPS, STEPS, true);
    read_outputs(instance, &expected);
    CALL(fmi2SetFMUstate, instance, state);
    steps(instance, STEPS, STEPS, true);
    read_outputs(instance, &values);
    expect_same(&values, &expected, "the same steps from the same state");
    CALL(fmi2SetFMUstate, instance, state);
    CALL(fmi2FreeFMUstate, instance, &state);
    if (state != NULL)
        report_note("fmi2FreeFMUstate does not set the state to NULL");
}

/* Move the state as bytes to another instance, or to the same one: both continue with the same outputs. */
static void carry_over(fmi2Component instance, fmi2Component other)
{
    fmi2FMUstate state = NULL, copy = NULL;
    size_t size = 0;
    Values expected = new_values(), values = new_values();
    CALL(fmi2GetFMUstate, instance, &state);
    CALL(fmi2SerializedFMUstateSize, instance, state, &size);
    fmi2Byte *bytes = calloc(size + 1, 1);
    CALL(fmi2SerializeFMUstate, instance, state, bytes, size);
    CALL(fmi2FreeFMUstate, instance, &state);
    steps(instance, STEPS, STEPS, true);
    read_outputs(instance, &expected);
    CALL(fmi2DeSerializeFMUstate, other, bytes, size, &copy);
    memset(bytes, 0, size);
    CALL(fmi2SetFMUstate, other, copy);
    CALL(fmi2FreeFMUstate, other, &copy);
    steps(other, STEPS, STEPS, true);
    read_outputs(other, &values);
    expect_same(&values, &expected, "the same steps from the state as bytes");
    free(bytes);
}

static void live(void)
{
    Values begin = new_values(), end = new_values(), values = new_values();
    fmi2Component first = instantiate("first", "file://"), second = NULL;
    report_stage("initialise");
    initialise(first, true);
    read_outputs(first, &begin);
    report_stage("steps");
    steps(first, 0, STEPS, true);
    read_outputs(first, &end);
    if (!task.once) {
        report_stage("second instance");
        second = instantiate("second", "file://");
        run_again(second, true, &begin, &end);
        read_outputs(first, &values);
        expect_same(&values, &end, "the first instance, which made no step");
    }
    if (task.state) {
        report_stage("get and set state");
        set_back(first);
    }
    if (task.state && task.serialise) {
        report_stage("serialise state");
        carry_over(first, task.once ? first : second);
    }
    report_stage("reset");
    CALL(fmi2Reset, first);
    run_again(first, true, &begin, &end);
    if (has_inputs()) {
        report_stage("inputs never set");
        CALL(fmi2Reset, first);
        run_again(first, false, &begin, &end);
    }
    report_stage("terminate and free");
    CALL(fmi2Terminate, first);
    fmi2FreeInstance(first);
    if (second != NULL) {
        CALL(fmi2Terminate, second);
        fmi2FreeInstance(second);
    }
    if (!task.once) {
        report_stage("resources at file:/"); /* section 2.1.5: with and without an authority */
        first = instantiate("third", "file:");
        run_again(first, true, &begin, &end);
        CALL(fmi2Terminate, first);
        fmi2FreeInstance(first);
    }
}

int main(int argc, char **argv)
{
    const struct rlimit none = {0, 0};
    setrlimit(RLIMIT_CORE, &none); /* the signal reports a crash */
    if (argc != 3 || !task_read(argv[1], &task) || !report_open(argv[2])) {
        fprintf(stderr, "usage: host TASK REPORT\n");
        return 2;
    }
    settings_keep();
    report_stage("load");
    void *library = load();
    report_stage("instantiate");
    live();
    report_stage("unload");
    if (dlclose(library) != 0)
        report_failure("%s", dlerror());
    report_stage("host unchanged");
    const char *changed = settings_changed();
    if (changed != NULL)
        report_note("the FMU changed %s, which belongs to the host", changed);
    report_stage("end of the process");
    return 0;
}
