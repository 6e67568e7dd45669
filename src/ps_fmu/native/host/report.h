/* The report on the stages of an FMU's life: lines ["stage", problem] in a file, null when a stage begins, "" when it
   has ended well.  Each line is flushed, so that it survives a crash. */
#ifndef PS_FMU_REPORT_H
#define PS_FMU_REPORT_H

/* Open the report.  False if the file cannot be written. */
int report_open(const char *path);

/* The next stage begins; the one before has ended well, unless a problem was noted. */
void report_stage(const char *name);

/* The stage has a problem; the life goes on. */
void report_note(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The stage has a problem that ends the life, and the process. */
void report_failure(const char *format, ...) __attribute__((format(printf, 1, 2), noreturn));

#endif
