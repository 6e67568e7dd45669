/* A linear model as an FMU written in C: no more than the benchmark asks for, around the kernel of our launcher.

   resources/model.bin holds the sizes and then the numbers of a slave as it is at its first step (c_fmus.py).  With
   resources/noise.bin, its outputs are noise. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kernel.h"
#include "noise.h"

enum { ALIGNMENT = 64 /* bytes */, LONGEST_PATH = 4096 };

typedef struct {
    Core core; /* first: functions that need nothing else take the instance for it */
    Noise *noise;
} Instance;

typedef struct {
    int64_t n_data, target, n_target, n_rows, n_maps;
} Sizes;

typedef struct {
    int64_t source, target, n_target, n_work, n_blocks, n_columns, n_numbers;
} MapSizes;

/* Memory for n things, on a cache line; NULL if there is none. */
static void *make_room(int64_t n, size_t size)
{
    void *memory = NULL;
    return posix_memalign(&memory, ALIGNMENT, (size_t)(n + 1) * size) == 0 ? memory : NULL;
}

/* The next n things of the file; NULL if they are not there. */
static void *take(FILE *file, int64_t n, size_t size)
{
    void *memory = make_room(n, size);
    return memory != NULL && fread(memory, size, (size_t)n, file) == (size_t)n ? memory : NULL;
}

static bool fill_map(Core *core, Map *map, FILE *file)
{
    MapSizes s;
    if (fread(&s, sizeof s, 1, file) != 1)
        return false;
    map->source = core->data + s.source;
    map->target = core->data + s.target;
    map->n_target = s.n_target;
    map->work = make_room(s.n_work, sizeof(double));
    map->n_blocks = s.n_blocks;
    map->blocks = take(file, s.n_blocks, sizeof(Block));
    map->columns = take(file, s.n_columns, sizeof(int32_t));
    map->numbers = take(file, s.n_numbers, sizeof(double));
    return map->work != NULL && map->blocks != NULL && map->columns != NULL && map->numbers != NULL;
}

static bool fill(Core *core, FILE *file)
{
    Sizes s;
    if (fread(&s, sizeof s, 1, file) != 1 || s.n_maps > MOST_MAPS)
        return false;
    core->n_references = s.n_data;
    core->n_target = s.n_target;
    core->n_rows = s.n_rows;
    core->plain = s.n_maps > 0 ? CORE_MAP : CORE_TABLE;
    core->data = take(file, s.n_data, sizeof(double));
    core->table = take(file, s.n_rows * s.n_target, sizeof(double));
    core->kept_spans = make_room(1, sizeof(Span));
    core->kept_values = make_room(s.n_target, sizeof(double));
    if (core->data == NULL || core->table == NULL || core->kept_spans == NULL || core->kept_values == NULL)
        return false;
    core->target = core->data + s.target;
    for (core->n_maps = 0; core->n_maps < s.n_maps; core->n_maps++)
        if (!fill_map(core, &core->maps[core->n_maps], file))
            return false;
    return true;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)callbacks, (void)visible, (void)logging;
    char path[LONGEST_PATH];
    snprintf(path, sizeof path, "%s/model.bin", resources + strlen("file://"));
    FILE *file = fopen(path, "rb");
    Instance *instance = calloc(1, sizeof *instance);
    if (file == NULL || instance == NULL || !fill(&instance->core, file))
        return NULL;
    fclose(file);
    snprintf(path, sizeof path, "%s/noise.bin", resources + strlen("file://"));
    file = fopen(path, "rb");
    if (file == NULL)
        return instance;
    instance->noise = noise_read(file);
    fclose(file);
    return instance->noise == NULL ? NULL : instance;
}

void fmi2FreeInstance(fmi2Component c)
{
    Core *core = c;
    for (Map *map = core->maps; map < core->maps + core->n_maps; map++) {
        free(map->work);
        free((void *)map->blocks);
        free((void *)map->columns);
        free((void *)map->numbers);
    }
    free(core->data);
    free((void *)core->table);
    free(core->kept_spans);
    free(core->kept_values);
    if (((Instance *)c)->noise != NULL)
        noise_free(((Instance *)c)->noise);
    free(c);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state)
{
    (void)time, (void)no_set_state;
    Instance *instance = c;
    Core *core = c;
    if (instance->noise != NULL)
        noise_compute(instance->noise, (double)(core->count + 1) * step, core->target);
    else if (!kernel_step(core))
        return fmi2Error;
    core->count++;
    return fmi2OK;
}

#define GET(name, type, convert)                                                                                       \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[])                   \
    {                                                                                                                  \
        const Core *core = c;                                                                                          \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (vr[i] >= core->n_references)                                                                           \
                return fmi2Error;                                                                                      \
            value[i] = convert core->data[vr[i]];                                                                      \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }

#define SET(name, type)                                                                                                \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, const type value[])             \
    {                                                                                                                  \
        const Core *core = c;                                                                                          \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (vr[i] >= core->n_references)                                                                           \
                return fmi2Error;                                                                                      \
            core->data[vr[i]] = value[i];                                                                              \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }

GET(Real, fmi2Real, )
GET(Integer, fmi2Integer, (fmi2Integer))
GET(Boolean, fmi2Boolean, 0.0 !=)
SET(Real, fmi2Real)
SET(Integer, fmi2Integer)
SET(Boolean, fmi2Boolean)

/* The state is that of the first step already. */
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)c, (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi2OK;
}

#define NOTHING(name)                                                                                                  \
    fmi2Status fmi2##name(fmi2Component c)                                                                             \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        return fmi2OK;                                                                                                 \
    }

NOTHING(EnterInitializationMode)
NOTHING(ExitInitializationMode)
NOTHING(Terminate)
