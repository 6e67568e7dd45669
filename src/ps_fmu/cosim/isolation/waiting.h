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

/* Whether the number became `wanted` within `spin_ns`.  Other processes that are ready to run get the processor. */
static inline bool spin(const uint32_t *number, uint32_t wanted, int64_t spin_ns)
{
    const int64_t until = now_ns() + spin_ns;
    do {
        for (int k = 0; k < 32; k++) {
            if (__atomic_load_n(number, __ATOMIC_ACQUIRE) == wanted)
                return true;
            pause_briefly();
        }
        sched_yield();
    } while (now_ns() < until);
    return false;
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
