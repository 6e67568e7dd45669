#include "text.h"

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "platform.h"

enum { LARGEST_FILE = 1 << 20 }; /* bytes */

static bool text_reserve(Text *text, size_t more)
{
    size_t size = text->used + more + 1;
    if (size <= text->size)
        return true;
    size += size / 2;
    char *data = realloc(text->data, size);
    if (data == NULL)
        return false;
    text->data = data;
    text->size = size;
    return true;
}

void text_add_bytes(Text *text, const char *bytes, size_t n)
{
    if (!text_reserve(text, n))
        return;
    memcpy(text->data + text->used, bytes, n);
    text->used += n;
    text->data[text->used] = '\0';
}

void text_add(Text *text, const char *format, ...)
{
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    int n = vsnprintf(NULL, 0, format, arguments);
    if (n >= 0 && text_reserve(text, (size_t)n)) {
        vsnprintf(text->data + text->used, (size_t)n + 1, format, again);
        text->used += (size_t)n;
    }
    va_end(again);
    va_end(arguments);
}

void text_free(Text *text)
{
    free(text->data);
    memset(text, 0, sizeof *text);
}

char *formatted(const char *format, ...)
{
    va_list arguments;
    char *result = NULL;
    va_start(arguments, format);
    if (vasprintf(&result, format, arguments) < 0)
        result = NULL;
    va_end(arguments);
    return result;
}

char *line_value(const char *lines, const char *key)
{
    size_t n = strlen(key);
    for (const char *line = lines; line != NULL && *line != '\0';) {
        const char *end = strchr(line, '\n');
        if (strncmp(line, key, n) == 0 && line[n] == '=') {
            const char *value = line + n + 1;
            return strndup(value, end != NULL ? (size_t)(end - value) : strlen(value));
        }
        line = end != NULL ? end + 1 : NULL;
    }
    return NULL;
}

char *file_text(const char *path)
{
    FILE *file = open_for_reading(path);
    if (file == NULL)
        return NULL;
    Text text = {0};
    char part[4096];
    size_t n;
    while ((n = fread(part, 1, sizeof part, file)) > 0 && text.used < LARGEST_FILE)
        text_add_bytes(&text, part, n);
    bool complete = feof(file) && !ferror(file);
    fclose(file);
    if (!complete || text.data == NULL) {
        text_free(&text);
        return complete ? strdup("") : NULL;
    }
    return text.data;
}

bool has_file(const char *folder, const char *name)
{
    char *path = formatted("%s/%s", folder, name);
    bool found = path != NULL && is_readable(path);
    free(path);
    return found;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    c |= 0x20;
    return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

static void decode_escapes(char *text)
{
    char *to = text;
    for (const char *from = text; *from != '\0'; from++) {
        int high = *from == '%' ? hex_digit(from[1]) : -1;
        int low = high >= 0 ? hex_digit(from[2]) : -1;
        if (low >= 0 && (high | low) != 0) { /* an escaped NUL would cut the path short: it stays as it is */
            *to++ = (char)(16 * high + low);
            from += 2;
        } else {
            *to++ = *from;
        }
    }
    *to = '\0';
}

char *path_of_uri(const char *uri, bool decode)
{
    if (uri == NULL)
        return NULL;
    bool has_scheme = strncasecmp(uri, "file:", 5) == 0;
    const char *path = has_scheme ? uri + 5 : uri;
    if (has_scheme && strncmp(path, "//", 2) == 0) {
        path += 2;
        if (strncasecmp(path, "localhost/", 10) == 0)
            path += 9;
    }
    if (has_scheme)
        path = path_in_uri(path);
    if (!is_absolute(path))
        return NULL; /* another scheme, another machine, or a relative path */
    char *result = strdup(path);
    if (result == NULL)
        return NULL;
    if (decode)
        decode_escapes(result);
    for (size_t n = strlen(result); n > 1 && result[n - 1] == '/'; n--)
        result[n - 1] = '\0';
    return result;
}

/* The code point at text[0], whose length goes to n; -1 if there is none. */
static long code_point(const unsigned char *text, int *n)
{
    static const long smallest[] = {0, 0, 0x80, 0x800, 0x10000};
    unsigned char first = text[0];
    *n = first < 0x80 ? 1 : first >> 5 == 0x6 ? 2 : first >> 4 == 0xe ? 3 : first >> 3 == 0x1e ? 4 : 0;
    if (*n == 0)
        return -1;
    long code = *n == 1 ? first : first & (0x7f >> *n);
    for (int i = 1; i < *n; i++) {
        if (text[i] >> 6 != 0x2) /* the NUL at the end is none either */
            return -1;
        code = code << 6 | (text[i] & 0x3f);
    }
    return code < smallest[*n] || code > 0x10ffff || (code >= 0xd800 && code <= 0xdfff) ? -1 : code;
}

bool is_utf8(const char *text)
{
    int n;
    for (const unsigned char *at = (const unsigned char *)text; *at != '\0'; at += n)
        if (code_point(at, &n) < 0)
            return false;
    return true;
}

wchar_t *widened(const char *text)
{
    wchar_t *result = malloc((strlen(text) + 1) * sizeof *result);
    if (result == NULL)
        return NULL;
    wchar_t *to = result;
    int n;
    for (const unsigned char *at = (const unsigned char *)text; *at != '\0'; at += n) {
        long code = code_point(at, &n);
        if (code < 0) {
            code = 0xdc00 + *at;
            n = 1;
        }
        if (code > 0xffff && sizeof(wchar_t) == 2) { /* UTF-16 */
            *to++ = (wchar_t)(0xd7c0 + (code >> 10));
            code = 0xdc00 + (code & 0x3ff);
        }
        *to++ = (wchar_t)code;
    }
    *to = L'\0';
    return result;
}
