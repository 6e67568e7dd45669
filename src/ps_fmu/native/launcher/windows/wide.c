#include "wide.h"

#include <stdlib.h>
#include <wchar.h>

char *narrowed(const wchar_t *text)
{
    int n = WideCharToMultiByte(CP_UTF8, 0, text, -1, NULL, 0, NULL, NULL);
    char *result = n > 0 ? malloc((size_t)n) : NULL;
    if (result != NULL)
        WideCharToMultiByte(CP_UTF8, 0, text, -1, result, n, NULL, NULL);
    return result;
}

void add_error(Text *reason, DWORD error)
{
    wchar_t text[512];
    DWORD flags = FORMAT_MESSAGE_FROM_SYSTEM | FORMAT_MESSAGE_IGNORE_INSERTS;
    DWORD n = FormatMessageW(flags, NULL, error, 0, text, sizeof text / sizeof *text, NULL);
    while (n > 0 && wcschr(L"\r\n. ", text[n - 1]) != NULL)
        n--;
    text[n] = L'\0'; /* n is below the size, since the system ends the text too */
    char *narrow = narrowed(text);
    text_add(reason, "%s (error %lu)", narrow != NULL ? narrow : "", error);
    free(narrow);
}

wchar_t *with_backslashes(const char *path)
{
    wchar_t *result = widened(path);
    for (wchar_t *at = result; at != NULL && *at != L'\0'; at++)
        if (*at == L'/')
            *at = L'\\';
    return result;
}
