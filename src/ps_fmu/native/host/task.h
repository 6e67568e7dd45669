/* The FMU that the host has to run, and how: a file with a line "key value" for each fact. */
#ifndef PS_FMU_TASK_H
#define PS_FMU_TASK_H

#include <stdbool.h>
#include <stddef.h>

#include "fmi2FunctionTypes.h"

enum { REAL, INTEGER, BOOLEAN, STRING, N_TYPES };

/* Variables of one type. */
typedef struct {
    size_t n;
    fmi2ValueReference *references;
    char **texts; /* of outputs the names, of inputs the start values */
} Variables;

typedef struct {
    char *library;         /* library PATH */
    char *guid;            /* guid TEXT */
    char *resources;       /* resources PATH, with the escapes of a URI */
    double start, step;    /* start S, step S */
    bool once;             /* one instance in a process at most */
    bool state, serialise; /* the state can be had, and as bytes too */
    Variables outputs[N_TYPES]; /* output TYPE REFERENCE NAME */
    Variables inputs[N_TYPES];  /* input TYPE REFERENCE START */
} Task;

/* False, with a line on stderr, if the file cannot be read or is not of that form. */
bool task_read(const char *path, Task *task);

#endif
