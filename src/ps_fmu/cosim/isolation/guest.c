/* The process of one FMU: loads its library and carries out what the master writes into the shared memory. */

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <fenv.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "../native/control_word.h"
#include "channel.h"
#include "fmi2FunctionTypes.h"
#include "waiting.h"

enum { SLEEP_NS = 500000000, LOOK_EVERY = 1024 };

#define USED(X)                                                                                                        \
    X(Instantiate) X(FreeInstance) X(SetDebugLogging) X(SetupExperiment) X(EnterInitializationMode)                    \
    X(ExitInitializationMode) X(Terminate) X(Reset) X(SetReal) X(SetInteger) X(SetBoolean) X(SetString) X(GetReal)     \
    X(GetInteger) X(GetBoolean) X(GetString) X(DoStep) X(CancelStep) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate)     \
    X(SerializedFMUstateSize) X(SerializeFMUstate) X(DeSerializeFMUstate) X(GetDirectionalDerivative)                  \
    X(SetRealInputDerivatives) X(GetRealOutputDerivatives) X(GetStatus) X(GetRealStatus) X(GetIntegerStatus)           \
    X(GetBooleanStatus) X(GetStringStatus)

#define POINTER(name) static fmi2##name##TYPE *do##name;
USED(POINTER)
#undef POINTER

static Channel *channel;
static fmi2Component instance;
static pid_t master;
static int rounding, canary;
static unsigned long control_word;
static struct sigaction handlers[NSIG];
static char folder[PATH_MAX];

/* ---- messages -------------------------------------------------------------------------------------------------- */

static void store_message(int status, const char *category, const char *text)
{
    const size_t category_bytes = strlen(category) + 1, text_bytes = strlen(text) + 1;
    const size_t bytes = sizeof(int32_t) + category_bytes + text_bytes;
    if (bytes > LOG_BYTES - channel->log_used) /* the first messages of a batch say most */
        return;
    char *end = channel->log + channel->log_used;
    const int32_t number = status;
    memcpy(end, &number, sizeof number);
    memcpy(end + sizeof number, category, category_bytes);
    memcpy(end + sizeof number + category_bytes, text, text_bytes);
    channel->log_used += (uint32_t)bytes;
}

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)environment, (void)name;
    char text[4096] = "";
    va_list arguments;
    va_start(arguments, message);
    if (message != NULL)
        vsnprintf(text, sizeof text, message, arguments);
    va_end(arguments);
    store_message((int)status, category != NULL ? category : "", text);
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

/* ---- what an FMU leaves alone ---------------------------------------------------------------------------------- */

static void keep_environment(void)
{
    rounding = fegetround();
    control_word = read_control_word();
    canary = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
    for (int k = 1; k < NSIG; k++)
        sigaction(k, NULL, &handlers[k]);
    if (getcwd(folder, sizeof folder) == NULL)
        folder[0] = '\0';
}

static void check_control_word(void)
{
    static bool told;
    if (put_control_word_back(control_word) && !told) {
        store_message(fmi2Warning, "isolation",
                      "changed the control word of the processor (flush-to-zero, as code of -ffast-math does), "
                      "which was put back");
        told = true;
    }
}

/* After each batch: 0.2 us. */
static Change find_change(void)
{
    if (fegetround() != rounding) {
        fesetround(rounding);
        return ROUNDING;
    }
    check_control_word();
    if (canary >= 0 && fcntl(canary, F_GETFD) == -1 && errno == EBADF) {
        canary = -1;
        return DESCRIPTORS;
    }
    return UNCHANGED;
}

/* Changes that are without effect outside of this process: the user should know about them. */
static void tell_harmless_changes(void)
{
    char now[PATH_MAX], text[PATH_MAX + 100];
    for (int k = 1; k < NSIG; k++) {
        struct sigaction handler;
        if (sigaction(k, NULL, &handler) != 0 || handler.sa_handler == handlers[k].sa_handler)
            continue;
        handlers[k] = handler;
        snprintf(text, sizeof text, "changed the handler of signal %d (%s) of its process", k, strsignal(k));
        store_message(fmi2Warning, "isolation", text);
    }
    if (getcwd(now, sizeof now) != NULL && strcmp(now, folder) != 0) {
        strcpy(folder, now);
        snprintf(text, sizeof text, "changed the working directory of its process to %s", now);
        store_message(fmi2Warning, "isolation", text);
    }
}

/* ---- operations ------------------------------------------------------------------------------------------------ */

static void *at(uint64_t place)
{
    return channel->data + place;
}

static bool load(const char *library)
{
    void *handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    check_control_word();
    if (handle == NULL) {
        store_message(fmi2Error, "isolation", dlerror());
        return false;
    }
#define LOAD(name) *(void **)&do##name = dlsym(handle, "fmi2" #name);
    USED(LOAD)
#undef LOAD
    return true;
}

static int instantiate(const Operation *o)
{
    const char *name = at(o->first), *guid = name + strlen(name) + 1, *location = guid + strlen(guid) + 1;
    if (doInstantiate == NULL && !load(location + strlen(location) + 1))
        return fmi2Error;
    if (doInstantiate == NULL || doFreeInstance == NULL || doDoStep == NULL) {
        store_message(fmi2Error, "isolation", "the library lacks functions of FMI 2.0 for co-simulation");
        return fmi2Error;
    }
    instance = doInstantiate(name, fmi2CoSimulation, guid, location, &callbacks, (int)o->whole[0], (int)o->whole[1]);
    return instance == NULL ? fmi2Error : fmi2OK;
}

/* The strings one behind the other in the third array. */
static int put_strings(Operation *o, const fmi2String *strings, size_t n)
{
    char *end = at(o->third), *const limit = end + o->size;
    for (size_t k = 0; k < n; k++) {
        const char *text = strings[k] != NULL ? strings[k] : "";
        const size_t bytes = strlen(text) + 1;
        if (bytes > (size_t)(limit - end)) {
            store_message(fmi2Error, "isolation", "the strings are too long for the shared memory");
            return fmi2Error;
        }
        memcpy(end, text, bytes);
        end += bytes;
    }
    return fmi2OK;
}

static int get_strings(Operation *o)
{
    fmi2String *strings = calloc(o->count + 1, sizeof *strings);
    int status = (int)doGetString(instance, at(o->first), o->count, strings);
    if (status <= fmi2Warning && put_strings(o, strings, o->count) != fmi2OK)
        status = fmi2Error;
    free(strings);
    return status;
}

static int set_strings(const Operation *o)
{
    fmi2String *strings = calloc(o->count + 1, sizeof *strings);
    const char *text = at(o->second);
    for (size_t k = 0; k < o->count; k++, text += strlen(text) + 1)
        strings[k] = text;
    const int status = (int)doSetString(instance, at(o->first), o->count, strings);
    free(strings);
    return status;
}

static int set_logging(const Operation *o)
{
    fmi2String *categories = calloc(o->count + 1, sizeof *categories);
    const char *text = at(o->first);
    for (size_t k = 0; k < o->count; k++, text += strlen(text) + 1)
        categories[k] = text;
    const int status = (int)doSetDebugLogging(instance, (int)o->whole[0], o->count, categories);
    free(categories);
    return status;
}

static int get_string_status(Operation *o)
{
    fmi2String text = NULL;
    const int status = (int)doGetStringStatus(instance, (fmi2StatusKind)o->whole[0], &text);
    return status <= fmi2Warning && put_strings(o, &text, 1) != fmi2OK ? fmi2Error : status;
}

/* A state is a pointer of the FMU, which the master keeps as a number. */
static int with_state(Operation *o)
{
    fmi2FMUstate state = (fmi2FMUstate)(uintptr_t)o->whole[0];
    size_t size = 0;
    int status = fmi2Error;
    switch ((Kind)o->kind) {
    case GET_STATE: status = (int)doGetFMUstate(instance, &state); break;
    case SET_STATE: status = (int)doSetFMUstate(instance, state); break;
    case FREE_STATE: status = (int)doFreeFMUstate(instance, &state); break;
    case STATE_SIZE: status = (int)doSerializedFMUstateSize(instance, state, &size); break;
    case SERIALIZE_STATE: status = (int)doSerializeFMUstate(instance, state, at(o->first), o->size); break;
    case DESERIALIZE_STATE: status = (int)doDeSerializeFMUstate(instance, at(o->first), o->size, &state); break;
    default: break;
    }
    o->whole[0] = (uint64_t)(uintptr_t)state;
    o->whole[1] = size;
    return status;
}

static int free_instance(void)
{
    doFreeInstance(instance);
    instance = NULL;
    return fmi2OK;
}

static bool is_missing(Kind kind)
{
    void *const functions[N_KINDS] = {
        doInstantiate, doFreeInstance, doSetDebugLogging, doSetupExperiment, doEnterInitializationMode,
        doExitInitializationMode, doTerminate, doReset, doSetReal, doSetInteger, doSetBoolean, doSetString, doGetReal,
        doGetInteger, doGetBoolean, doGetString, doDoStep, doCancelStep, doGetFMUstate, doSetFMUstate, doFreeFMUstate,
        doSerializedFMUstateSize, doSerializeFMUstate, doDeSerializeFMUstate, doGetDirectionalDerivative,
        doSetRealInputDerivatives, doGetRealOutputDerivatives, doGetStatus, doGetRealStatus, doGetIntegerStatus,
        doGetBooleanStatus, doGetStringStatus, NULL};
    return kind != INSTANTIATE && functions[kind] == NULL;
}

static int carry_out(Operation *o)
{
    const uint64_t n = o->count;
    if (is_missing((Kind)o->kind)) {
        store_message(fmi2Error, "isolation", "the library has no such function");
        return fmi2Error;
    }
    switch ((Kind)o->kind) {
    case SET_REAL: return (int)doSetReal(instance, at(o->first), n, at(o->second));
    case SET_INTEGER: return (int)doSetInteger(instance, at(o->first), n, at(o->second));
    case SET_BOOLEAN: return (int)doSetBoolean(instance, at(o->first), n, at(o->second));
    case SET_STRING: return set_strings(o);
    case GET_REAL: return (int)doGetReal(instance, at(o->first), n, at(o->second));
    case GET_INTEGER: return (int)doGetInteger(instance, at(o->first), n, at(o->second));
    case GET_BOOLEAN: return (int)doGetBoolean(instance, at(o->first), n, at(o->second));
    case GET_STRING: return get_strings(o);
    case DO_STEP: return (int)doDoStep(instance, o->real[0], o->real[1], (int)o->whole[0]);
    case CANCEL_STEP: return (int)doCancelStep(instance);
    case INSTANTIATE: return instantiate(o);
    case FREE_INSTANCE: return free_instance();
    case SET_DEBUG_LOGGING: return set_logging(o);
    case SETUP_EXPERIMENT:
        return (int)doSetupExperiment(
            instance, (int)o->whole[0], o->real[0], o->real[1], (int)o->whole[1], o->real[2]);
    case ENTER_INITIALIZATION: return (int)doEnterInitializationMode(instance);
    case EXIT_INITIALIZATION: return (int)doExitInitializationMode(instance);
    case TERMINATE: return (int)doTerminate(instance);
    case RESET: return (int)doReset(instance);
    case GET_STATE: case SET_STATE: case FREE_STATE: case STATE_SIZE: case SERIALIZE_STATE: case DESERIALIZE_STATE:
        return with_state(o);
    case DIRECTIONAL_DERIVATIVE: { /* seed behind the known references, result behind the unknown ones */
        const uint32_t *unknown = at(o->first), *known = at(o->second);
        double *numbers = at(o->third);
        return (int)doGetDirectionalDerivative(instance, unknown, n, known, o->size, numbers, numbers + o->size);
    }
    case SET_INPUT_DERIVATIVES:
        return (int)doSetRealInputDerivatives(instance, at(o->first), n, at(o->second), at(o->third));
    case GET_OUTPUT_DERIVATIVES:
        return (int)doGetRealOutputDerivatives(instance, at(o->first), n, at(o->second), at(o->third));
    case GET_STATUS: return (int)doGetStatus(instance, (fmi2StatusKind)o->whole[0], at(o->first));
    case GET_REAL_STATUS: return (int)doGetRealStatus(instance, (fmi2StatusKind)o->whole[0], at(o->first));
    case GET_INTEGER_STATUS: return (int)doGetIntegerStatus(instance, (fmi2StatusKind)o->whole[0], at(o->first));
    case GET_BOOLEAN_STATUS: return (int)doGetBooleanStatus(instance, (fmi2StatusKind)o->whole[0], at(o->first));
    case GET_STRING_STATUS: return get_string_status(o);
    case QUIT: case N_KINDS: break;
    }
    return fmi2Error;
}

/* ---- the process ----------------------------------------------------------------------------------------------- */

/* The FMU goes with its master, also when that is killed, and takes along the processes that it has started.  A signal
   of the kernel (PR_SET_PDEATHSIG) would come already at the end of the thread that started this process. */
static void *watch_master(void *unused)
{
    const struct timespec pause = {0, 200000000};
    while (getppid() == master)
        nanosleep(&pause, NULL);
    kill(0, SIGKILL);
    return unused;
}

static bool is_copy;

static void note_copy(void)
{
    is_copy = true;
}

/* A copy of this process, which the FMU has made by fork(), would serve the master as well. */
static void end_copy(void)
{
    static const char text[] = "a copy of the process, made by fork(), came back from the call, and was ended\n";
    _exit(write(STDERR_FILENO, text, sizeof text - 1) < 0 ? 2 : 1);
}

static void run_batch(bool look)
{
    for (uint32_t k = 0; k < channel->n_operations; k++) {
        Operation *o = &channel->operations[k];
        channel->doing = k;
        if (o->kind == QUIT)
            _exit(0); /* no destructors: some libraries crash in theirs, and nobody needs their memory back */
        o->status = carry_out(o);
        if (is_copy)
            end_copy();
        if ((channel->changed = find_change()) != UNCHANGED || o->status > fmi2Warning)
            break;
        look = look || o->kind < SET_REAL;
    }
    if (look)
        tell_harmless_changes();
}

/* Serve the master until it says QUIT or is gone.  `spin_ns`: how long to wait for work before sleeping. */
__attribute__((visibility("default"))) void serve_isolated(void *memory, int parent, int64_t spin_ns)
{
    const struct rlimit none = {0, 0};
    pthread_t watch;
    Patience patience = {0};
    channel = memory;
    master = parent;
    setrlimit(RLIMIT_CORE, &none); /* the signal tells of a crash */
    if (pthread_create(&watch, NULL, watch_master, NULL) != 0)
        _exit(1);
    keep_environment();
    pthread_atfork(NULL, NULL, note_copy);
    for (uint32_t number = 1;; number++) {
        if (!spin(&channel->posted, number, spin_ns, &patience))
            while (__atomic_load_n(&channel->posted, __ATOMIC_ACQUIRE) != number)
                sleep_on(&channel->posted, number - 1, &channel->guest_sleeps, SLEEP_NS);
        run_batch(number % LOOK_EVERY == 0);
        tell(&channel->done, number, &channel->master_sleeps);
    }
}
