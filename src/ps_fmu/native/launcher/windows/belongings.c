/* What belongs to the host. */
#include "../platform.h"
#include "wide.h"

#include <locale.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

static const int SIGNALS[] = {SIGABRT, SIGBREAK, SIGFPE, SIGILL, SIGINT, SIGSEGV, SIGTERM};
enum { N_SIGNALS = sizeof SIGNALS / sizeof *SIGNALS };

struct Belongings {
    void (*handlers[N_SIGNALS])(int);
    char *locale;
};

Belongings *keep_belongings(void)
{
    Belongings *kept = calloc(1, sizeof *kept);
    if (kept == NULL)
        return NULL;
    for (int i = 0; i < N_SIGNALS; i++)
        kept->handlers[i] = signal(SIGNALS[i], SIG_GET);
    const char *locale = setlocale(LC_CTYPE, NULL);
    kept->locale = locale != NULL ? strdup(locale) : NULL;
    return kept;
}

void give_back(Belongings *kept)
{
    if (kept == NULL)
        return;
    for (int i = 0; i < N_SIGNALS; i++)
        if (kept->handlers[i] != SIG_ERR)
            signal(SIGNALS[i], kept->handlers[i]);
    if (kept->locale != NULL)
        setlocale(LC_CTYPE, kept->locale);
    free(kept->locale);
    free(kept);
}
