/* The process's Python: attached to if it runs already, started otherwise; and the threads that enter it. */
#ifndef PS_FMU_PYTHON_H
#define PS_FMU_PYTHON_H

#include "find.h"

/* The lock under which Python is started and FMUs are instantiated, one for all FMUs of the process.  The thread may
   hold it already, and may hold Python's global interpreter lock. */
void python_lock(void);
void python_unlock(void);

/* Have Python running in this process, with symbols that libraries loaded later find.  Under python_lock.
   False, with the reason in why, if that is not possible. */
bool python_start(const Needs *needs, const char *binaries, Text *why);

/* Each call of a host is put between these.  False if no Python is there any more: it was finalised since
   `generation`, or the process is about to end.  Then python_leave must not be called. */
bool python_enter(unsigned long generation);
void python_leave(void);

/* Counts how often Python was finalised in this process. */
unsigned long python_generation(void);

#endif
