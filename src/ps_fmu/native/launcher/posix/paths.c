/* Names, paths and environment. */
#include "../platform.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

const char WRAPPER[] = "libpythonfmu-export.so";
const char VENV_PYTHON[] = "bin/python";
const char *const PYTHONS[] = {"python3", NULL};
const char USUAL_PATH[] = "/usr/local/bin:/usr/bin:/bin";
const char LIST_SEPARATOR[] = ":";

char *environment_value(const char *name)
{
    const char *value = getenv(name);
    return value != NULL ? strdup(value) : NULL;
}

bool is_absolute(const char *path)
{
    return path[0] == '/';
}

const char *path_in_uri(const char *uri_path)
{
    return uri_path;
}

char *full_path(const char *path)
{
    return realpath(path, NULL);
}

bool same_file(const char *a, const char *b)
{
    struct stat first, second;
    return stat(a, &first) == 0 && stat(b, &second) == 0 && first.st_dev == second.st_dev &&
           first.st_ino == second.st_ino;
}

FILE *open_for_reading(const char *path)
{
    return fopen(path, "re");
}

bool is_readable(const char *path)
{
    return access(path, R_OK) == 0;
}

bool is_program(const char *path)
{
    return access(path, X_OK) == 0;
}

void add_system_error(Text *reason)
{
    text_add(reason, "%s", strerror(errno));
}

bool make_plain(char **path)
{
    (void)path;
    return true;
}
