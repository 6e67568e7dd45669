/* Shared libraries. */
#include "../platform.h"

#include <dlfcn.h>
#include <link.h>
#include <stdlib.h>
#include <string.h>

char *own_folder(void)
{
    Dl_info self;
    char *path = dladdr(WRAPPER, &self) != 0 ? realpath(self.dli_fname, NULL) : NULL;
    char *slash = path != NULL ? strrchr(path, '/') : NULL;
    if (slash != NULL)
        *slash = '\0';
    return path;
}

void *open_library(const char *path, Text *reason)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL)
        text_add(reason, "%s", dlerror());
    return library;
}

void *library_symbol(void *library, const char *name)
{
    return dlsym(library, name);
}

/* For dl_iterate_phdr. */
static int is_libpython(struct dl_phdr_info *info, size_t size, void *result)
{
    (void)size;
    const char *slash = info->dlpi_name != NULL ? strrchr(info->dlpi_name, '/') : NULL;
    if (slash == NULL || strncmp(slash, "/libpython3.", 12) != 0 || strncmp(slash, "/libpython3.so", 14) == 0)
        return 0;
    *(char **)result = strdup(info->dlpi_name);
    return 1;
}

char *loaded_python(void)
{
    char *path = NULL;
    dl_iterate_phdr(is_libpython, &path);
    return path;
}

bool share_python(const char *library, bool is_loaded, Text *reason)
{
    if (is_loaded && python_symbol("Py_IsInitialized") != NULL)
        return true;
    /* A plugin may have loaded Python for itself alone: numpy needs its symbols to be global. */
    if (dlopen(library, RTLD_NOW | RTLD_GLOBAL | (is_loaded ? RTLD_NOLOAD : 0)) == NULL) {
        text_add(reason, "%s", dlerror());
        return false;
    }
    return true;
}

void *python_symbol(const char *name)
{
    return dlsym(RTLD_DEFAULT, name);
}
