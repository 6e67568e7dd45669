/* Running a program. */
#include "../platform.h"
#include "wide.h"

#include <stdlib.h>
#include <wchar.h>

/* One more argument of a command line, such that the C library of the program gets it as it is. */
static void add_argument(Text *command, const char *argument)
{
    text_add(command, command->used > 0 ? " \"" : "\"");
    size_t backslashes = 0;
    for (const char *at = argument; *at != '\0'; at++) {
        for (size_t i = 0; *at == '"' && i < backslashes + 1; i++)
            text_add_bytes(command, "\\", 1);
        backslashes = *at == '\\' ? backslashes + 1 : 0;
        text_add_bytes(command, at, 1);
    }
    for (size_t i = 0; i < backslashes; i++)
        text_add_bytes(command, "\\", 1);
    text_add(command, "\"");
}

static wchar_t *command_line(char *const arguments[])
{
    Text command = {0};
    for (size_t i = 0; arguments[i] != NULL; i++)
        add_argument(&command, arguments[i]);
    wchar_t *result = command.data != NULL ? widened(command.data) : NULL;
    text_free(&command);
    return result;
}

static wchar_t *child_environment(void)
{
    wchar_t *all = GetEnvironmentStringsW(), *end = all;
    while (end != NULL && *end != L'\0')
        end += wcslen(end) + 1;
    wchar_t *result = all != NULL ? calloc((size_t)(end - all) + 2, sizeof *result) : NULL, *to = result;
    for (const wchar_t *from = all; result != NULL && *from != L'\0'; from += wcslen(from) + 1)
        if (_wcsnicmp(from, L"PYTHON", 6) != 0 && _wcsnicmp(from, L"__PYVENV", 8) != 0 &&
            _wcsnicmp(from, L"VIRTUAL_ENV=", 12) != 0) { /* py.exe would follow it, also to a relative path */
            wcscpy(to, from);
            to += wcslen(to) + 1;
        }
    if (all != NULL)
        FreeEnvironmentStringsW(all);
    return result;
}

/* Start a program that inherits two handles and nothing else of the host; false if that fails. */
static bool start(char *const arguments[], HANDLE input, HANDLE output, PROCESS_INFORMATION *process)
{
    HANDLE inherited[] = {input, output};
    STARTUPINFOEXW startup = {.StartupInfo = {.cb = sizeof startup,
                                              .dwFlags = STARTF_USESTDHANDLES,
                                              .hStdInput = input,
                                              .hStdOutput = output,
                                              .hStdError = output}};
    SIZE_T size = 0;
    InitializeProcThreadAttributeList(NULL, 1, 0, &size);
    wchar_t *program = with_backslashes(arguments[0]), *command = command_line(arguments);
    wchar_t *environment = child_environment();
    startup.lpAttributeList = malloc(size);
    bool started = false;
    SetLastError(ERROR_NOT_ENOUGH_MEMORY);
    if (program != NULL && command != NULL && environment != NULL && startup.lpAttributeList != NULL &&
        InitializeProcThreadAttributeList(startup.lpAttributeList, 1, 0, &size)) {
        started = UpdateProcThreadAttribute(startup.lpAttributeList, 0, PROC_THREAD_ATTRIBUTE_HANDLE_LIST, inherited,
                                            sizeof inherited, NULL, NULL) &&
                  CreateProcessW(program, command, NULL, NULL, TRUE,
                                 CREATE_NO_WINDOW | CREATE_UNICODE_ENVIRONMENT | EXTENDED_STARTUPINFO_PRESENT,
                                 environment, NULL, &startup.StartupInfo, process);
        DWORD error = GetLastError();
        DeleteProcThreadAttributeList(startup.lpAttributeList);
        SetLastError(error);
    }
    DWORD error = GetLastError();
    free(program);
    free(command);
    free(environment);
    free(startup.lpAttributeList);
    SetLastError(error);
    return started;
}

/* Collect what the child prints until it ends or closes its output.  False if that lasts until the time `end`. */
static bool read_output(HANDLE input, HANDLE process, ULONGLONG end, size_t most, Text *output)
{
    enum { PAUSE = 5 }; /* ms; a pipe cannot be waited for */
    while (GetTickCount64() < end) {
        bool ended = WaitForSingleObject(process, 0) == WAIT_OBJECT_0;
        char part[4096];
        DWORD size = 0;
        if (!PeekNamedPipe(input, NULL, 0, NULL, &size, NULL))
            return true;
        if (size > 0) {
            if (!ReadFile(input, part, sizeof part, &size, NULL))
                return true;
            if (output->used < most)
                text_add_bytes(output, part, size);
        } else if (ended) {
            return true;
        } else {
            WaitForSingleObject(process, PAUSE);
        }
    }
    return false;
}

/* Wait for the child to end.  False if it still runs at the time `end`. */
static bool wait_until(HANDLE process, ULONGLONG end)
{
    ULONGLONG now = GetTickCount64();
    return WaitForSingleObject(process, now < end ? (DWORD)(end - now) : 0) == WAIT_OBJECT_0;
}

bool run_program(char *const arguments[], int timeout, size_t most_output, Text *output, Text *reason)
{
    SECURITY_ATTRIBUTES inheritable = {.nLength = sizeof inheritable, .bInheritHandle = TRUE};
    HANDLE input = NULL, to_child = NULL;
    HANDLE nothing = CreateFileW(L"NUL", GENERIC_READ, FILE_SHARE_READ | FILE_SHARE_WRITE, &inheritable, OPEN_EXISTING,
                                 0, NULL);
    PROCESS_INFORMATION process;
    ULONGLONG end = GetTickCount64() + 1000ULL * (unsigned)timeout;
    if (nothing == INVALID_HANDLE_VALUE || !CreatePipe(&input, &to_child, &inheritable, 0)) {
        text_add(reason, "no pipe: ");
        add_system_error(reason);
    } else if (!SetHandleInformation(input, HANDLE_FLAG_INHERIT, 0) || !start(arguments, nothing, to_child, &process)) {
        text_add(reason, "cannot be started: ");
        add_system_error(reason);
    } else {
        CloseHandle(to_child);
        to_child = NULL;
        if (!read_output(input, process.hProcess, end, most_output, output) || !wait_until(process.hProcess, end)) {
            TerminateProcess(process.hProcess, 1);
            text_add(reason, "did not end within %d s", timeout);
        }
        CloseHandle(process.hThread);
        CloseHandle(process.hProcess);
    }
    if (nothing != INVALID_HANDLE_VALUE)
        CloseHandle(nothing);
    if (to_child != NULL)
        CloseHandle(to_child);
    if (input != NULL)
        CloseHandle(input);
    return reason->used == 0;
}
