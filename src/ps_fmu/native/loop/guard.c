/* The end of the process within a call of an FMU: by a crash, exit(), quick_exit() or pthread_exit().

   The last words name the FMU, the call and the time.  A thread of Python then stores the rows so far (../guard.py), and
   the process ends: by the signal of the crash, else with an exit code other than 0.  Nothing leads back out of the call.

   Also: how this thread computes with floating-point numbers is put back. */

#include <fenv.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "control_word.h"

#define EXPORTED __attribute__((visibility("default")))

/* A call in the steps: its time is that of the step and `offset` [s]. */
typedef struct {
    const char *name;
    double offset;
} Call;

/* Where a thread is: in the call `text`, or with `calls` in the one before `*next`, in the step from times[*row] on. */
typedef struct {
    const char *text;
    const Call *calls;
    const int64_t *next, *row;
    const double *times;
} Place;

static const int crashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
static const char *const names[] = {"SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT"};
enum { N_CRASHES = sizeof crashes / sizeof *crashes, STACK_BYTES = 1 << 16, PATIENCE_S = 10, LOOK_NS = 2000000 };

static struct sigaction before[N_CRASHES];
static int (*holds_python)(void), (*has_python)(void);
static int keeper = -1; /* written to, a thread of Python stores rows */
static volatile int kept;
static int under_way;   /* threads that are in calls */
static int ending;      /* somebody has told why */
static int is_copy;     /* an FMU has made this process by fork() in a call, which is still under way in it */
static pthread_key_t thread_end;
static unsigned long control_word; /* before any FMU was loaded */
static __thread const Place *place;
static __thread char own_stack[STACK_BYTES]; /* after an overflow of the stack there is no other */

static void say(const char *text)
{
    if (write(STDERR_FILENO, text, strlen(text)) < 0)
        return;
}

/* Returns 0 if another thread has done so, or is about to. */
static int tell(const char *what)
{
    char time[40] = "";
    const char *name = "an FMU, or a thread beside it";
    if (__atomic_exchange_n(&ending, 1, __ATOMIC_SEQ_CST))
        return 0;
    if (place != NULL && place->calls != NULL) {
        const Call *call = &place->calls[*place->next - 1];
        name = call->name;
        snprintf(time, sizeof time, " at t = %.9g s", place->times[*place->row] + call->offset);
    } else if (place != NULL)
        name = place->text;
    if (isatty(STDERR_FILENO)) /* behind the line of the progress */
        say("\n");
    say(name);
    say(time);
    say(what);
    say(": the process ends; --isolate gives FMUs processes of their own\n");
    return 1;
}

/* Have the rows so far stored.  A crash may have left a lock closed for ever: then it takes PATIENCE_S. */
static void keep_rows(void)
{
    const struct timespec look = {0, LOOK_NS};
    const uint64_t thread = (uint64_t)pthread_self();
    const time_t until = time(NULL) + PATIENCE_S;
    if (keeper < 0 || holds_python() || write(keeper, &thread, sizeof thread) != sizeof thread)
        return;
    while (!kept && time(NULL) <= until)
        nanosleep(&look, NULL);
}

static void on_crash(int number, siginfo_t *info, void *context)
{
    int k = 0;
    (void)info, (void)context;
    while (crashes[k] != number)
        k++;
    char what[40] = " crashed with ";
    strcat(what, names[k]);
    if (under_way > 0 && !is_copy && tell(what))
        keep_rows();
    sigaction(number, &before[k], NULL);
    raise(number); /* it comes when this function returns */
}

static void end_with(const char *what, int code)
{
    if (is_copy)
        _exit(code); /* what comes next, as HDF5's, would write into the files of the run */
    if (under_way == 0 || !has_python()) /* or Python has come to its end: nobody else calls exit() then */
        return;
    if (tell(what))
        keep_rows();
    _exit(code != 0 ? code : 1);
}

static void on_process_end(int code, void *unused)
{
    char what[40];
    (void)unused;
    snprintf(what, sizeof what, " called exit(%d)", code);
    end_with(what, code);
}

static void on_quick_end(void)
{
    end_with(" called quick_exit()", 0);
}

/* The master cannot go on without its thread. */
static void on_thread_end(void *unused)
{
    (void)unused;
    end_with(" ended its thread by pthread_exit()", 1);
}

static void note_copy(void)
{
    is_copy = place != NULL;
    under_way = 0;
    keeper = -1;
}

/* This thread is at another place, NULL: in no call.  Returns where it was. */
EXPORTED const Place *guard_enter(const Place *entered)
{
    const Place *const left = place;
    stack_t stack;
    if (left == NULL && sigaltstack(NULL, &stack) == 0 && (stack.ss_flags & SS_DISABLE)) {
        stack = (stack_t){.ss_sp = own_stack, .ss_size = STACK_BYTES, .ss_flags = 0};
        sigaltstack(&stack, NULL);
    }
    __atomic_add_fetch(&under_way, (entered != NULL) - (left != NULL), __ATOMIC_SEQ_CST);
    pthread_setspecific(thread_end, entered);
    place = entered;
    return left;
}

/* What registers after this is called before it at the end: HDF5 closes all files. */
EXPORTED void guard_expect_exit(void)
{
    on_exit(on_process_end, NULL);
}

/* Who writes a thread's number to the descriptor has the rows of its run stored, then guard_note_kept() is called. */
EXPORTED void guard_set_keeper(int descriptor)
{
    keeper = descriptor;
}

EXPORTED void guard_note_kept(void)
{
    kept = 1;
}

/* Once: `lock` says whether this thread holds the interpreter's lock, `python` whether there is an interpreter. */
EXPORTED void guard_prepare(int (*lock)(void), int (*python)(void))
{
    struct sigaction action;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_flags = SA_SIGINFO | SA_ONSTACK;
    action.sa_sigaction = on_crash;
    holds_python = lock;
    has_python = python;
    control_word = read_control_word();
    pthread_key_create(&thread_end, on_thread_end);
    pthread_atfork(NULL, NULL, note_copy);
    at_quick_exit(on_quick_end);
    for (int k = 0; k < N_CRASHES; k++)
        sigaction(crashes[k], &action, &before[k]);
}

/* Put the rounding of numbers and the rest of the control word back; returns 1 if the first was changed, plus 2 for the
   second. */
EXPORTED int guard_restore(void)
{
    int found = 0;
    if (fegetround() != FE_TONEAREST) {
        fesetround(FE_TONEAREST);
        found |= 1;
    }
    if (put_control_word_back(control_word))
        found |= 2;
    return found;
}
