#include "wired.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* --- The system's file ------------------------------------------------------------------------------------------ */

static void add_variable(Variables *v, size_t instance, char type, fmi2ValueReference reference)
{
    size_t i = v->n++, first = i;
    EXPECT(i < MOST_VARIABLES && strchr("RIB", type) != NULL);
    v->instance[i] = instance;
    v->type[i] = type;
    v->reference[i] = reference;
    while (first > 0 && v->instance[first - 1] == instance && v->type[first - 1] == type)
        first--;
    v->neighbours[first] = i - first + 1;
}

static void add_group(Group *group, const char *words)
{
    char *end;
    group->passes = (int)strtol(words, &end, 10);
    for (words = end; *words == ' '; words = end) {
        EXPECT(group->n < MOST_VARIABLES);
        group->inputs[group->n++] = strtoul(words, &end, 10);
    }
}

static void read_line(System *s, const char *line)
{
    Set set = {.step = 0};
    size_t source;
    char name[64], path[1024];
    int at = 0; /* where a value begins: it may hold blanks, or be empty */
    if (sscanf(line, "step %lf", &s->step) == 1)
        return;
    if (sscanf(line, "fmu %63s %1023[^\n]", name, path) == 2) {
        EXPECT(s->n_instances < MOST_INSTANCES);
        strcpy(s->names[s->n_instances], name);
        read_fmu(path, &s->fmus[s->n_instances++]);
    } else if (sscanf(line, "set %ld %zu %15s %u%n", &set.step, &set.instance, set.type, &set.reference, &at) == 4) {
        EXPECT(s->n_sets < MOST_SETS && line[at] == ' ' && strlen(line + at) <= sizeof set.value);
        strcpy(set.value, line + at + 1);
        s->sets[s->n_sets++] = set;
    } else if (sscanf(line, "output %zu %15s %u", &set.instance, set.type, &set.reference) == 3) {
        add_variable(&s->outputs, set.instance, set.type[0], set.reference);
    } else if (sscanf(line, "input %zu %15s %u %zu", &set.instance, set.type, &set.reference, &source) == 4) {
        s->sources[s->inputs.n] = source;
        add_variable(&s->inputs, set.instance, set.type[0], set.reference);
    } else if (strncmp(line, "initial ", 8) == 0) {
        EXPECT(s->n_groups < MOST_GROUPS);
        add_group(&s->groups[s->n_groups++], line + 8);
    } else {
        fail(line);
    }
}

void read_system(const char *path, System *s)
{
    FILE *file = fopen(path, "r");
    char line[2048];
    EXPECT(file != NULL);
    while (fgets(line, sizeof line, file) != NULL) {
        line[strcspn(line, "\n")] = '\0';
        read_line(s, line);
    }
    fclose(file);
}

/* --- Values ----------------------------------------------------------------------------------------------------- */

static void get(System *s, size_t first, size_t n)
{
    Variables *v = &s->outputs;
    const Fmu *f = &s->fmus[v->instance[first]];
    fmi2Component c = s->components[v->instance[first]];
    const fmi2ValueReference *references = &v->reference[first];
    if (v->type[first] == 'R')
        EXPECT(f->GetReal(c, references, n, &v->real[first]) == fmi2OK);
    else if (v->type[first] == 'I')
        EXPECT(f->GetInteger(c, references, n, &v->whole[first]) == fmi2OK);
    else
        EXPECT(f->GetBoolean(c, references, n, &v->whole[first]) == fmi2OK);
}

static void set(System *s, size_t first, size_t n)
{
    Variables *v = &s->inputs;
    const Fmu *f = &s->fmus[v->instance[first]];
    fmi2Component c = s->components[v->instance[first]];
    const fmi2ValueReference *references = &v->reference[first];
    if (v->type[first] == 'R')
        EXPECT(f->SetReal(c, references, n, &v->real[first]) == fmi2OK);
    else if (v->type[first] == 'I')
        EXPECT(f->SetInteger(c, references, n, &v->whole[first]) == fmi2OK);
    else
        EXPECT(f->SetBoolean(c, references, n, &v->whole[first]) == fmi2OK);
}

void get_outputs(System *s)
{
    for (size_t i = 0; i < s->outputs.n; i += s->outputs.neighbours[i])
        get(s, i, s->outputs.neighbours[i]);
}

static void fetch(System *s, size_t input)
{
    s->inputs.real[input] = s->outputs.real[s->sources[input]];
    s->inputs.whole[input] = s->outputs.whole[s->sources[input]];
}

static void set_given(const System *s, const Set *given)
{
    const Fmu *f = &s->fmus[given->instance];
    fmi2Component c = s->components[given->instance];
    fmi2Real real = strtod(given->value, NULL);
    fmi2Integer whole = atoi(given->value);
    fmi2String text = given->value;
    switch (given->type[0]) {
    case 'R':
        EXPECT(f->SetReal(c, &given->reference, 1, &real) == fmi2OK);
        return;
    case 'I':
        EXPECT(f->SetInteger(c, &given->reference, 1, &whole) == fmi2OK);
        return;
    case 'B':
        EXPECT(f->SetBoolean(c, &given->reference, 1, &whole) == fmi2OK);
        return;
    default:
        EXPECT(f->SetString(c, &given->reference, 1, &text) == fmi2OK);
    }
}

static void set_all_given(const System *s, long step)
{
    for (size_t i = 0; i < s->n_sets; i++)
        if (s->sets[i].step == step)
            set_given(s, &s->sets[i]);
}

/* All outputs at the communication point. */
void row(const System *s, double *values)
{
    const Variables *v = &s->outputs;
    for (size_t i = 0; i < v->n; i++)
        values[i] = v->type[i] == 'R' ? v->real[i] : v->whole[i];
}

/* --- The life of a system --------------------------------------------------------------------------------------- */

void load_all(System *s)
{
    for (size_t i = 0; i < s->n_instances; i++)
        load(&s->fmus[i]);
}

void unload_all(System *s)
{
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(dlclose(s->fmus[i].handle) == 0);
}

void begin(System *s)
{
    for (size_t i = 0; i < s->n_instances; i++)
        s->components[i] = new_instance(&s->fmus[i], s->names[i]);
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].SetupExperiment(s->components[i], 0, 0.0, 0.0, 0, 0.0) == fmi2OK);
    set_all_given(s, -1);
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].EnterInitializationMode(s->components[i]) == fmi2OK);
    for (const Group *group = s->groups; group < s->groups + s->n_groups; group++)
        for (int pass = 0; pass < group->passes; pass++) {
            for (size_t k = 0; k < group->n; k++) {
                get(s, s->sources[group->inputs[k]], 1);
                fetch(s, group->inputs[k]);
            }
            for (size_t k = 0; k < group->n; k++)
                set(s, group->inputs[k], 1);
        }
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].ExitInitializationMode(s->components[i]) == fmi2OK);
    get_outputs(s);
    s->index = 0;
}

static void step(System *s)
{
    set_all_given(s, s->index);
    for (size_t i = 0; i < s->inputs.n; i++)
        fetch(s, i);
    for (size_t i = 0; i < s->inputs.n; i += s->inputs.neighbours[i])
        set(s, i, s->inputs.neighbours[i]);
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].DoStep(s->components[i], (double)s->index * s->step, s->step, fmi2True) == fmi2OK);
    get_outputs(s);
    s->index++;
}

void advance(System *s, long n)
{
    for (long end = s->index + n; s->index < end;)
        step(s);
}

void end(System *s)
{
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].Terminate(s->components[i]) == fmi2OK);
    for (size_t i = 0; i < s->n_instances; i++)
        s->fmus[i].FreeInstance(s->components[i]);
}
