/* The process of one FMU: carries out the steps that the master writes into the shared memory; guest.py has the other
   calls. */

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

#include "../loop/control_word.h"
#include "channel.h"
#include "fmi2FunctionTypes.h"
#include "waiting.h"

#define EXPORTED __attribute__((visibility("default")))

enum { SLEEP_NS = 500000000, LOOK_EVERY = 1024 };

static Channel *channel;
static fmi2Component instance;
static pid_t master;
static void *functions[CALL];
static uint32_t number; /* of the batch */
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
    const int32_t severity = status;
    memcpy(end, &severity, sizeof severity);
    memcpy(end + sizeof severity, category, category_bytes);
    memcpy(end + sizeof severity + category_bytes, text, text_bytes);
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

EXPORTED void check_control_word(void)
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

static int carry_out(const Operation *o)
{
    const uint64_t n = o->count;
    const fmi2ValueReference *references = at(o->references);
    void *const function = functions[o->kind], *const values = at(o->values);
    if (function == NULL) {
        store_message(fmi2Error, "isolation", "the library has no such function");
        return fmi2Error;
    }
    switch ((Kind)o->kind) {
    case SET_REAL: return (int)((fmi2SetRealTYPE *)function)(instance, references, n, values);
    case SET_INTEGER: case SET_BOOLEAN: return (int)((fmi2SetIntegerTYPE *)function)(instance, references, n, values);
    case GET_REAL: return (int)((fmi2GetRealTYPE *)function)(instance, references, n, values);
    case GET_INTEGER: case GET_BOOLEAN: return (int)((fmi2GetIntegerTYPE *)function)(instance, references, n, values);
    case SET_DERIVATIVES:
        return (int)((fmi2SetRealInputDerivativesTYPE *)function)(instance, references, n, at(o->orders), values);
    case DO_STEP: return (int)((fmi2DoStepTYPE *)function)(instance, o->time, o->step, (int)o->only_forward);
    case CALL: break;
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

/* After each operation.  Returns whether the batch goes on. */
static bool finish(Operation *o, int status)
{
    o->status = status;
    if (is_copy)
        end_copy();
    channel->changed = find_change();
    return channel->changed == UNCHANGED && status <= fmi2Warning;
}

static void tell_done(bool look)
{
    if (look)
        tell_harmless_changes();
    tell(&channel->done, number, &channel->master_sleeps);
}

/* Once, before the FMU is loaded. */
EXPORTED void begin_guest(void *memory, int parent)
{
    const struct rlimit none = {0, 0};
    pthread_t watch;
    channel = memory;
    master = parent;
    setrlimit(RLIMIT_CORE, &none); /* the signal tells of a crash */
    if (pthread_create(&watch, NULL, watch_master, NULL) != 0)
        _exit(1);
    keep_environment();
    pthread_atfork(NULL, NULL, note_copy);
}

/* The instance, and its functions by Kind; NULL: it has none. */
EXPORTED void set_instance(fmi2Component new, void *const *all)
{
    instance = new;
    memcpy(functions, all, sizeof functions);
}

EXPORTED const fmi2CallbackFunctions *get_callbacks(void)
{
    return &callbacks;
}

EXPORTED void note_error(const char *text)
{
    store_message(fmi2Error, "isolation", text);
}

/* Carry out the steps until the master has a call in the pipe.  `spin_ns`: how long to wait for work before sleeping. */
EXPORTED void serve_steps(int64_t spin_ns)
{
    static Patience patience;
    for (;;) {
        number++;
        if (!spin(&channel->posted, number, spin_ns, &patience))
            while (__atomic_load_n(&channel->posted, __ATOMIC_ACQUIRE) != number)
                sleep_on(&channel->posted, number - 1, &channel->guest_sleeps, SLEEP_NS);
        if (channel->operations[0].kind == CALL)
            return;
        for (uint32_t k = 0; k < channel->n_operations; k++) {
            Operation *o = &channel->operations[k];
            channel->doing = k;
            if (!finish(o, carry_out(o)))
                break;
        }
        tell_done(number % LOOK_EVERY == 0);
    }
}

/* The call of the pipe has returned, with this status. */
EXPORTED void finish_call(int status)
{
    finish(&channel->operations[0], status);
    tell_done(true);
}
