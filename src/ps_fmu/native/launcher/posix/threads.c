/* What the launchers of a process have in common, threads, and the end of the process. */
#include "../platform.h"

#include <pthread.h>
#include <stdlib.h>
#include <time.h>

/* A symbol of the kind "unique" is one for the whole process, even where hosts load with RTLD_LOCAL.  The number is the
   version of this layout. */
typedef struct {
    pthread_once_t once;
    pthread_mutex_t lock;
    pthread_key_t thread;
    long long memory[COMMON_SIZE / sizeof(long long)];
} Common;

extern __attribute__((visibility("default"))) Common ps_fmu_launcher_1;
__asm__(".pushsection .bss.ps_fmu_launcher_1,\"aw\",@nobits\n"
        ".balign 64\n"
        ".globl ps_fmu_launcher_1\n"
        ".type ps_fmu_launcher_1,@gnu_unique_object\n"
        ".size ps_fmu_launcher_1,256\n"
        "ps_fmu_launcher_1: .zero 256\n"
        ".popsection");
#define common ps_fmu_launcher_1
typedef char common_fits[sizeof(Common) <= 256 ? 1 : -1];

static void create_common(void)
{
    pthread_mutexattr_t recursive;
    pthread_mutexattr_init(&recursive);
    pthread_mutexattr_settype(&recursive, PTHREAD_MUTEX_RECURSIVE);
    pthread_mutex_init(&common.lock, &recursive);
    pthread_mutexattr_destroy(&recursive);
    pthread_key_create(&common.thread, on_thread_end);
}

void *common_memory(void)
{
    return common.memory;
}

void set_up_common(void)
{
    pthread_once(&common.once, create_common);
}

bool common_try_lock(void)
{
    return pthread_mutex_trylock(&common.lock) == 0;
}

void common_lock(void)
{
    pthread_mutex_lock(&common.lock);
}

void common_unlock(void)
{
    pthread_mutex_unlock(&common.lock);
}

void *thread_pointer(void)
{
    return pthread_getspecific(common.thread);
}

void set_thread_pointer(void *pointer)
{
    pthread_setspecific(common.thread, pointer);
}

unsigned long thread_id(void)
{
    return (unsigned long)pthread_self();
}

void sleep_a_millisecond(void)
{
    const struct timespec millisecond = {.tv_nsec = 1000000};
    nanosleep(&millisecond, NULL);
}

void at_exit_of_process(void (*function)(void))
{
    atexit(function);
}
