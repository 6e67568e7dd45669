/* Calls of C functions, by libraries that have been loaded, directed to other functions. */

#ifndef DIVERT_H
#define DIVERT_H

/* Calls of the function `name` go to `to`, and those through variables that hold `from`, the function itself. */
typedef struct {
    const char *name;
    void *to;
    const void *from;
} Diversion;

/* Libraries that are loaded at some time. */
typedef struct Loaded Loaded;

/* Fill in `from`.  `all` ends with a name NULL. */
void find_functions(Diversion *all);

/* Those of now; NULL if there is no memory for the list. */
Loaded *list_loaded(void);

/* Divert the calls of the libraries that are loaded now and were not before, also by other threads; frees `before`. */
void divert_new(Loaded *before, const Diversion *all);

/* Divert those of the library or program that an address is in. */
void divert_at(const void *address, const Diversion *all);

#endif
