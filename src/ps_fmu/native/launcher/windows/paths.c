/* Names, paths and environment. */
#include "../platform.h"
#include "wide.h"

#include <stdlib.h>
#include <wchar.h>

const char WRAPPER[] = "pythonfmu-export.dll";
const char VENV_PYTHON[] = "Scripts/python.exe";
const char *const PYTHONS[] = {"python.exe", "py.exe", NULL}; /* the second one starts the newest that is installed */
const char USUAL_PATH[] = "";
const char LIST_SEPARATOR[] = ";";

char *environment_value(const char *name)
{
    wchar_t *wide = widened(name), *value = malloc(LONGEST * sizeof *value);
    SetLastError(ERROR_SUCCESS); /* an empty value has length 0 */
    bool set = wide != NULL && value != NULL &&
               (GetEnvironmentVariableW(wide, value, LONGEST) > 0 || GetLastError() == ERROR_SUCCESS);
    char *result = set ? narrowed(value) : NULL;
    free(wide);
    free(value);
    return result;
}

static bool is_slash(char c)
{
    return c == '/' || c == '\\';
}

static bool has_drive(const char *path)
{
    return ((path[0] | 0x20) >= 'a' && (path[0] | 0x20) <= 'z') && path[1] == ':';
}

bool is_absolute(const char *path)
{
    return (has_drive(path) && is_slash(path[2])) || (is_slash(path[0]) && is_slash(path[1]));
}

const char *path_in_uri(const char *uri_path)
{
    return uri_path[0] == '/' && has_drive(uri_path + 1) ? uri_path + 1 : uri_path;
}

static bool exists(const char *path, DWORD unwanted)
{
    wchar_t *wide = widened(path);
    DWORD attributes = wide != NULL ? GetFileAttributesW(wide) : INVALID_FILE_ATTRIBUTES, error = GetLastError();
    free(wide);
    bool wanted = attributes != INVALID_FILE_ATTRIBUTES && (attributes & unwanted) == 0;
    SetLastError(attributes != INVALID_FILE_ATTRIBUTES ? ERROR_FILE_NOT_FOUND : error);
    return wanted;
}

bool is_readable(const char *path)
{
    return exists(path, 0);
}

bool is_program(const char *path)
{
    return exists(path, FILE_ATTRIBUTE_DIRECTORY);
}

void add_system_error(Text *reason)
{
    add_error(reason, GetLastError());
}

char *full_path(const char *path)
{
    wchar_t *wide = widened(path), *full = malloc(LONGEST * sizeof *full);
    bool found = wide != NULL && full != NULL && GetFullPathNameW(wide, LONGEST, full, NULL) > 0 &&
                 GetFileAttributesW(full) != INVALID_FILE_ATTRIBUTES;
    char *result = found ? narrowed(full) : NULL;
    free(wide);
    free(full);
    return result;
}

static bool identity(const char *path, BY_HANDLE_FILE_INFORMATION *information)
{
    wchar_t *wide = widened(path);
    DWORD sharing = FILE_SHARE_READ | FILE_SHARE_WRITE | FILE_SHARE_DELETE;
    HANDLE file = wide != NULL
                      ? CreateFileW(wide, 0, sharing, NULL, OPEN_EXISTING, FILE_FLAG_BACKUP_SEMANTICS, NULL)
                      : INVALID_HANDLE_VALUE;
    bool known = file != INVALID_HANDLE_VALUE && GetFileInformationByHandle(file, information) != 0;
    if (file != INVALID_HANDLE_VALUE)
        CloseHandle(file);
    free(wide);
    return known;
}

bool same_file(const char *a, const char *b)
{
    BY_HANDLE_FILE_INFORMATION first, second;
    return identity(a, &first) && identity(b, &second) && first.dwVolumeSerialNumber == second.dwVolumeSerialNumber &&
           first.nFileIndexHigh == second.nFileIndexHigh && first.nFileIndexLow == second.nFileIndexLow;
}

FILE *open_for_reading(const char *path)
{
    wchar_t *wide = widened(path);
    FILE *file = wide != NULL ? _wfopen(wide, L"rbN") : NULL; /* N: not for child processes */
    free(wide);
    return file;
}

static bool is_ascii(const char *text)
{
    while (*text > 0)
        text++;
    return *text == '\0';
}

bool make_plain(char **path)
{
    if (is_ascii(*path) || GetACP() == CP_UTF8)
        return true;
    wchar_t *wide = with_backslashes(*path), *alias = malloc(LONGEST * sizeof *alias);
    bool found = wide != NULL && alias != NULL && GetShortPathNameW(wide, alias, LONGEST) > 0;
    char *result = found ? narrowed(alias) : NULL;
    bool plain = result != NULL && is_ascii(result);
    if (plain) {
        free(*path);
        *path = result;
    } else {
        free(result);
    }
    free(wide);
    free(alias);
    return plain;
}
