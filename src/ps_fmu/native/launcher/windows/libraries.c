/* Shared libraries. */
#include "../platform.h"
#include "wide.h"

#include <stdlib.h>
#include <string.h>
#include <wchar.h>

#include <psapi.h>

/* The file of a loaded library. */
static wchar_t *file_of(HMODULE module)
{
    wchar_t *path = malloc(LONGEST * sizeof *path);
    DWORD n = path != NULL ? GetModuleFileNameW(module, path, LONGEST) : 0;
    if (n == 0 || n == LONGEST) {
        free(path);
        return NULL;
    }
    if (wcsncmp(path, L"\\\\?\\", 4) == 0 && path[5] == L':') /* in such a path, a slash is no separator */
        wmemmove(path, path + 4, wcslen(path + 4) + 1);
    return path;
}

char *own_folder(void)
{
    HMODULE module = NULL;
    GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT | GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS,
                       (LPCWSTR)(const void *)WRAPPER, &module);
    wchar_t *path = module != NULL ? file_of(module) : NULL, *slash = path != NULL ? wcsrchr(path, L'\\') : NULL;
    if (slash != NULL)
        *slash = L'\0';
    char *result = path != NULL ? narrowed(path) : NULL;
    free(path);
    return result;
}

void *open_library(const char *path, Text *reason)
{
    wchar_t *wide = with_backslashes(path);
    void *library = wide != NULL ? (void *)LoadLibraryExW(wide, NULL, LOAD_WITH_ALTERED_SEARCH_PATH) : NULL;
    DWORD error = GetLastError();
    free(wide);
    if (library == NULL)
        add_error(reason, error);
    if (library == NULL && error == ERROR_MOD_NOT_FOUND && is_readable(path))
        text_add(reason, "; one that it needs is missing, perhaps MSVCP140.dll of the Microsoft Visual C++ runtime");
    return library;
}

void *library_symbol(void *library, const char *name)
{
    return (void *)GetProcAddress(library, name);
}

/* python311.dll and the like; python3.dll only passes on to them. */
static bool is_python(const wchar_t *path)
{
    const wchar_t *slash = wcsrchr(path, L'\\'), *name = slash != NULL ? slash + 1 : path;
    size_t n = wcslen(name);
    return n > 11 && _wcsnicmp(name, L"python3", 7) == 0 && name[7] >= L'0' && name[7] <= L'9' &&
           _wcsicmp(name + n - 4, L".dll") == 0;
}

static HMODULE python_module(void)
{
    DWORD size = 0;
    HMODULE found = NULL;
    EnumProcessModules(GetCurrentProcess(), NULL, 0, &size);
    size += 64 * sizeof(HMODULE); /* other threads may load some more */
    HMODULE *modules = calloc(1, size);
    DWORD used = 0;
    if (modules != NULL && EnumProcessModules(GetCurrentProcess(), modules, size, &used))
        for (size_t i = 0; i < (used < size ? used : size) / sizeof *modules && found == NULL; i++) {
            wchar_t *path = file_of(modules[i]);
            if (path != NULL && is_python(path))
                found = modules[i];
            free(path);
        }
    free(modules);
    return found;
}

char *loaded_python(void)
{
    HMODULE module = python_module();
    wchar_t *path = module != NULL ? file_of(module) : NULL;
    char *result = path != NULL ? narrowed(path) : NULL;
    free(path);
    return result;
}

static void *python; /* where python_symbol looks */

/* python3.dll, which pythonfmu's library names: the one that is loaded, or else the one beside a python311.dll. */
static void *stable_python(const char *library, Text *reason)
{
    HMODULE loaded = GetModuleHandleW(L"python3.dll");
    const char *slash = strrchr(library, '\\');
    char *path = slash != NULL ? formatted("%.*s\\python3.dll", (int)(slash - library), library) : NULL;
    void *stable = loaded != NULL ? (void *)loaded : path != NULL ? open_library(path, reason) : NULL;
    if (stable == NULL)
        text_add(reason, ": %s, which pythonfmu's library needs", path != NULL ? path : "python3.dll");
    free(path);
    return stable;
}

bool share_python(const char *library, bool is_loaded, Text *reason)
{
    static const char function[] = "Py_IsInitialized";
    (void)is_loaded; /* then it stays for good */
    void *opened = open_library(library, reason), *stable = opened != NULL ? stable_python(library, reason) : NULL;
    if (stable == NULL)
        return false;
    if (library_symbol(stable, function) != library_symbol(opened, function)) {
        text_add(reason, "the process has loaded a python3.dll of another Python");
        return false;
    }
    __atomic_store_n(&python, opened, __ATOMIC_RELEASE);
    return true;
}

void *python_symbol(const char *name)
{
    void *library = __atomic_load_n(&python, __ATOMIC_ACQUIRE);
    if (library == NULL) /* this launcher has not come to Python yet */
        library = python_module();
    return library != NULL ? library_symbol(library, name) : NULL;
}
