/* How one process waits until another one has changed a number in shared memory. */
#ifndef WAITING_H
#define WAITING_H

#include <linux/futex.h>
#include <sched.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static inline int64_t now_ns(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static inline void pause_briefly(void)
{
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
}

/* Whether looking at the memory again and again is worth it.  Where the other process has a processor to run on, its
   answer comes within microseconds, and sleeping and being woken takes ten times as long.  Where it has none, to look
   only keeps it from running: after some looks in vain a process sleeps at once for a number of waits, then tries again,
   and sleeps for twice as many if that was in vain, too. */
typedef struct {
    uint32_t in_vain; /* looks in succession */
    uint32_t asleep;  /* waits for which to sleep at once */
    uint32_t penalty;
} Patience;

enum { LOOKS = 32, MOST_IN_VAIN = 3, LEAST_PENALTY = 64, MOST_PENALTY = 4096 };

static inline bool look(const uint32_t *number, uint32_t wanted)
{
    for (int k = 0; k < LOOKS; k++) {
        if (__atomic_load_n(number, __ATOMIC_ACQUIRE) == wanted)
            return true;
        pause_briefly();
    }
    return false;
}

/* Whether the number became `wanted` within about `spin_ns`.  Other processes that are ready to run get the processor. */
static inline bool spin(const uint32_t *number, uint32_t wanted, int64_t spin_ns, Patience *patience)
{
    if (look(number, wanted))
        return true;
    if (patience->asleep > 0) {
        patience->asleep--;
        return false;
    }
    for (const int64_t until = now_ns() + spin_ns; now_ns() < until;) {
        sched_yield();
        if (look(number, wanted)) {
            if (now_ns() > until) /* others had the processor in between */
                break;
            patience->in_vain = patience->penalty = 0;
            return true;
        }
    }
    if (++patience->in_vain >= MOST_IN_VAIN) {
        patience->penalty = patience->penalty == 0 ? LEAST_PENALTY : patience->penalty * 2;
        if (patience->penalty > MOST_PENALTY)
            patience->penalty = MOST_PENALTY;
        patience->asleep = patience->penalty;
        patience->in_vain = MOST_IN_VAIN - 1;
    }
    return __atomic_load_n(number, __ATOMIC_ACQUIRE) == wanted;
}

/* Sleep until the number is no longer `old`, at most `slice_ns`; `sleeps` tells the other process to wake this one. */
static inline void sleep_on(const uint32_t *number, uint32_t old, uint32_t *sleeps, int64_t slice_ns)
{
    const struct timespec slice = {slice_ns / 1000000000, slice_ns % 1000000000};
    __atomic_store_n(sleeps, 1, __ATOMIC_SEQ_CST);
    if (__atomic_load_n(number, __ATOMIC_SEQ_CST) == old)
        syscall(SYS_futex, number, FUTEX_WAIT, old, &slice, NULL, 0);
    __atomic_store_n(sleeps, 0, __ATOMIC_SEQ_CST);
}

/* Change the number, and wake who sleeps on it. */
static inline void tell(uint32_t *number, uint32_t value, const uint32_t *sleeps)
{
    __atomic_store_n(number, value, __ATOMIC_SEQ_CST);
    if (__atomic_load_n(sleeps, __ATOMIC_SEQ_CST))
        syscall(SYS_futex, number, FUTEX_WAKE, 1, NULL, NULL, 0);
}

#endif
