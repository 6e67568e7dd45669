/* An FMU in C that misbehaves from 0.05 s on, or in another call than fmi2DoStep: its instance name says how.

   The output y is the time plus the input u; count is the number of steps.  A name that is no fault is a good FMU. */
#include <fenv.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __x86_64__
#include <xmmintrin.h>
#endif

#include "fmi2Functions.h"

void leave_below(void); /* of below.c */

enum { Y = 1, U, COUNT, SQUARE };

typedef struct {
    double time, u;
    int count;
} State;

typedef struct {
    State now;
    char fault[64];
    const fmi2CallbackFunctions *host;
    double successful;
    int ended, asked;
} Instance;

/* As the start-up code that gcc links to what is compiled with -ffast-math. */
static void flush_to_zero(void)
{
#ifdef __x86_64__
    _mm_setcsr(_mm_getcsr() | 0x8040);
#else
    unsigned long word;
    __asm__ volatile("mrs %0, fpcr" : "=r"(word));
    __asm__ volatile("msr fpcr, %0" : : "r"(word | 1 << 24));
#endif
}

static int is(const Instance *m, const char *fault) { return strncmp(m->fault, fault, strlen(fault)) == 0; }

static volatile int forever = 1;
static volatile double half = 0.5;

static void say_hangs(void)
{
    if (write(2, "hangs\n", 6) != 6)
        abort();
}

static void hang(void)
{
    say_hangs();
    while (forever)
        ;
}

static int overflow_stack(volatile int *above)
{
    volatile int here[1024];
    here[0] = *above;
    return overflow_stack(here) + here[1];
}

/* Call exit or _exit in a thread of the FMU's own. */
static void *end_with_0(void *end)
{
    ((void (*)(int))end)(0);
    return NULL;
}

static void end_in_thread(void (*end)(int))
{
    pthread_t thread;
    if (pthread_create(&thread, NULL, end_with_0, (void *)end) == 0)
        pthread_join(thread, NULL);
}

/* A copy of the process ends as it likes. */
static fmi2Status end_copy(void)
{
    int status = 0;
    pid_t child = fork();
    if (child == 0)
        _exit(7);
    return waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 7 ? fmi2OK : fmi2Error;
}

/* The copy goes on as the master would, or ends as the master does. */
static fmi2Status make_copy(int exits)
{
    const pid_t child = fork();
    if (child == 0 && exits)
        exit(0);
    return child == 0 || waitpid(child, NULL, 0) == child ? fmi2OK : fmi2Error;
}

static void log_much(const Instance *m)
{
    for (int k = 0; k < 100000; k++)
        m->host->logger(m->host->componentEnvironment, m->fault, fmi2Warning, "noise", "message %d of %s", k, "many");
}

/* What happens in fmi2DoStep from 0.05 s on; the status that the step returns. */
static fmi2Status misbehave(Instance *m, double time, double step)
{
    volatile int zero = 0;
    volatile int *volatile nowhere = NULL;
    if (is(m, "hang_busy"))
        hang();
    else if (is(m, "hang_asleep"))
        for (say_hangs();;)
            pause();
    else if (is(m, "exit_0"))
        exit(0);
    else if (is(m, "exit_3"))
        exit(3);
    else if (is(m, "quick_exit"))
        quick_exit(0);
    else if (is(m, "immediate_exit"))
        _exit(0);
    else if (is(m, "leaves_below"))
        leave_below();
    else if (is(m, "exit_in_thread"))
        end_in_thread(exit);
    else if (is(m, "leave_in_thread"))
        end_in_thread(_exit);
    else if (is(m, "copy_leaves"))
        return end_copy();
    else if (is(m, "copy_returns") || is(m, "copy_exits"))
        return make_copy(is(m, "copy_exits"));
    else if (is(m, "abort"))
        abort();
    else if (is(m, "segfault"))
        *nowhere = 1;
    else if (is(m, "stack_overflow"))
        m->now.count = overflow_stack((volatile int *)&zero);
    else if (is(m, "illegal_instruction"))
        __builtin_trap();
    else if (is(m, "division"))
        m->now.count = 100 / zero;
    else if (is(m, "double_free")) {
        char *volatile block = malloc(2000), *volatile other = malloc(2000);
        free(block);
        free(block);
        free(other);
    } else if (is(m, "kill"))
        raise(SIGKILL);
    else if (is(m, "rounding"))
        fesetround(FE_UPWARD);
    else if (is(m, "flush_to_zero"))
        flush_to_zero();
    else if (is(m, "descriptors"))
        for (int k = 3; k < 1024; k++)
            close(k);
    else if (is(m, "directory"))
        return chdir("/") == 0 ? fmi2OK : fmi2Error;
    else if (is(m, "handlers"))
        signal(SIGINT, SIG_IGN);
    else if (is(m, "noise")) {
        puts("a line on the standard output");
        fflush(stdout);
    } else if (is(m, "thread_exit"))
        pthread_exit(NULL);
    else if (is(m, "not_a_number"))
        m->now.time = 0.0 / (half - half);
    else if (is(m, "pending"))
        return fmi2Pending;
    else if (is(m, "no_status"))
        return (fmi2Status)99;
    else if (is(m, "fatal"))
        return fmi2Fatal;
    else if (is(m, "messages"))
        log_much(m);
    else if (is(m, "child")) {
        if (fork() == 0)
            for (;;)
                pause();
    } else if (is(m, "discard"))
        return m->successful = time, fmi2Discard;
    else if (is(m, "ended"))
        return m->successful = time, m->ended = 1, fmi2Discard;
    else if (is(m, "almost"))
        return m->successful = time + step - 1e-9, fmi2Discard;
    else if (is(m, "partial") && step > 0.0041)
        return m->now.time += 0.004, m->successful = time + 0.004, fmi2Discard;
    return fmi2OK;
}

static void in(const Instance *m, const char *call)
{
    char fault[64];
    snprintf(fault, sizeof fault, "exit_in_%s", call);
    if (is(m, fault))
        exit(0);
    snprintf(fault, sizeof fault, "copy_in_%s", call);
    if (is(m, fault))
        make_copy(0);
    snprintf(fault, sizeof fault, "leave_in_%s", call);
    if (is(m, fault))
        _exit(0);
    snprintf(fault, sizeof fault, "end_thread_in_%s", call);
    if (is(m, fault))
        pthread_exit(NULL);
    snprintf(fault, sizeof fault, "hang_in_%s", call);
    if (is(m, fault))
        hang();
    snprintf(fault, sizeof fault, "crash_in_%s", call);
    if (is(m, fault))
        abort();
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    Instance *m = calloc(1, sizeof *m);
    m->host = host;
    strncpy(m->fault, name, sizeof m->fault - 1);
    in(m, "instantiate");
    if (is(m, "refuses")) {
        host->logger(host->componentEnvironment, name, fmi2Error, "licence", "no licence: %d %% used", 100);
        free(m);
        return NULL;
    }
    return m;
}

void fmi2FreeInstance(fmi2Component c)
{
    in(c, "free");
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, double b, double start, fmi2Boolean d, double e)
{
    (void)a, (void)b, (void)d, (void)e;
    ((Instance *)c)->now.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return in(c, "initialisation"), fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return in(c, "terminate"), fmi2OK; }

fmi2Status fmi2Reset(fmi2Component c)
{
    memset(&((Instance *)c)->now, 0, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, double time, double step, fmi2Boolean only_forward)
{
    Instance *m = c;
    (void)only_forward;
    if (time > 0.0499 && !m->asked) {
        m->asked = !is(m, "partial") && !is(m, "almost");
        fmi2Status status = misbehave(m, time, step);
        if (status != fmi2OK)
            return status;
    }
    m->now.time += step;
    m->now.count++;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, double v[])
{
    const State *now = &((Instance *)c)->now;
    for (size_t k = 0; k < n; k++)
        v[k] = r[k] == Y ? now->time + now->u : r[k] == SQUARE ? now->time * now->time : now->u;
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const double v[])
{
    (void)r;
    if (n > 0)
        ((Instance *)c)->now.u = v[n - 1];
    return is(c, "set_fails") && ((Instance *)c)->now.time > 0.0499 ? fmi2Error : fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, int v[])
{
    (void)r;
    for (size_t k = 0; k < n; k++)
        v[k] = ((Instance *)c)->now.count;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind what, double *value)
{
    *value = ((Instance *)c)->successful;
    return what == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind what, fmi2Boolean *value)
{
    *value = ((Instance *)c)->ended;
    return what == fmi2Terminated ? fmi2OK : fmi2Discard;
}

#define KEPT(c) (&((Instance *)(c))->now)
#include "../fmi2_rest.h"
ABSENT(SetInteger, const fmi2ValueReference r[], size_t n, const int v[])
ABSENT(SetBoolean, const fmi2ValueReference r[], size_t n, const int v[])
ABSENT(SetString, const fmi2ValueReference r[], size_t n, const fmi2String v[])
ABSENT(GetBoolean, const fmi2ValueReference r[], size_t n, int v[])
ABSENT(GetString, const fmi2ValueReference r[], size_t n, fmi2String v[])
ABSENT(GetDirectionalDerivative, const fmi2ValueReference u[], size_t n, const fmi2ValueReference k[], size_t m,
       const double d[], double e[])
ABSENT(SetRealInputDerivatives, const fmi2ValueReference r[], size_t n, const int o[], const double v[])
