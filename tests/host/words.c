#include "words.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void fail(const char *what)
{
    fprintf(stderr, "calls: %s\n", what);
    _Exit(1);
}

/* --- Words ------------------------------------------------------------------------------------------------------ */

char *first_word(char *line)
{
    return strtok(line, " \n");
}

char *word(void)
{
    char *found = strtok(NULL, " \n");
    EXPECT(found != NULL);
    return found;
}

int is_null(const char *text)
{
    return strcmp(text, "-") == 0;
}

int number(void)
{
    return (int)strtol(word(), NULL, 10);
}

size_t size(void)
{
    return strtoull(word(), NULL, 10);
}

static double from_bits(const char *text)
{
    uint64_t bits = strtoull(text, NULL, 16);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

double real(void)
{
    return from_bits(word());
}

void *room(size_t n)
{
    void *memory = malloc(n);
    EXPECT(memory != NULL || n == 0);
    return memory;
}

char *from_hex(const char *text, size_t *n)
{
    *n = 0;
    if (is_null(text))
        return NULL;
    *n = strlen(text + 1) / 2;
    char *bytes = room(*n + 1);
    for (size_t i = 0; i < *n; i++) {
        const char pair[] = {text[1 + 2 * i], text[2 + 2 * i], '\0'};
        bytes[i] = (char)strtol(pair, NULL, 16);
    }
    bytes[*n] = '\0';
    return bytes;
}

char *text_of(const char *text)
{
    size_t n;
    return from_hex(text, &n);
}

void *list(size_t width, Reader *read, size_t *n)
{
    char *text = word(), *rest = NULL;
    *n = 0;
    if (is_null(text))
        return NULL;
    size_t most = 1;
    for (const char *at = text; *at != '\0'; at++)
        most += *at == ',';
    char *items = room(most * width);
    for (char *item = strtok_r(text + 1, ",", &rest); item != NULL; item = strtok_r(NULL, ",", &rest))
        read(item, items + width * (*n)++);
    return realloc(items, *n > 0 ? *n * width : 1);
}

void read_reference(const char *text, void *place)
{
    *(fmi2ValueReference *)place = (fmi2ValueReference)strtoul(text, NULL, 10);
}

void read_Real(const char *text, void *place)
{
    *(fmi2Real *)place = from_bits(text);
}

void read_Integer(const char *text, void *place)
{
    *(fmi2Integer *)place = (fmi2Integer)strtol(text, NULL, 10);
}

void read_String(const char *text, void *place)
{
    *(char **)place = text_of(text);
}

void free_texts(char **texts, size_t n)
{
    for (size_t i = 0; i < n; i++)
        free(texts[i]);
    free(texts);
}

/* --- Answers ---------------------------------------------------------------------------------------------------- */

static FILE *got, *logged; /* memory; the two parts of an answer */
static char *got_text, *logged_text;
static size_t got_size, logged_size;

void begin_answers(void)
{
    got = open_memstream(&got_text, &got_size);
    logged = open_memstream(&logged_text, &logged_size);
    EXPECT(got != NULL && logged != NULL);
}

static void put_hex(FILE *file, const char *bytes, size_t n)
{
    fputs(" x", file);
    for (size_t i = 0; i < n; i++)
        fprintf(file, "%02x", (unsigned char)bytes[i]);
}

void put_Real(fmi2Real value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    fprintf(got, " %016" PRIx64, bits);
}

void put_Integer(fmi2Integer value)
{
    fprintf(got, " %d", value);
}

void put_String(fmi2String value)
{
    put_hex(got, value, strlen(value));
}

void put_bytes(const char *bytes, size_t n)
{
    put_hex(got, bytes, n);
}

void put_size(size_t value)
{
    fprintf(got, " %zu", value);
}

void put_address(const void *value)
{
    fprintf(got, " %" PRIxPTR, (uintptr_t)value);
}

void put_message(fmi2Status status, const char *category, const char *text)
{
    fprintf(logged, "\t%d", status);
    put_hex(logged, category, strlen(category));
    put_hex(logged, text, strlen(text));
}

void answer(fmi2Status status)
{
    fflush(got);
    fflush(logged);
    printf("%d%.*s%.*s\n", status, (int)got_size, got_text, (int)logged_size, logged_text);
    fflush(stdout);
    rewind(got);
    rewind(logged);
}
