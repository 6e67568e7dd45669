/* Ways out of a call of an FMU that does not return: it crashes, ends process or thread, or hangs until the second Ctrl-C.

   run_guarded leaves such a call by a long jump, so that the master keeps its rows and says what happened.  The FMU's
   library is not called again.  It may hold a lock of the C library for ever: the master only ends after that.

   An FMU in Python that holds the interpreter's lock is not left that way, for nobody could take the lock again.

   Copies of the process that FMUs make by fork() end as they like, but when they come back from the call: they would go
   on with the run, and write into the same files. */

#include <fenv.h>
#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "control_word.h"
#include "divert.h"
#include "fmi2FunctionTypes.h"

#define EXPORTED __attribute__((visibility("default")))

typedef struct Loop Loop; /* of loop.c */
typedef struct Timing Timing;
int run_steps(Loop *loop, double *rows, const double *times, int64_t end, double budget, const volatile int *stop);
int run_timed_steps(Loop *loop, double *rows, const double *times, int64_t end, double budget, const volatile int *stop,
                    Timing *timing);

typedef enum { RETURNED, CRASHED, EXITED, INTERRUPTED, LEFT, THREAD_ENDED } Ending; /* LEFT: by _exit() */

/* How the last call ended, with the number of the signal or the exit code. */
typedef struct {
    int ending;
    int number;
} End;

static const int crashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
enum { N_CRASHES = sizeof crashes / sizeof *crashes, STACK_BYTES = 1 << 16 };

static struct sigaction before[N_CRASHES], interrupt_before;
static int armed, takes_interrupts; /* how often: threads may run systems at the same time */
static int (*holds_python)(void);
static pid_t owner;          /* the process that calls FMUs */
static int exit_code = -1;   /* of the process, once it ends by exit() */
static int has_told;         /* why it ends */
static unsigned long control_word; /* before any FMU was loaded */
static __thread sigjmp_buf *way_out;
static __thread volatile int end_number;
static __thread char own_stack[STACK_BYTES]; /* after an overflow of the stack there is no other */
static __thread stack_t stack_before;
static __thread int armed_here;

/* Ctrl-C so far; Python reads and writes it. */
EXPORTED volatile int guard_interrupts;

/* The calls outside of the steps that are under way, for messages: one a thread, empty if there is none. */
enum { N_PLACES = 64, PLACE_BYTES = 256 };
static char places[N_PLACES][PLACE_BYTES];
static __thread int own_place = -1;

static const char *find_own_place(void)
{
    return own_place < 0 ? "" : places[own_place];
}

/* That of any thread: Ctrl-C comes to the main one, whichever hangs. */
static const char *find_any_place(void)
{
    for (int k = 0; k < N_PLACES; k++)
        if (places[k][0] != '\0')
            return places[k];
    return "";
}

/* Name the call that this thread makes next, or none, ""; returns what it was.  The caller holds Python's lock, so one
   thread at a time is here.  Without a free place, the call has no name. */
EXPORTED void guard_name(const char *text, char *previous)
{
    owner = getpid();
    strcpy(previous, find_own_place());
    for (int k = 0; own_place < 0 && k < N_PLACES; k++)
        if (places[k][0] == '\0')
            own_place = k;
    if (own_place < 0)
        return;
    strncpy(places[own_place], text, PLACE_BYTES - 1);
    if (text[0] == '\0')
        own_place = -1;
}

static void say(const char *text)
{
    if (write(STDERR_FILENO, text, strlen(text)) < 0)
        return;
}

static void leave(Ending ending, int number)
{
    sigjmp_buf *out = way_out;
    way_out = NULL;
    end_number = number;
    siglongjmp(*out, (int)ending);
}

static void tell_end(const char *place, const char *what)
{
    if (has_told++)
        return;
    say(place);
    say(what);
}

/* This process is a copy that was made in a call of an FMU, which is still under way in it. */
volatile int is_copy_in_call;

static void note_copy(void)
{
    is_copy_in_call = way_out != NULL;
}

/* A copy has come back from the call that made it. */
void end_copy(void)
{
    say("an FMU in the steps: a copy of the process, made by fork(), came back from the call, and was ended\n");
    _exit(1);
}

static int is_copy(void)
{
    return getpid() != owner;
}

static int can_leave(void)
{
    return way_out != NULL && !is_copy() && (holds_python == NULL || !holds_python());
}

static void on_crash(int number, siginfo_t *info, void *context)
{
    (void)info, (void)context;
    if (can_leave())
        leave(CRASHED, number);
    const char *place = find_own_place();
    if (!is_copy() && (way_out != NULL || place[0] != '\0')) {
        say(place[0] != '\0' ? place : "an FMU in the steps");
        say(": crashed, and the process with it; --isolate gives FMUs processes of their own\n");
    }
    for (int k = 0; k < N_CRASHES; k++)
        if (crashes[k] == number)
            sigaction(number, &before[k], NULL); /* on return the fault comes again; an abort goes on */
    if (number == SIGABRT)
        raise(number);
}

static void on_interrupt(int number, siginfo_t *info, void *context)
{
    guard_interrupts++;
    if (interrupt_before.sa_flags & SA_SIGINFO)
        interrupt_before.sa_sigaction(number, info, context);
    else if (interrupt_before.sa_handler != SIG_DFL && interrupt_before.sa_handler != SIG_IGN)
        interrupt_before.sa_handler(number);
    if (guard_interrupts > 1 && can_leave())
        leave(INTERRUPTED, number);
    if (guard_interrupts > 1 && way_out == NULL && find_any_place()[0] != '\0') {
        say(find_any_place());
        say(": did not return, and was interrupted: the process ends\n");
        _exit(130);
    }
    if (guard_interrupts > 2 && way_out != NULL) {
        say("an FMU in Python does not return: the process ends; rows that are not in the file yet are lost\n");
        _exit(130);
    }
}

static void on_exit_in_steps(int code, void *unused)
{
    (void)unused;
    if (is_copy_in_call)
        _exit(code); /* what comes next, as HDF5's, would write into the files of the run */
    if (is_copy())
        return;
    if (can_leave())
        leave(EXITED, code);
    if (way_out != NULL) {
        tell_end("an FMU in the steps", ": called exit(): the process ends\n");
        _exit(code != 0 ? code : 1);
    }
    exit_code = code;
}

/* Registered first, so it comes last: files have been closed by then. */
static void on_exit_elsewhere(int code, void *unused)
{
    (void)unused;
    if (is_copy() || find_own_place()[0] == '\0')
        return;
    tell_end(find_own_place(), ": called exit(): the process ends\n");
    _exit(code != 0 ? code : 1);
}

static void on_quick_exit(void)
{
    on_exit_in_steps(0, NULL);
    on_exit_elsewhere(0, NULL);
}

/* A library of an FMU ends the process, in any thread of it, by `really`: never with code 0, unless the process ends
   anyway and with that. */
static void end_process(Ending ending, const char *what, int code, void (*really)(int))
{
    if (is_copy())
        really(code);
    if (can_leave())
        leave(ending, code);
    if (exit_code >= 0)
        really(code != 0 ? code : exit_code);
    const char *place = find_own_place();
    tell_end(place[0] != '\0' ? place : way_out != NULL ? "an FMU in the steps" : "an FMU", what);
    really(code != 0 ? code : 1);
}

static void end_by_exit(int code)
{
    end_process(EXITED, ": called exit(): the process ends\n", code, exit);
}

static void end_at_once(int code)
{
    end_process(LEFT, ": called _exit(): the process ends\n", code, _exit);
}

static void end_quickly(int code)
{
    end_process(EXITED, ": called quick_exit(): the process ends\n", code, quick_exit);
}

/* The master cannot go on without its thread; those of an FMU's own end as they like. */
static void end_thread(void *result)
{
    if (can_leave())
        leave(THREAD_ENDED, 0);
    const char *place = find_own_place();
    if (!is_copy() && (way_out != NULL || place[0] != '\0')) {
        tell_end(place[0] != '\0' ? place : "an FMU in the steps", ": ended its thread: the process ends\n");
        _exit(1);
    }
    pthread_exit(result);
}

static void end_thread_with(int result)
{
    end_thread((void *)(intptr_t)result);
}

/* Python's os._exit: an FMU's only in a call of one. */
static void end_python(int code)
{
    if (way_out != NULL || find_own_place()[0] != '\0')
        end_at_once(code);
    _exit(code);
}

static Diversion of_fmus[] = {{"exit", end_by_exit, NULL},        {"_exit", end_at_once, NULL},
                              {"_Exit", end_at_once, NULL},       {"quick_exit", end_quickly, NULL},
                              {"pthread_exit", end_thread, NULL}, {"thrd_exit", end_thread_with, NULL},
                              {NULL, NULL, NULL}};
static Diversion of_python[] = {{"_exit", end_python, NULL}, {NULL, NULL, NULL}};

EXPORTED Loaded *guard_list_loaded(void)
{
    return list_loaded();
}

/* An FMU was loaded after guard_list_loaded() gave `before` in this thread, and its libraries with it.  Returns 1 if
   that changed how this thread computes, which is put back. */
EXPORTED int guard_divert(Loaded *before)
{
    divert_new(before, of_fmus);
    return put_control_word_back(control_word);
}

/* Once: `python` says whether this thread holds the interpreter's lock. */
EXPORTED void guard_prepare(int (*python)(void))
{
    holds_python = python;
    owner = getpid();
    control_word = read_control_word();
    pthread_atfork(NULL, NULL, note_copy);
    find_functions(of_fmus);
    find_functions(of_python);
    divert_at((const void *)python, of_python);
    on_exit(on_exit_elsewhere, NULL);
    at_quick_exit(on_quick_exit);
}

/* Take over signals, until guard_disarm with the same `interrupt` in the same thread; calls may be nested, and other
   threads may be armed meanwhile.  `interrupt`: also SIGINT. */
EXPORTED void guard_arm(int interrupt)
{
    struct sigaction action;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    owner = getpid();
    action.sa_flags = SA_SIGINFO | SA_ONSTACK;
    if (armed_here++ == 0) {
        const stack_t stack = {.ss_sp = own_stack, .ss_size = STACK_BYTES, .ss_flags = 0};
        sigaltstack(&stack, &stack_before);
    }
    if (armed == 0 || (interrupt && takes_interrupts == 0))
        guard_interrupts = 0;
    if (interrupt && takes_interrupts++ == 0) {
        action.sa_sigaction = on_interrupt;
        sigaction(SIGINT, &action, &interrupt_before);
    }
    if (armed++ > 0)
        return;
    action.sa_sigaction = on_crash;
    for (int k = 0; k < N_CRASHES; k++)
        sigaction(crashes[k], &action, &before[k]);
    on_exit(on_exit_in_steps, NULL); /* again each time: what registered before it, as HDF5, comes after it */
}

EXPORTED void guard_disarm(int interrupt)
{
    if (--armed_here == 0)
        sigaltstack(&stack_before, NULL);
    if (interrupt && --takes_interrupts == 0) {
        sigaction(SIGINT, &interrupt_before, NULL);
        guard_interrupts = 0; /* those of this run do not end what is called next */
    }
    if (--armed > 0)
        return;
    for (int k = 0; k < N_CRASHES; k++)
        sigaction(crashes[k], &before[k], NULL);
}

/* Put the rounding of numbers, the handler of Ctrl-C and the rest of the control word back; returns 1 if the first was
   changed, plus 2 for the second, plus 8 for the third. */
EXPORTED int guard_restore(void)
{
    int found = 0;
    struct sigaction action;
    if (fegetround() != FE_TONEAREST) {
        fesetround(FE_TONEAREST);
        found |= 1;
    }
    if (put_control_word_back(control_word))
        found |= 8;
    if (takes_interrupts && sigaction(SIGINT, NULL, &action) == 0 && action.sa_sigaction != on_interrupt) {
        action.sa_flags = SA_SIGINFO | SA_ONSTACK;
        action.sa_sigaction = on_interrupt;
        sigaction(SIGINT, &action, NULL);
        found |= 2;
    }
    return found;
}

/* As run_steps, or as run_timed_steps if there is a `timing`; fmi2Fatal with an `end` other than RETURNED if the
   operation before `next_operation` did not return. */
EXPORTED int run_guarded(Loop *loop, double *rows, const double *times, int64_t n, double budget,
                         const volatile int *stop, Timing *timing, End *end)
{
    sigjmp_buf here;
    sigjmp_buf *const outer = way_out; /* of the run that this one is in: an FMU in Python may run a system itself */
    const int outer_copy = is_copy_in_call;
    end->ending = sigsetjmp(here, 1);
    if (end->ending != RETURNED) {
        end->number = end_number;
        way_out = outer;
        is_copy_in_call = outer_copy;
        return fmi2Fatal;
    }
    way_out = &here;
    is_copy_in_call = 0;
    const int status = timing != NULL ? run_timed_steps(loop, rows, times, n, budget, stop, timing)
                                      : run_steps(loop, rows, times, n, budget, stop);
    way_out = outer;
    is_copy_in_call = outer_copy;
    return status;
}
