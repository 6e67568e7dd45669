/* The library of an FMU that hosts load: it has Python running, and passes calls on to pythonfmu's own library.

   What it adds: hosts need not be prepared for Python; faults that pythonfmu calls fatal are errors, after which the
   instance can be reset or freed; arguments that would crash pythonfmu's library are refused; log messages have a
   category.  Texts that come from Python are safe as printf formats already (see guard.py and slave.py); those made
   here become so in `say`. */
#include "python.h"

#include <dlfcn.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define WRAPPER "libpythonfmu-export.so"
/* In one call; beyond them something is wrong with the host, and pythonfmu does not survive a lack of memory. */
#define MOST_VALUES ((size_t)1 << 24)
#define MOST_BYTES ((size_t)1 << 28)

/* --- pythonfmu's library ---------------------------------------------------------------------------------------- */

#define WRAPPED(X)                                                                                                     \
    X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode)             \
    X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) X(GetString) X(SetReal) X(SetInteger) X(SetBoolean)   \
    X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize) X(SerializeFMUstate)          \
    X(DeSerializeFMUstate) X(DoStep)

static struct {
#define MEMBER(name) fmi2##name##TYPE *name;
    WRAPPED(MEMBER)
#undef MEMBER
    void (*finalise)(void);
} wrapper;

static char *binaries; /* folder of this library */

__attribute__((constructor)) static void remember_folder(void)
{
    Dl_info self; /* now, since the path may be relative to the working directory */
    if (dladdr((void *)&wrapper, &self) != 0)
        binaries = realpath(self.dli_fname, NULL);
    char *slash = binaries != NULL ? strrchr(binaries, '/') : NULL;
    if (slash != NULL)
        *slash = '\0';
}

static bool load_wrapper(Text *why)
{
    if (wrapper.finalise != NULL)
        return true;
    char *path = formatted("%s/" WRAPPER, binaries);
    void *library = path != NULL ? dlopen(path, RTLD_NOW | RTLD_LOCAL) : NULL;
    free(path);
    if (library == NULL) {
        text_add(why, "pythonfmu's library cannot be loaded: %s", dlerror());
        return false;
    }
#define LOAD(name) *(void **)&wrapper.name = dlsym(library, "fmi2" #name);
    WRAPPED(LOAD)
#undef LOAD
    *(void **)&wrapper.finalise = dlsym(library, "finalizePythonInterpreter");
    if (wrapper.finalise == NULL)
        text_add(why, "pythonfmu's library lacks finalizePythonInterpreter: another release than 0.7?");
    return wrapper.finalise != NULL;
}

/* --- Instances and their messages ------------------------------------------------------------------------------- */

typedef struct {
    fmi2Component inner;              /* pythonfmu's */
    fmi2CallbackFunctions callbacks;  /* given to pythonfmu */
    fmi2CallbackFunctions host;
    char *name;
    unsigned long generation;         /* of Python */
    bool logging;
    char **categories;                /* that the host wants; none: all */
    size_t n_categories;
    fmi2FMUstate *states;             /* handed out and not freed yet */
    size_t n_states;
    fmi2Real time;                    /* end of the last successful step */
} Instance;

static bool is_wanted(const Instance *m, const char *category)
{
    for (size_t i = 0; i < m->n_categories; i++)
        if (strcmp(m->categories[i], category) == 0)
            return true;
    return m->n_categories == 0;
}

static const char *category_of(fmi2Status status)
{
    static const char *const names[] = {"logAll",         "logStatusWarning", "logStatusDiscard",
                                        "logStatusError", "logStatusFatal",   "logStatusPending"};
    return (unsigned)status < sizeof names / sizeof *names ? names[status] : "logAll";
}

/* Receives pythonfmu's messages.  It logs all; what the host wants to hear is decided here. */
static void pass_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                         fmi2String message, ...)
{
    static const char fault[] = "Fatal py exception encountered: ";
    const Instance *m = environment;
    if (strncmp(message, fault, sizeof fault - 1) == 0) {
        const char *newline = strchr(message, '\n'); /* what follows is said by guard.py, the rest is noise */
        message = newline != NULL ? newline + 1 : message;
        status = fmi2Error;
    }
    if (category == NULL || category[0] == '\0')
        category = category_of(status);
    if (m->logging && m->host.logger != NULL && is_wanted(m, category))
        m->host.logger(m->host.componentEnvironment, name, status, category, message);
}

/* An error of our own: to the host if it listens, and in any case on stderr. */
static void say(const Instance *m, const char *text)
{
    fprintf(stderr, "%s: %s\n", m->name, text);
    Text safe = {0};
    for (const char *at = text; *at != '\0'; at++)
        text_add_bytes(&safe, *at == '%' ? "%%" : at, *at == '%' ? 2 : 1);
    if (m->logging && m->host.logger != NULL && safe.data != NULL && is_wanted(m, "logStatusError"))
        m->host.logger(m->host.componentEnvironment, m->name, fmi2Error, "logStatusError", safe.data);
    text_free(&safe);
}

static fmi2Status refuse(const Instance *m, const char *function, const char *reason)
{
    char *text = formatted("%s: %s", function, reason);
    say(m, text != NULL ? text : reason);
    free(text);
    return fmi2Error;
}

static void forget_categories(Instance *m)
{
    for (size_t i = 0; i < m->n_categories; i++)
        free(m->categories[i]);
    free(m->categories);
    m->categories = NULL;
    m->n_categories = 0;
}

static void discard(Instance *m)
{
    forget_categories(m);
    free(m->states);
    free(m->name);
    free(m);
}

/* --- Instantiation ---------------------------------------------------------------------------------------------- */

/* The FMU's folder of resources: where the host says, or else where it must be.  New memory. */
static char *find_resources(const char *uri)
{
    for (int decode = 1; decode >= 0; decode--) {
        char *path = path_of_uri(uri, decode);
        if (path != NULL && has_file(path, "slavemodule.txt"))
            return path;
        free(path);
    }
    char *folder = formatted("%s/../../resources", binaries), *path = folder != NULL ? realpath(folder, NULL) : NULL;
    free(folder);
    if (path != NULL && has_file(path, "slavemodule.txt"))
        return path;
    free(path);
    return NULL;
}

/* pythonfmu crashes where the script is missing. */
static bool is_complete(const char *resources, Text *why)
{
    char *path = formatted("%s/slavemodule.txt", resources), *content = path != NULL ? file_text(path) : NULL;
    char *script = content != NULL ? formatted("%.*s.py", (int)strcspn(content, "\r\n"), content) : NULL;
    bool complete = script != NULL && has_file(resources, script);
    if (!complete)
        text_add(why, "the FMU is not complete: %s/%s is missing", resources, script != NULL ? script : "slavemodule.txt");
    else if (strstr(resources, "%20") != NULL || strstr(resources, "file://") != NULL)
        text_add(why, "pythonfmu misreads paths that contain %%20 or file://: unpack the FMU elsewhere than in %s", resources);
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

/* Under the lock.  False with a reason; none if pythonfmu has told it. */
static bool start_inner(Instance *m, const char *guid, const char *uri, fmi2Boolean visible, Text *why)
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
    else if (is_complete(resources, why) && python_start(&needs, binaries, why) && load_wrapper(why)) {
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

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String uri,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *m = calloc(1, sizeof *m);
    if (m == NULL)
        return NULL;
    m->name = strdup(name != NULL ? name : "");
    m->logging = logging != fmi2False;
    if (functions != NULL)
        m->host = *functions;
    m->callbacks.logger = pass_message;
    m->callbacks.allocateMemory = calloc;
    m->callbacks.freeMemory = free;
    m->callbacks.componentEnvironment = m;
    Text why = {0};
    if (m->name == NULL || m->name[0] == '\0' || !is_utf8(m->name))
        text_add(&why, "the instance name is empty or not UTF-8");
    else if (type != fmi2CoSimulation)
        text_add(&why, "this FMU is for co-simulation only");
    else {
        python_lock();
        bool started = start_inner(m, guid, uri, visible, &why);
        python_unlock();
        if (started)
            return m;
    }
    if (why.used > 0)
        refuse(m, "fmi2Instantiate", why.data);
    text_free(&why);
    discard(m);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *m = c;
    if (m == NULL)
        return;
    if (python_enter(m->generation)) { /* otherwise Python has gone, and the instance with it */
        for (size_t i = 0; i < m->n_states; i++)
            wrapper.FreeFMUstate(m->inner, &m->states[i]);
        wrapper.FreeInstance(m->inner);
        python_leave();
    }
    discard(m);
}

/* --- Calls ------------------------------------------------------------------------------------------------------ */

static Instance *enter(fmi2Component c, const char *function)
{
    Instance *m = c;
    if (m == NULL) {
        fprintf(stderr, "%s: called without an instance\n", function);
        return NULL;
    }
    if (!python_enter(m->generation)) {
        if (m->generation != python_generation()) /* otherwise the process is about to end: nobody listens any more */
            refuse(m, function, "not possible any more: the host has finalised Python");
        return NULL;
    }
    return m;
}

/* pythonfmu takes every exception for fatal; guard.py has put right what makes them so. */
static fmi2Status leave(fmi2Status status)
{
    python_leave();
    return status == fmi2Fatal ? fmi2Error : status;
}

#define CALL(inner_call)                                                                                               \
    Instance *m = enter(c, __func__);                                                                                  \
    return m != NULL ? leave(wrapper.inner_call) : fmi2Error

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    fmi2Status status = leave(wrapper.SetupExperiment(m->inner, has_tolerance, tolerance, start, has_stop, stop));
    if (status == fmi2OK)
        m->time = start;
    return status;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    CALL(EnterInitializationMode(m->inner));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    CALL(ExitInitializationMode(m->inner));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    CALL(Terminate(m->inner));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    CALL(Reset(m->inner));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    fmi2Status status = leave(wrapper.DoStep(m->inner, time, step, no_set_state));
    if (status == fmi2OK)
        m->time = time + step;
    return status;
}

static const char *fault_of_values(size_t n, const void *references, const void *values)
{
    if (n > 0 && (references == NULL || values == NULL))
        return "value references or values are NULL";
    return n > MOST_VALUES ? "impossible number of values" : NULL;
}

static const char *fault_of_texts(size_t n, const fmi2String texts[])
{
    for (size_t i = 0; i < n; i++)
        if (texts[i] == NULL || !is_utf8(texts[i]))
            return "a text is NULL or not UTF-8";
    return NULL;
}

#define ACCESS(name, type)                                                                                             \
    fmi2Status fmi2##name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[])                      \
    {                                                                                                                  \
        Instance *m = enter(c, "fmi2" #name);                                                                          \
        if (m == NULL)                                                                                                 \
            return fmi2Error;                                                                                          \
        const char *fault = fault_of_values(n, vr, value);                                                             \
        return leave(fault != NULL ? refuse(m, "fmi2" #name, fault) : wrapper.name(m->inner, vr, n, value));           \
    }

ACCESS(GetReal, fmi2Real)
ACCESS(GetInteger, fmi2Integer)
ACCESS(GetBoolean, fmi2Boolean)
ACCESS(GetString, fmi2String)
ACCESS(SetReal, const fmi2Real)
ACCESS(SetInteger, const fmi2Integer)
ACCESS(SetBoolean, const fmi2Boolean)

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    const char *fault = fault_of_values(n, vr, value);
    if (fault == NULL)
        fault = fault_of_texts(n, value);
    return leave(fault != NULL ? refuse(m, __func__, fault) : wrapper.SetString(m->inner, vr, n, value));
}

/* --- FMU states ------------------------------------------------------------------------------------------------- */

/* Where a state is in the list; n_states if it is none of ours.  From the end: the newest is asked for most. */
static size_t place_of(const Instance *m, fmi2FMUstate state)
{
    for (size_t i = m->n_states; i > 0; i--)
        if (m->states[i - 1] == state)
            return i - 1;
    return m->n_states;
}

static bool is_state(const Instance *m, fmi2FMUstate state)
{
    return state != NULL && place_of(m, state) < m->n_states;
}

static void free_state(Instance *m, fmi2FMUstate state)
{
    m->states[place_of(m, state)] = m->states[m->n_states - 1];
    m->n_states--;
    wrapper.FreeFMUstate(m->inner, &state);
}

/* Hand a new state out, in place of the one that the host had there. */
static fmi2Status hand_out(Instance *m, fmi2FMUstate *place, fmi2FMUstate state)
{
    fmi2FMUstate *states = realloc(m->states, (m->n_states + 1) * sizeof *states);
    if (states == NULL) {
        wrapper.FreeFMUstate(m->inner, &state);
        return refuse(m, "FMU state", "out of memory");
    }
    m->states = states;
    m->states[m->n_states++] = state;
    if (is_state(m, *place) && *place != state)
        free_state(m, *place);
    *place = state;
    return fmi2OK;
}

static const char NO_STATE[] = "this is no FMU state of this instance";

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    if (state == NULL)
        return leave(refuse(m, __func__, "no place for the state"));
    fmi2FMUstate new = NULL;
    fmi2Status status = wrapper.GetFMUstate(m->inner, &new);
    return leave(status == fmi2OK ? hand_out(m, state, new) : status);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    return leave(is_state(m, state) ? wrapper.SetFMUstate(m->inner, state) : refuse(m, __func__, NO_STATE));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    if (state == NULL || *state == NULL)
        return leave(fmi2OK);
    if (!is_state(m, *state))
        return leave(refuse(m, __func__, NO_STATE));
    free_state(m, *state);
    *state = NULL;
    return leave(fmi2OK);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    if (!is_state(m, state) || size == NULL)
        return leave(refuse(m, __func__, NO_STATE));
    return leave(wrapper.SerializedFMUstateSize(m->inner, state, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    if (!is_state(m, state) || bytes == NULL)
        return leave(refuse(m, __func__, NO_STATE));
    size_t needed = 0; /* pythonfmu copies as many bytes as asked for, be there so many or not */
    fmi2Status status = wrapper.SerializedFMUstateSize(m->inner, state, &needed);
    if (status == fmi2OK && size < needed)
        return leave(refuse(m, __func__, "less room than fmi2SerializedFMUstateSize asks for"));
    return leave(status == fmi2OK ? wrapper.SerializeFMUstate(m->inner, state, bytes, needed) : status);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    Instance *m = enter(c, __func__);
    if (m == NULL)
        return fmi2Error;
    if (state == NULL || bytes == NULL || size > MOST_BYTES)
        return leave(refuse(m, __func__, "no bytes, or no place for the state"));
    fmi2FMUstate new = NULL;
    fmi2Status status = wrapper.DeSerializeFMUstate(m->inner, bytes, size, &new);
    return leave(status == fmi2OK ? hand_out(m, state, new) : status);
}

/* --- What needs no Python --------------------------------------------------------------------------------------- */

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean logging, size_t n, const fmi2String categories[])
{
    Instance *m = c;
    if (m == NULL || (n > 0 && categories == NULL))
        return fmi2Error;
    forget_categories(m);
    m->logging = logging != fmi2False;
    m->categories = calloc(n > 0 ? n : 1, sizeof *m->categories);
    for (size_t i = 0; m->categories != NULL && i < n; i++) {
        char *copy = categories[i] != NULL ? strdup(categories[i]) : NULL;
        if (copy != NULL)
            m->categories[m->n_categories++] = copy;
    }
    return fmi2OK;
}

static fmi2Status not_supported(fmi2Component c, const char *function)
{
    return c != NULL ? refuse(c, function, "this FMU does not support it") : fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real direction[],
                                        fmi2Real result[])
{
    (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)direction, (void)result;
    return not_supported(c, __func__);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return not_supported(c, __func__);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return not_supported(c, __func__);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return not_supported(c, __func__);
}

/* Steps are never pending. */
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (c == NULL || value == NULL || kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = ((Instance *)c)->time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (c == NULL || value == NULL || kind != fmi2Terminated)
        return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
