#include "settings.h"

#include <fenv.h>
#include <limits.h>
#include <locale.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const struct {
    int number;
    const char *change;
} signals[] = {
    {SIGINT, "the handler of SIGINT"},   {SIGTERM, "the handler of SIGTERM"}, {SIGHUP, "the handler of SIGHUP"},
    {SIGQUIT, "the handler of SIGQUIT"}, {SIGPIPE, "the handler of SIGPIPE"}, {SIGCHLD, "the handler of SIGCHLD"},
    {SIGALRM, "the handler of SIGALRM"}, {SIGABRT, "the handler of SIGABRT"}, {SIGFPE, "the handler of SIGFPE"},
    {SIGSEGV, "the handler of SIGSEGV"}, {SIGUSR1, "the handler of SIGUSR1"}, {SIGUSR2, "the handler of SIGUSR2"},
};
enum { N_SIGNALS = sizeof signals / sizeof *signals };

static struct sigaction handlers[N_SIGNALS];
static char folder[PATH_MAX], locales[1024];
static int rounding;
static mode_t mask;

static mode_t file_mask(void)
{
    mode_t now = umask(0);
    umask(now);
    return now;
}

void settings_keep(void)
{
    for (int k = 0; k < N_SIGNALS; k++)
        sigaction(signals[k].number, NULL, &handlers[k]);
    if (getcwd(folder, sizeof folder) == NULL)
        folder[0] = '\0';
    strncpy(locales, setlocale(LC_ALL, NULL), sizeof locales - 1);
    rounding = fegetround();
    mask = file_mask();
}

const char *settings_changed(void)
{
    char now[PATH_MAX];
    for (int k = 0; k < N_SIGNALS; k++) {
        struct sigaction handler;
        sigaction(signals[k].number, NULL, &handler);
        if (handler.sa_handler != handlers[k].sa_handler)
            return signals[k].change;
    }
    if (getcwd(now, sizeof now) != NULL && strcmp(now, folder) != 0)
        return "the working directory";
    if (strcmp(setlocale(LC_ALL, NULL), locales) != 0)
        return "the locale";
    if (fegetround() != rounding)
        return "the rounding of floating-point numbers";
    if (file_mask() != mask)
        return "the mask of file permissions";
    return NULL;
}
