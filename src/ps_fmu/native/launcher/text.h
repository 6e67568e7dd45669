/* Texts, files and paths. */
#ifndef PS_FMU_TEXT_H
#define PS_FMU_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <wchar.h>

/* A text that grows; all zero is the empty one.  Where memory is short it ends early. */
typedef struct {
    char *data;
    size_t used, size;
} Text;

void text_add(Text *text, const char *format, ...) __attribute__((format(printf, 2, 3)));
void text_add_bytes(Text *text, const char *bytes, size_t n);
void text_free(Text *text);

/* As sprintf, into new memory; NULL where memory is short. */
char *formatted(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The value of "key=value" in a text of such lines, as new memory; NULL if there is none. */
char *line_value(const char *lines, const char *key);

/* A file's content, as new memory; NULL if it cannot be read or is above 1 MB. */
char *file_text(const char *path);

/* Does the folder hold a readable file of this name? */
bool has_file(const char *folder, const char *name);

/* The absolute path that a file URI (file:/p, file:///p, file://localhost/p, escapes) or a plain path stands for, as
   new memory and without a slash at its end; NULL if it is none.  With decode == false, escapes are left as they are. */
char *path_of_uri(const char *uri, bool decode);

/* Is the text UTF-8, as Python's decoder wants it: no surrogates, no overlong forms? */
bool is_utf8(const char *text);

/* The text as UTF-32 or UTF-16, whichever wchar_t holds (new memory), bytes that are not UTF-8 as Python's
   surrogateescape has them. */
wchar_t *widened(const char *text);

#endif
