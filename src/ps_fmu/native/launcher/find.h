/* Finding a Python that can run an FMU. */
#ifndef PS_FMU_FIND_H
#define PS_FMU_FIND_H

#include "text.h"

/* What an FMU needs, from resources/launcher.txt; NULL where that does not say. */
typedef struct {
    char *guid;
    char *python;      /* oldest version, "3.11" */
    char *modules;     /* that the interpreter has to have, separated by blanks */
    char *interpreter; /* noted at build time */
} Needs;

/* A Python that can run the FMU.  All strings are new memory. */
typedef struct {
    char *library;    /* path of libpython */
    char *program;    /* path of the interpreter; NULL: see home */
    char *home;       /* of a runtime in the FMU; NULL: see program */
    char *version;    /* "3.11" */
    char *search;     /* entries of sys.path, one per line */
    char *preload;    /* libraries that have to be loaded before, one per line; NULL: none */
} Python;

/* Is a version "3.12" at least "3.11"? */
bool version_at_least(const char *version, const char *oldest);

/* Look for a Python.
   binaries: folder of this library.  library: a libpython that the process has loaded already and that has to be
   used; NULL if none.  why: gets a line for every candidate that was turned down. */
bool find_python(const Needs *needs, const char *binaries, const char *library, Python *found, Text *why);

/* The packages of the runtime in an FMU, for a Python of that version that was started from another FMU's runtime;
   NULL if there are none.  New memory. */
char *bundled_packages(const char *binaries, const char *version);

void python_free(Python *python);

#endif
