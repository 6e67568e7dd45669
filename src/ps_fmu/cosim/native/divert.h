/* Calls of C functions, by libraries that have been loaded, directed to other functions. */

#ifndef DIVERT_H
#define DIVERT_H

/* Calls of the function `name` go to `to`. */
typedef struct {
    const char *name;
    void *to;
} Diversion;

/* How many libraries have been loaded so far. */
unsigned long long count_loads(void);

/* Divert the calls of the libraries that were loaded after count_loads() was `before`.  `all` ends with a name NULL. */
void divert_new(unsigned long long before, const Diversion *all);

/* Divert those of the library or program that an address is in. */
void divert_at(const void *address, const Diversion *all);

#endif
