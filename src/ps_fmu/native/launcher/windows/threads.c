/* What the launchers of a process have in common, threads, and the end of the process. */
#include "../platform.h"
#include "wide.h"

#include <corecrt_startup.h>
#include <stdlib.h>
#include <wchar.h>

typedef struct {
    INIT_ONCE once;
    CRITICAL_SECTION lock;
    DWORD thread; /* index of fiber-local storage, whose values are freed by a function */
    long long memory[COMMON_SIZE / sizeof(long long)];
} Common;

static Common *common;

/* A named piece of memory holds the address of what the copies have in common.  The number is the version of its
   layout. */
void *common_memory(void)
{
    wchar_t name[64];
    swprintf(name, 64, L"Local\\ps_fmu_launcher_1_%lu", GetCurrentProcessId());
    HANDLE memory = CreateFileMappingW(INVALID_HANDLE_VALUE, NULL, PAGE_READWRITE, 0, sizeof common, name);
    Common **place = memory != NULL ? MapViewOfFile(memory, FILE_MAP_WRITE, 0, 0, sizeof common) : NULL;
    Common *mine = calloc(1, sizeof *mine), *first = NULL;
    if (place != NULL && !__atomic_compare_exchange_n(place, &first, mine, false, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST)) {
        free(mine);
        mine = first;
    }
    common = mine;
    return common->memory;
}

/* From then on this is the only thread, and locks may belong to those that are no more. */
static bool process_is_ending(void)
{
    BOOLEAN(WINAPI * is_ending)(void);
    *(void **)&is_ending = library_symbol(GetModuleHandleW(L"ntdll.dll"), "RtlDllShutdownInProgress");
    return is_ending();
}

static void WINAPI end_of_thread(void *pointer)
{
    if (pointer != NULL && !process_is_ending())
        on_thread_end(pointer);
}

static BOOL WINAPI create_common(INIT_ONCE *once, void *parameter, void **context)
{
    (void)once, (void)parameter, (void)context;
    InitializeCriticalSection(&common->lock);
    common->thread = FlsAlloc(end_of_thread);
    return TRUE;
}

void set_up_common(void)
{
    HMODULE own; /* has to stay: Python and the process will call functions of it */
    GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_PIN | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, (LPCWSTR)(void *)&common,
                       &own);
    InitOnceExecuteOnce(&common->once, create_common, NULL, NULL);
}

bool common_try_lock(void)
{
    return TryEnterCriticalSection(&common->lock) != 0;
}

void common_lock(void)
{
    EnterCriticalSection(&common->lock);
}

void common_unlock(void)
{
    LeaveCriticalSection(&common->lock);
}

void *thread_pointer(void)
{
    return FlsGetValue(common->thread);
}

void set_thread_pointer(void *pointer)
{
    FlsSetValue(common->thread, pointer);
}

unsigned long thread_id(void)
{
    return GetCurrentThreadId();
}

void sleep_a_millisecond(void)
{
    Sleep(1);
}

static void (*exit_function)(void);

static void run_exit_function(void)
{
    if (!process_is_ending())
        exit_function();
}

/* Called by exit() of a program that uses the same C library; atexit() of a library is called when the process ends. */
void at_exit_of_process(void (*function)(void))
{
    exit_function = function;
    _crt_atexit(run_exit_function);
}
