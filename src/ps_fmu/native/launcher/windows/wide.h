/* Windows' interfaces take UTF-16; see widened() in text.h for the way there. */
#ifndef PS_FMU_WIDE_H
#define PS_FMU_WIDE_H

#include "../text.h"

#define WIN32_LEAN_AND_MEAN
#define PSAPI_VERSION 2
#include <windows.h>

enum { LONGEST = 1 << 15 }; /* characters of a path or variable */

/* As UTF-8, new memory. */
char *narrowed(const wchar_t *text);

/* A path for the functions that take no slashes, new memory. */
wchar_t *with_backslashes(const char *path);

/* The system's words for an error. */
void add_error(Text *reason, DWORD error);

#endif
