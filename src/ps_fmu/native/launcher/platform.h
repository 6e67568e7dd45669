/* What differs between operating systems, in the folders posix and windows.  Texts and paths are UTF-8; results that
   are char * are new memory.  A function that gets a `reason` adds to it why it failed. */
#ifndef PS_FMU_PLATFORM_H
#define PS_FMU_PLATFORM_H

#include <stdbool.h>
#include <stdio.h>

#include "text.h"

/* --- Names ------------------------------------------------------------------------------------------------------ */

extern const char WRAPPER[];         /* pythonfmu's library */
extern const char VENV_PYTHON[];     /* the interpreter within a virtual environment */
extern const char *const PYTHONS[];  /* interpreters on PATH; ends with NULL */
extern const char USUAL_PATH[];      /* where PATH is not set */
extern const char LIST_SEPARATOR[];  /* between the entries of PATH */

/* --- Paths and environment -------------------------------------------------------------------------------------- */

char *environment_value(const char *name); /* NULL: not set */
bool is_absolute(const char *path);
const char *path_in_uri(const char *uri_path); /* the path that begins within the path of a file URI */
char *full_path(const char *path);             /* without links and ..; NULL if there is nothing */
bool same_file(const char *a, const char *b);
FILE *open_for_reading(const char *path);
bool is_readable(const char *path);
bool is_program(const char *path);
void add_system_error(Text *reason); /* of is_program */

/* pythonfmu's library opens files by 8-bit names, and hands the same names to Python as UTF-8.  Have `path` be one that
   is good for both; false if there is none. */
bool make_plain(char **path);

/* --- Programs and libraries ------------------------------------------------------------------------------------- */

/* Run a program (an argument list that ends with NULL) without what a host may have set for its own libraries and its
   own Python.  After `timeout` s it is killed, even if it has closed its output.  False if it did not run to its end. */
bool run_program(char *const arguments[], int timeout, size_t most_output, Text *output, Text *reason);

char *own_folder(void);                              /* of the launcher */
void *open_library(const char *path, Text *reason);  /* that stays in the process for good */
void *library_symbol(void *library, const char *name);

/* The path of a library of Python that the process has loaded; NULL if there is none. */
char *loaded_python(void);

/* Have a library of Python's symbols found by python_symbol, and by the libraries that are loaded later. */
bool share_python(const char *library, bool is_loaded, Text *reason);
void *python_symbol(const char *name);

/* --- Threads and the process ------------------------------------------------------------------------------------ */

/* Each FMU has its own copy of this library, with its own static variables.  Here is what they have in common: memory,
   zero at first, one recursive lock, and a pointer of each thread. */
enum { COMMON_SIZE = 128 }; /* bytes */
void *common_memory(void);
void set_up_common(void); /* before all of the following */
bool common_try_lock(void);
void common_lock(void);
void common_unlock(void);
void *thread_pointer(void);
void set_thread_pointer(void *pointer);

/* In python.c: a thread that has such a pointer ends. */
void on_thread_end(void *pointer);

unsigned long thread_id(void);
void sleep_a_millisecond(void);
void at_exit_of_process(void (*function)(void));

/* Signal handlers, locale and environment of the host, which Python changes even when told not to. */
typedef struct Belongings Belongings;
Belongings *keep_belongings(void);
void give_back(Belongings *kept);

#endif
