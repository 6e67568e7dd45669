#include "floats.h"

#include <fenv.h>

static __thread int taken;
static __thread fenv_t of_host;

void floats_take(void)
{
    if (taken++ == 0) {
        fegetenv(&of_host);
        fesetenv(FE_DFL_ENV);
    }
}

void floats_give_back(void)
{
    if (--taken == 0)
        fesetenv(&of_host);
}
