#include "fmu.h"

#include <dlfcn.h>
#include <locale.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { MOST_LOGGED = 30 };

int leaving;

static void stay_if_leaving(void)
{
    while (leaving)
        pause();
}

void fail(const char *what)
{
    stay_if_leaving();
    fprintf(stderr, "host: %s\n", what);
    _exit(1);
}

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    static int logged;
    (void)environment;
    EXPECT(name != NULL && category != NULL && status != fmi2Fatal);
    char text[16384];
    va_list arguments; /* as most hosts do: the message is a printf format */
    va_start(arguments, message);
    vsnprintf(text, sizeof text, message, arguments);
    va_end(arguments);
    if (logged++ < MOST_LOGGED)
        fprintf(stderr, "[%s] %d %s: %s\n", name, status, category, text);
}

const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

static size_t references(const char *text, fmi2ValueReference *result)
{
    size_t n = 0;
    char *end;
    for (long value = strtol(text, &end, 10); end != text && n < MOST; value = strtol(text, &end, 10)) {
        result[n++] = (fmi2ValueReference)value;
        text = end;
    }
    return n;
}

void read_fmu(const char *path, Fmu *fmu)
{
    FILE *file = fopen(path, "r");
    char line[2048];
    EXPECT(file != NULL);
    while (fgets(line, sizeof line, file) != NULL) {
        line[strcspn(line, "\n")] = '\0';
        char *value = strchr(line, '=');
        EXPECT(value != NULL);
        *value++ = '\0';
        if (strcmp(line, "library") == 0)
            strncpy(fmu->library, value, sizeof fmu->library - 1);
        else if (strcmp(line, "uri") == 0)
            strncpy(fmu->uri, value, sizeof fmu->uri - 1);
        else if (strcmp(line, "guid") == 0)
            strncpy(fmu->guid, value, sizeof fmu->guid - 1);
        else if (strcmp(line, "step") == 0)
            fmu->step = atof(value);
        else if (strcmp(line, "inputs") == 0)
            fmu->n_inputs = references(value, fmu->inputs);
        else if (strcmp(line, "outputs") == 0)
            fmu->n_outputs = references(value, fmu->outputs);
    }
    fclose(file);
}

void load(Fmu *fmu)
{
    fmu->handle = dlopen(fmu->library, RTLD_NOW | RTLD_LOCAL);
    if (fmu->handle == NULL)
        fail(dlerror());
#define LOAD(name) EXPECT((*(void **)&fmu->name = dlsym(fmu->handle, "fmi2" #name)) != NULL);
    FUNCTIONS(LOAD)
#undef LOAD
}

fmi2Component new_instance(const Fmu *fmu, const char *name)
{
    fmi2Component component = fmu->Instantiate(name, fmi2CoSimulation, fmu->guid, fmu->uri, &callbacks, 0, 1);
    if (component == NULL) {
        stay_if_leaving();
        exit(3);
    }
    return component;
}

static void on_signal(int number)
{
    (void)number;
}

void handle_signals(void)
{
    struct sigaction handler = {.sa_handler = on_signal};
    sigaction(SIGINT, &handler, NULL);
}

void expect_belongings(void)
{
    struct sigaction after;
    sigaction(SIGINT, NULL, &after);
    EXPECT(after.sa_handler == on_signal);
    EXPECT(strcmp(setlocale(LC_CTYPE, NULL), "C") == 0);
    EXPECT(getenv("LC_CTYPE") == NULL);
}
