/* What the host says about the stages of an FMU's life, as lines ["stage", problem] in a file: null when a stage begins,
   "" when it has ended well.  What is there remains there when the process crashes. */
#ifndef PS_FMU_REPORT_H
#define PS_FMU_REPORT_H

/* Where to write.  False if that is not possible. */
int report_open(const char *path);

/* The next stage begins; the one before has ended well, unless a problem was noted. */
void report_stage(const char *name);

/* The stage has a problem, and yet the life goes on. */
void report_note(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The stage has a problem that ends the life, and the process. */
void report_failure(const char *format, ...) __attribute__((format(printf, 1, 2), noreturn));

#endif
