/* The lines that calls.c reads and writes, see there: words of a call, and the parts of an answer. */
#ifndef HOST_WORDS_H
#define HOST_WORDS_H

#include <stddef.h>
#include <stdint.h>

#include "fmi2Functions.h"

#define EXPECT(condition) ((condition) ? (void)0 : fail(#condition))

/* End the process with exit code 1. */
void fail(const char *what) __attribute__((noreturn));

/* Begin with a line; its first word. */
char *first_word(char *line);

/* The next word of the line.  There has to be one. */
char *word(void);

int is_null(const char *text);
int number(void);
size_t size(void);
double real(void);

/* New memory of exactly n bytes, so that a sanitizer sees who goes beyond. */
void *room(size_t n);

/* The bytes that a word of hexadecimal digits stands for, and a NUL; NULL for "-".  New memory. */
char *from_hex(const char *text, size_t *n);
char *text_of(const char *text);

/* The items of a list, each put in its place of `width` bytes by `read`; NULL for "-".  n: how many.  New memory. */
typedef void Reader(const char *text, void *place);
void *list(size_t width, Reader *read, size_t *n);
Reader read_reference, read_Real, read_Integer, read_String;
#define read_Boolean read_Integer
void free_texts(char **texts, size_t n);

/* Add to what was got, or to what was logged. */
void begin_answers(void);
void put_Real(fmi2Real value);
void put_Integer(fmi2Integer value);
#define put_Boolean put_Integer
void put_String(fmi2String value);
void put_bytes(const char *bytes, size_t n);
void put_size(size_t value);
void put_address(const void *value);
void put_message(fmi2Status status, const char *category, const char *text);

/* Write the answer: the status, and what was put since the last one. */
void answer(fmi2Status status);

#endif
