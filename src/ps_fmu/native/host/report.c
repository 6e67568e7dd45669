#include "report.h"

#include <stdarg.h>
#include <stdio.h>
#include <unistd.h>

static FILE *file;
static const char *stage;
static int noted; /* the stage has ended, with a problem */

int report_open(const char *path)
{
    file = fopen(path, "w");
    return file != NULL;
}

static void write_line(const char *problem)
{
    fprintf(file, "[\"%s\", ", stage);
    if (problem == NULL) {
        fputs("null]\n", file);
    } else {
        fputc('"', file);
        for (const unsigned char *c = (const unsigned char *)problem; *c != '\0'; c++) {
            if (*c < ' ')
                fprintf(file, "\\u%04x", *c);
            else
                fprintf(file, *c == '"' || *c == '\\' ? "\\%c" : "%c", *c);
        }
        fputs("\"]\n", file);
    }
    fflush(file);
}

void report_stage(const char *name)
{
    if (stage != NULL && !noted)
        write_line("");
    stage = name;
    noted = 0;
    write_line(NULL);
}

static void write_problem(const char *format, va_list arguments)
{
    char problem[4096];
    vsnprintf(problem, sizeof problem, format, arguments);
    write_line(problem);
    noted = 1;
}

void report_note(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_problem(format, arguments);
    va_end(arguments);
}

void report_failure(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_problem(format, arguments);
    va_end(arguments);
    _exit(1);
}
