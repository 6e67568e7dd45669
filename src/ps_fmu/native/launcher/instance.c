#include "instance.h"

#include "floats.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"
#include "python.h"

/* --- pythonfmu's library ---------------------------------------------------------------------------------------- */

Wrapper wrapper;

static char *binaries; /* folder of this library */

__attribute__((constructor)) static void remember_folder(void)
{
    binaries = own_folder(); /* now, since the path may be relative to the working directory */
}

static bool load_wrapper(Text *why)
{
    if (wrapper.finalise != NULL)
        return true;
    char *path = formatted("%s/%s", binaries, WRAPPER);
    Text reason = {0};
    void *library = path != NULL ? open_library(path, &reason) : NULL;
    free(path);
    if (library == NULL) {
        text_add(why, "pythonfmu's library cannot be loaded: %s", reason.data != NULL ? reason.data : "out of memory");
        text_free(&reason);
        return false;
    }
#define LOAD(name) *(void **)&wrapper.name = library_symbol(library, "fmi2" #name);
    WRAPPED(LOAD)
#undef LOAD
    *(void **)&wrapper.finalise = library_symbol(library, "finalizePythonInterpreter");
    if (wrapper.finalise == NULL)
        text_add(why, "pythonfmu's library lacks finalizePythonInterpreter: another release than 0.7?");
    return wrapper.finalise != NULL;
}

/* --- Instances and their messages ------------------------------------------------------------------------------- */

static bool is_wanted(const Instance *m, const char *category)
{
    for (size_t i = 0; i < m->n_categories; i++)
        if (strcmp(m->categories[i], category) == 0 || strcmp(m->categories[i], "logAll") == 0)
            return true;
    return m->n_categories == 0;
}

static const char *category_of(fmi2Status status)
{
    static const char *const names[] = {"logAll",         "logStatusWarning", "logStatusDiscard",
                                        "logStatusError", "logStatusFatal",   "logStatusPending"};
    return (unsigned)status < sizeof names / sizeof *names ? names[status] : "logAll";
}

/* Receive pythonfmu's messages.  pythonfmu logs all of them; here the categories of the host are selected. */
static void pass_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                         fmi2String message, ...)
{
    static const char fault[] = "Fatal py exception encountered: ";
    const Instance *m = environment;
    if (strncmp(message, fault, sizeof fault - 1) == 0) {
        const char *newline = strchr(message, '\n'); /* guard.py writes what follows; drop the rest */
        message = newline != NULL ? newline + 1 : message;
        status = fmi2Error;
    }
    if (category == NULL || category[0] == '\0')
        category = category_of(status);
    if (m->logging && m->host.logger != NULL && is_wanted(m, category))
        m->host.logger(m->host.componentEnvironment, name, status, category, message);
}

/* Safe as a printf format. */
void instance_tell(const Instance *m, fmi2Status status, const char *text)
{
    const char *category = category_of(status);
    Text safe = {0};
    for (const char *at = text; *at != '\0'; at++)
        text_add_bytes(&safe, *at == '%' ? "%%" : at, *at == '%' ? 2 : 1);
    if (m->logging && m->host.logger != NULL && safe.data != NULL && is_wanted(m, category))
        m->host.logger(m->host.componentEnvironment, m->name, status, category, safe.data);
    text_free(&safe);
}

/* Report an error of the launcher on stderr and, if the host logs, to the host. */
static void say(const Instance *m, const char *text)
{
    fprintf(stderr, "%s: %s\n", m->name, text);
    instance_tell(m, fmi2Error, text);
}

fmi2Status instance_refuse(const Instance *m, const char *function, const char *reason)
{
    char *text = formatted("%s: %s", function, reason);
    say(m, text != NULL ? text : reason);
    free(text);
    return fmi2Error;
}

const char *fault_of_values(size_t n, const void *references, const void *values)
{
    /* More must be a mistake of the host, and pythonfmu crashes when memory runs out. */
    enum { MOST_VALUES = 1 << 24 };
    if (n > 0 && (references == NULL || values == NULL))
        return "there are no values: a list is NULL";
    return n > MOST_VALUES ? "impossible number of values" : NULL;
}

void instance_forget_categories(Instance *m)
{
    for (size_t i = 0; i < m->n_categories; i++)
        free(m->categories[i]);
    free(m->categories);
    m->categories = NULL;
    m->n_categories = 0;
}

/* --- Instantiation ---------------------------------------------------------------------------------------------- */

/* The FMU's folder of resources: the one that the host names or, if that is not usable, the one beside this library's
   folder.  New memory. */
static char *find_resources(const char *uri)
{
    for (int decode = 1; decode >= 0; decode--) {
        char *path = path_of_uri(uri, decode);
        if (path != NULL && has_file(path, "slavemodule.txt"))
            return path;
        free(path);
    }
    char *folder = formatted("%s/../../resources", binaries), *path = folder != NULL ? full_path(folder) : NULL;
    free(folder);
    if (path != NULL && has_file(path, "slavemodule.txt"))
        return path;
    free(path);
    return NULL;
}

/* Without the script pythonfmu crashes. */
static bool is_complete(char **folder, Text *why)
{
    const char *resources = *folder;
    char *path = formatted("%s/slavemodule.txt", resources), *content = path != NULL ? file_text(path) : NULL;
    char *script = content != NULL ? formatted("%.*s.py", (int)strcspn(content, "\r\n"), content) : NULL;
    bool complete = script != NULL && has_file(resources, script);
    if (!complete)
        text_add(why, "the FMU is not complete: %s/%s is missing", resources, script != NULL ? script : "slavemodule.txt");
    else if (strstr(resources, "%20") != NULL || strstr(resources, "file://") != NULL)
        text_add(why, "pythonfmu misreads paths that contain %%20 or file://: unpack the FMU elsewhere than in %s", resources);
    else if (!make_plain(folder))
        text_add(why, "pythonfmu misreads this path: unpack the FMU in an ASCII path, not in %s", resources);
    free(path);
    free(content);
    free(script);
    return why->used == 0;
}

static Needs read_needs(const char *resources)
{
    char *path = formatted("%s/launcher.txt", resources), *content = path != NULL ? file_text(path) : NULL;
    Needs needs = {
        .guid = line_value(content, "guid"),
        .python = line_value(content, "python"),
        .modules = line_value(content, "modules"),
        .interpreter = line_value(content, "interpreter"),
    };
    free(path);
    free(content);
    return needs;
}

static void needs_free(Needs *needs)
{
    free(needs->guid);
    free(needs->python);
    free(needs->modules);
    free(needs->interpreter);
}

/* instance_begin, under the lock. */
static bool begin_locked(Instance *m, const char *guid, const char *uri, fmi2Boolean visible, Text *why)
{
    char *resources = binaries != NULL ? find_resources(uri) : NULL;
    if (resources == NULL) {
        text_add(why, "no resources of this FMU: neither at %s nor beside its binaries in %s", uri != NULL ? uri : "NULL",
                 binaries != NULL ? binaries : "an unknown folder");
        return false;
    }
    Needs needs = read_needs(resources);
    if (needs.guid != NULL && (guid == NULL || strcmp(guid, needs.guid) != 0))
        text_add(why, "the host expects GUID %s, this FMU has %s", guid != NULL ? guid : "NULL", needs.guid);
    else if (is_complete(&resources, why) && python_start(&needs, binaries, why) && load_wrapper(why)) {
        m->generation = python_generation();
        if (python_enter(m->generation)) {
            m->inner = wrapper.Instantiate(m->name, fmi2CoSimulation, guid, resources, &m->callbacks, visible, fmi2True);
            /* Otherwise a destructor of that library releases its state of the interpreter a second time at exit. */
            wrapper.finalise();
            python_leave();
        }
    }
    needs_free(&needs);
    free(resources);
    return m->inner != NULL;
}

bool instance_begin(Instance *m, const char *guid, const char *uri, fmi2Boolean visible, Text *why)
{
    m->callbacks.logger = pass_message;
    m->callbacks.allocateMemory = calloc;
    m->callbacks.freeMemory = free;
    m->callbacks.componentEnvironment = m;
    floats_take(); /* Python may have to start, and numpy to be imported */
    python_lock();
    bool begun = begin_locked(m, guid, uri, visible, why);
    python_unlock();
    floats_give_back();
    return begun;
}

void instance_end(Instance *m)
{
    if (m->inner != NULL && python_enter(m->generation)) { /* otherwise Python was finalised, which ended the instance */
        for (size_t i = 0; i < m->n_states; i++)
            wrapper.FreeFMUstate(m->inner, &m->states[i]);
        wrapper.FreeInstance(m->inner);
        python_leave();
    }
    instance_forget_categories(m);
    free(m->states);
    free(m->name);
    free(m);
}
