/* What belongs to the host. */
#include "../platform.h"

#include <locale.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

struct Belongings {
    struct sigaction handlers[65];
    char *locale, *variable;
};

Belongings *keep_belongings(void)
{
    Belongings *kept = calloc(1, sizeof *kept);
    if (kept == NULL)
        return NULL;
    for (int i = 1; i < 65; i++)
        sigaction(i, NULL, &kept->handlers[i]);
    const char *locale = setlocale(LC_CTYPE, NULL), *variable = getenv("LC_CTYPE");
    kept->locale = locale != NULL ? strdup(locale) : NULL;
    kept->variable = variable != NULL ? strdup(variable) : NULL;
    return kept;
}

void give_back(Belongings *kept)
{
    if (kept == NULL)
        return;
    struct sigaction now;
    for (int i = 1; i < 65; i++)
        if (sigaction(i, NULL, &now) == 0 && now.sa_handler != kept->handlers[i].sa_handler)
            sigaction(i, &kept->handlers[i], NULL);
    if (kept->locale != NULL)
        setlocale(LC_CTYPE, kept->locale);
    const char *variable = getenv("LC_CTYPE");
    if (kept->variable == NULL && variable != NULL)
        unsetenv("LC_CTYPE");
    else if (kept->variable != NULL && (variable == NULL || strcmp(variable, kept->variable) != 0))
        setenv("LC_CTYPE", kept->variable, 1);
    free(kept->locale);
    free(kept->variable);
    free(kept);
}
