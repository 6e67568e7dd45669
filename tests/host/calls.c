/* Makes the FMI calls that the other end of a pipe asks for, one in a line, and answers each with a line.

   calls LIBRARY

   Instantiate I NAME TYPE GUID URI CALLBACKS LOGGING      I: place of an instance, 0 to 7, or - for NULL
   FreeInstance I, EnterInitializationMode I, ExitInitializationMode I, Terminate I, Reset I
   SetupExperiment I DEFINED TOLERANCE START DEFINED STOP,  DoStep I TIME STEP
   GetReal I N REFERENCES PLACES, SetReal I N REFERENCES VALUES, and so for Integer, Boolean and String
   GetFMUstate I S, SetFMUstate I S, FreeFMUstate I S      S: place of a state, 0 to 7, or - for NULL; got: its address
   SerializedFMUstateSize I S PLACE, SerializeFMUstate I S ROOM SIZE, DeSerializeFMUstate I S SIZE BYTES
   SetDebugLogging I LOGGING N CATEGORIES, GetRealStatus I KIND PLACE, GetBooleanStatus I KIND PLACE
   Unsupported I                                           all calls that this FMU has no use for
   Put S ADDRESS                                           no call: makes a state of any address

   Numbers: doubles as the 16 hexadecimal digits of their bits, all else in decimal.  Texts and bytes: x and two
   hexadecimal digits for each byte.  Lists: "[" and the items, separated by commas.  NULL: "-"; a place for results:
   "+".  N and SIZE are passed on as they are, whatever the lists hold.

   Answer: fmi2Status, what was got, and for each message that was logged a tab, its status, category and text. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "words.h"

#define FUNCTIONS(X)                                                                                                   \
    X(GetVersion) X(GetTypesPlatform) X(Instantiate) X(FreeInstance) X(SetupExperiment) X(EnterInitializationMode)     \
    X(ExitInitializationMode) X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean) X(GetString) X(SetReal)     \
    X(SetInteger) X(SetBoolean) X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate) X(SerializedFMUstateSize)   \
    X(SerializeFMUstate) X(DeSerializeFMUstate) X(DoStep) X(SetDebugLogging) X(GetRealStatus) X(GetBooleanStatus)      \
    X(GetStatus) X(GetIntegerStatus) X(GetStringStatus) X(CancelStep) X(GetDirectionalDerivative)                      \
    X(SetRealInputDerivatives) X(GetRealOutputDerivatives)

static struct {
#define MEMBER(name) fmi2##name##TYPE *name;
    FUNCTIONS(MEMBER)
#undef MEMBER
} fmi;

enum { PLACES = 8 };

static fmi2Component instances[PLACES];
static fmi2FMUstate states[PLACES];

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    static char text[1 << 16];
    EXPECT(environment == instances && name != NULL && category != NULL && message != NULL);
    va_list arguments; /* as most hosts do: the message is a printf format */
    va_start(arguments, message);
    int n = vsnprintf(text, sizeof text, message, arguments);
    va_end(arguments);
    EXPECT(n >= 0 && (size_t)n < sizeof text);
    put_message(status, category, text);
}

static fmi2Component instance(void)
{
    const char *text = word();
    return is_null(text) ? NULL : instances[atoi(text)];
}

static fmi2FMUstate *state_place(void)
{
    const char *text = word();
    return is_null(text) ? NULL : &states[atoi(text)];
}

/* --- Calls ------------------------------------------------------------------------------------------------------ */

#define GET(type)                                                                                                      \
    static fmi2Status get_##type(fmi2Component c)                                                                      \
    {                                                                                                                  \
        size_t n = size(), n_listed;                                                                                   \
        fmi2ValueReference *references = list(sizeof *references, read_reference, &n_listed);                          \
        fmi2##type *values = is_null(word()) ? NULL : room(n_listed * sizeof *values);                                 \
        fmi2Status status = fmi.Get##type(c, references, n, values);                                                   \
        for (size_t i = 0; status == fmi2OK && i < n; i++)                                                             \
            put_##type(values[i]);                                                                                     \
        free(references);                                                                                              \
        free(values);                                                                                                  \
        return status;                                                                                                 \
    }
GET(Real)
GET(Integer)
GET(Boolean)
GET(String)

#define SET(type, free_values)                                                                                         \
    static fmi2Status set_##type(fmi2Component c)                                                                      \
    {                                                                                                                  \
        size_t n = size(), n_listed, n_values;                                                                         \
        fmi2ValueReference *references = list(sizeof *references, read_reference, &n_listed);                          \
        void *values = list(sizeof(fmi2##type), read_##type, &n_values);                                               \
        fmi2Status status = fmi.Set##type(c, references, n, values);                                                   \
        free(references);                                                                                              \
        free_values;                                                                                                   \
        return status;                                                                                                 \
    }
SET(Real, free(values))
SET(Integer, free(values))
SET(Boolean, free(values))
SET(String, free_texts(values, n_values))

static fmi2Status instantiate(void)
{
    static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, instances};
    int place = number();
    char *name = text_of(word());
    int type = number();
    char *guid = text_of(word()), *uri = text_of(word());
    int with_callbacks = number(), logging = number();
    fmi2Component c =
        fmi.Instantiate(name, (fmi2Type)type, guid, uri, with_callbacks ? &callbacks : NULL, fmi2False, logging);
    free(name);
    free(guid);
    free(uri);
    if (c != NULL)
        instances[place] = c;
    return c != NULL ? fmi2OK : fmi2Error;
}

static fmi2Status set_up(fmi2Component c)
{
    int has_tolerance = number();
    double tolerance = real(), start = real();
    int has_stop = number();
    return fmi.SetupExperiment(c, has_tolerance, tolerance, start, has_stop, real());
}

static fmi2Status step(fmi2Component c)
{
    double time = real();
    return fmi.DoStep(c, time, real(), fmi2False);
}

static fmi2Status set_logging(fmi2Component c)
{
    int logging = number();
    size_t n = size(), n_listed;
    char **categories = list(sizeof *categories, read_String, &n_listed);
    fmi2Status status = fmi.SetDebugLogging(c, logging, n, (const fmi2String *)categories);
    free_texts(categories, n_listed);
    return status;
}

static fmi2Status get_state(fmi2Component c)
{
    fmi2FMUstate *place = state_place();
    fmi2Status status = fmi.GetFMUstate(c, place);
    put_address(place != NULL ? *place : NULL);
    return status;
}

static fmi2Status set_state(fmi2Component c)
{
    fmi2FMUstate *place = state_place();
    return fmi.SetFMUstate(c, place != NULL ? *place : NULL);
}

static fmi2Status free_state(fmi2Component c)
{
    fmi2FMUstate *place = state_place();
    fmi2Status status = fmi.FreeFMUstate(c, place);
    put_address(place != NULL ? *place : NULL);
    return status;
}

static fmi2Status state_size(fmi2Component c)
{
    fmi2FMUstate *place = state_place();
    size_t n = 0;
    fmi2Status status = fmi.SerializedFMUstateSize(c, place != NULL ? *place : NULL, is_null(word()) ? NULL : &n);
    put_size(n);
    return status;
}

static fmi2Status write_state(fmi2Component c)
{
    fmi2FMUstate *place = state_place();
    const char *text = word();
    size_t n_room = is_null(text) ? 0 : strtoull(text, NULL, 10);
    char *bytes = is_null(text) ? NULL : memset(room(n_room), 0, n_room);
    fmi2Status status = fmi.SerializeFMUstate(c, place != NULL ? *place : NULL, bytes, size());
    if (status == fmi2OK)
        put_bytes(bytes, n_room);
    free(bytes);
    return status;
}

static fmi2Status read_state(fmi2Component c)
{
    fmi2FMUstate *place = state_place();
    size_t n = size(), n_bytes = 0;
    char *bytes = from_hex(word(), &n_bytes);
    bytes = bytes != NULL ? realloc(bytes, n_bytes > 0 ? n_bytes : 1) : NULL; /* without the NUL */
    fmi2Status status = fmi.DeSerializeFMUstate(c, bytes, n, place);
    put_address(place != NULL ? *place : NULL);
    free(bytes);
    return status;
}

static fmi2Status real_status(fmi2Component c)
{
    int kind = number();
    fmi2Real value = -1.0;
    fmi2Status status = fmi.GetRealStatus(c, (fmi2StatusKind)kind, is_null(word()) ? NULL : &value);
    put_Real(value);
    return status;
}

static fmi2Status boolean_status(fmi2Component c)
{
    int kind = number();
    fmi2Boolean value = -1;
    fmi2Status status = fmi.GetBooleanStatus(c, (fmi2StatusKind)kind, is_null(word()) ? NULL : &value);
    put_Integer(value);
    return status;
}

/* All statuses in the answer; the answer's own is fmi2OK. */
static fmi2Status unsupported(fmi2Component c)
{
    const fmi2ValueReference reference = 0;
    const fmi2Integer order = 1;
    fmi2Real value = 1.0;
    fmi2Status status = fmi2OK;
    fmi2Integer number_got = 0;
    fmi2String text = NULL;
    put_Integer(fmi.GetDirectionalDerivative(c, &reference, 1, &reference, 1, &value, &value));
    put_Integer(fmi.SetRealInputDerivatives(c, &reference, 1, &order, &value));
    put_Integer(fmi.GetRealOutputDerivatives(c, &reference, 1, &order, &value));
    put_Integer(fmi.CancelStep(c));
    put_Integer(fmi.GetStatus(c, fmi2DoStepStatus, &status));
    put_Integer(fmi.GetIntegerStatus(c, fmi2DoStepStatus, &number_got));
    put_Integer(fmi.GetStringStatus(c, fmi2PendingStatus, &text));
    return fmi2OK;
}

static fmi2Status put(void)
{
    fmi2FMUstate *place = state_place();
    *place = (fmi2FMUstate)(uintptr_t)strtoull(word(), NULL, 16);
    return fmi2OK;
}

static fmi2Status free_instance(fmi2Component c)
{
    fmi.FreeInstance(c);
    return fmi2OK;
}

#define PLAIN(name, function)                                                                                          \
    static fmi2Status name(fmi2Component c)                                                                            \
    {                                                                                                                  \
        return fmi.function(c);                                                                                        \
    }
PLAIN(enter_initialisation, EnterInitializationMode)
PLAIN(exit_initialisation, ExitInitializationMode)
PLAIN(terminate, Terminate)
PLAIN(reset, Reset)

static const struct {
    const char *name;
    fmi2Status (*call)(fmi2Component);
} handlers[] = {
    {"GetReal", get_Real}, {"GetInteger", get_Integer}, {"GetBoolean", get_Boolean}, {"GetString", get_String},
    {"SetReal", set_Real}, {"SetInteger", set_Integer}, {"SetBoolean", set_Boolean}, {"SetString", set_String},
    {"SetupExperiment", set_up}, {"EnterInitializationMode", enter_initialisation},
    {"ExitInitializationMode", exit_initialisation}, {"DoStep", step}, {"Terminate", terminate}, {"Reset", reset},
    {"FreeInstance", free_instance}, {"GetFMUstate", get_state}, {"SetFMUstate", set_state},
    {"FreeFMUstate", free_state}, {"SerializedFMUstateSize", state_size}, {"SerializeFMUstate", write_state},
    {"DeSerializeFMUstate", read_state}, {"SetDebugLogging", set_logging}, {"GetRealStatus", real_status},
    {"GetBooleanStatus", boolean_status}, {"Unsupported", unsupported},
};

static fmi2Status call(const char *function)
{
    if (strcmp(function, "Instantiate") == 0)
        return instantiate();
    if (strcmp(function, "Put") == 0)
        return put();
    for (size_t i = 0; i < sizeof handlers / sizeof *handlers; i++)
        if (strcmp(function, handlers[i].name) == 0)
            return handlers[i].call(instance());
    fail("which function?");
}

int main(int argc, char **argv)
{
    char *line = NULL;
    size_t line_size = 0;
    EXPECT(argc == 2);
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL)
        fail(dlerror());
#define LOAD(name) EXPECT((*(void **)&fmi.name = dlsym(library, "fmi2" #name)) != NULL);
    FUNCTIONS(LOAD)
#undef LOAD
    EXPECT(strcmp(fmi.GetVersion(), "2.0") == 0 && strcmp(fmi.GetTypesPlatform(), "default") == 0);
    begin_answers();
    while (getline(&line, &line_size, stdin) > 0)
        answer(call(first_word(line)));
    free(line);
    return 0;
}
