#include "task.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const types[N_TYPES] = {"Real", "Integer", "Boolean", "String"};

/* A variable from "TYPE REFERENCE TEXT". */
static bool add(Variables *of_types, const char *line)
{
    char type[16];
    unsigned reference;
    int used = 0;
    if (sscanf(line, "%15s %u%n", type, &reference, &used) != 2)
        return false;
    line += used + (line[used] == ' ');
    for (int k = 0; k < N_TYPES; k++) {
        if (strcmp(type, types[k]) != 0)
            continue;
        Variables *v = &of_types[k];
        v->references = realloc(v->references, (v->n + 1) * sizeof *v->references);
        v->texts = realloc(v->texts, (v->n + 1) * sizeof *v->texts);
        if (v->references == NULL || v->texts == NULL)
            return false;
        v->references[v->n] = reference;
        v->texts[v->n] = strdup(line);
        v->n++;
        return true;
    }
    return false;
}

static bool take(Task *task, const char *key, const char *value)
{
    if (strcmp(key, "library") == 0)
        task->library = strdup(value);
    else if (strcmp(key, "guid") == 0)
        task->guid = strdup(value);
    else if (strcmp(key, "resources") == 0)
        task->resources = strdup(value);
    else if (strcmp(key, "start") == 0)
        task->start = atof(value);
    else if (strcmp(key, "step") == 0)
        task->step = atof(value);
    else if (strcmp(key, "once") == 0)
        task->once = true;
    else if (strcmp(key, "state") == 0)
        task->state = true;
    else if (strcmp(key, "serialise") == 0)
        task->serialise = true;
    else if (strcmp(key, "output") == 0)
        return add(task->outputs, value);
    else if (strcmp(key, "input") == 0)
        return add(task->inputs, value);
    else
        return false;
    return true;
}

bool task_read(const char *path, Task *task)
{
    FILE *file = fopen(path, "r");
    char *line = NULL;
    size_t size = 0;
    bool good = file != NULL;
    memset(task, 0, sizeof *task);
    while (good && getline(&line, &size, file) >= 0) {
        line[strcspn(line, "\n")] = '\0';
        char *value = line + strcspn(line, " ");
        if (*value != '\0')
            *value++ = '\0';
        good = take(task, line, value);
    }
    good = good && task->library != NULL && task->guid != NULL && task->resources != NULL && task->step > 0.0;
    if (!good)
        fprintf(stderr, "host: %s is no task: %s\n", path, line != NULL ? line : "cannot be read");
    if (file != NULL)
        fclose(file);
    free(line);
    return good;
}
