/* Running a program. */
#include "../platform.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

extern char **environ;

static char **child_environment(void)
{
    size_t n = 0;
    while (environ != NULL && environ[n] != NULL)
        n++;
    char **result = calloc(n + 1, sizeof *result);
    size_t kept = 0;
    for (size_t i = 0; result != NULL && i < n; i++)
        if (strncmp(environ[i], "LD_", 3) != 0 && strncmp(environ[i], "PYTHON", 6) != 0)
            result[kept++] = environ[i];
    return result;
}

static pid_t start(char *const arguments[], int output)
{
    pid_t child = -1;
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    char **environment = child_environment();
    sigemptyset(&none);
    sigfillset(&all);
    sigdelset(&all, SIGKILL); /* these two cannot be set, and older systems take the attempt for a failure */
    sigdelset(&all, SIGSTOP);
    posix_spawn_file_actions_init(&files);
    posix_spawnattr_init(&attributes);
    posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&files, output, STDERR_FILENO);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0); /* a group of its own, which can be killed as a whole */
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    int error = environment == NULL ? ENOMEM
                                    : posix_spawn(&child, arguments[0], &files, &attributes, arguments, environment);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&files);
    free(environment);
    errno = error;
    return error == 0 ? child : -1;
}

static long milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000L + now.tv_nsec / 1000000L;
}

/* Collect what the child prints until it closes its output.  False if that lasts until the time `end`. */
static bool read_output(int input, long end, size_t most, Text *output)
{
    for (;;) {
        struct pollfd ready = {.fd = input, .events = POLLIN};
        long left = end - milliseconds();
        int n = left > 0 ? poll(&ready, 1, (int)left) : 0;
        if (n < 0 && errno == EINTR)
            continue;
        char part[4096];
        ssize_t size = n > 0 ? read(input, part, sizeof part) : -1;
        if (size < 0 && n > 0 && errno == EINTR)
            continue;
        if (size <= 0)
            return size == 0;
        if (output->used < most)
            text_add_bytes(output, part, (size_t)size);
    }
}

/* Wait for the child to end.  False if it still runs at the time `end`.
   Its status does not matter: hosts that ignore SIGCHLD, or wait for any child, take it. */
static bool wait_until(pid_t child, long end)
{
    for (;;) {
        pid_t ended = waitpid(child, NULL, WNOHANG);
        if (ended != 0 && (ended > 0 || errno != EINTR))
            return true;
        if (milliseconds() >= end)
            return false;
        sleep_a_millisecond();
    }
}

static void kill_group(pid_t child)
{
    kill(-child, SIGKILL);
    while (waitpid(child, NULL, 0) < 0 && errno == EINTR)
        continue;
}

bool run_program(char *const arguments[], int timeout, size_t most_output, Text *output, Text *reason)
{
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) {
        text_add(reason, "no pipe: %s", strerror(errno));
        return false;
    }
    long end = milliseconds() + 1000L * timeout;
    pid_t child = start(arguments, ends[1]);
    int error = errno;
    close(ends[1]);
    if (child < 0) {
        text_add(reason, "cannot be started: %s", strerror(error));
    } else if (!read_output(ends[0], end, most_output, output) || !wait_until(child, end)) {
        kill_group(child);
        text_add(reason, "did not end within %d s", timeout);
    }
    close(ends[0]);
    return reason->used == 0;
}
