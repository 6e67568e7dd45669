#include "python.h"

#include <stdlib.h>
#include <string.h>

#include "floats.h"
#include "platform.h"

typedef struct PyObject PyObject;
typedef struct PyThreadState PyThreadState;

/* Name, type of the result, arguments: all of the stable interface of Python 3.11 to 3.13. */
#define FUNCTIONS(X)                                                                                                   \
    X(Py_IsInitialized, int, (void))                                                                                   \
    X(Py_InitializeEx, void, (int))                                                                                    \
    X(Py_AtExit, int, (void (*)(void)))                                                                                \
    X(Py_GetVersion, const char *, (void))                                                                             \
    X(Py_SetProgramName, void, (const wchar_t *))                                                                      \
    X(Py_SetPythonHome, void, (const wchar_t *))                                                                       \
    X(Py_DecRef, void, (PyObject *))                                                                                   \
    X(PyErr_Clear, void, (void))                                                                                       \
    X(PyEval_SaveThread, PyThreadState *, (void))                                                                      \
    X(PyEval_RestoreThread, void, (PyThreadState *))                                                                   \
    X(PyGILState_Ensure, int, (void))                                                                                  \
    X(PyGILState_Release, void, (int))                                                                                 \
    X(PyGILState_GetThisThreadState, PyThreadState *, (void))                                                          \
    X(PyThreadState_Clear, void, (PyThreadState *))                                                                    \
    X(PyThreadState_DeleteCurrent, void, (void))                                                                       \
    X(PyImport_ImportModule, PyObject *, (const char *))                                                               \
    X(PyList_New, PyObject *, (ptrdiff_t))                                                                             \
    X(PyList_Append, int, (PyObject *, PyObject *))                                                                    \
    X(PyUnicode_DecodeFSDefault, PyObject *, (const char *))                                                           \
    X(PySequence_Contains, int, (PyObject *, PyObject *))                                                              \
    X(PySys_GetObject, PyObject *, (const char *))                                                                     \
    X(PySys_SetObject, int, (const char *, PyObject *))                                                                \
    X(PyRun_SimpleString, int, (const char *))

static struct {
#define MEMBER(name, result, arguments) result(*name) arguments;
    FUNCTIONS(MEMBER)
#undef MEMBER
} api;
static bool loaded; /* is api filled? */

/* --- What all launchers in a process share ---------------------------------------------------------------------- */

typedef struct {
    unsigned long generation;
    bool watched;         /* Python calls on_finalise */
    int calls;            /* in progress */
    bool bundled;         /* Python was started from the runtime in an FMU */
    int closing;          /* exit() was called */
    unsigned long closer; /* by this thread */
} Shared;

static Shared *shared;
typedef char shared_fits[sizeof(Shared) <= COMMON_SIZE ? 1 : -1];

__attribute__((constructor)) static void find_shared(void)
{
    shared = common_memory();
}

/* A thread that has a state in Python because of us. */
typedef struct {
    PyThreadState *state;
    unsigned long generation;
} Thread;

static __thread int depth; /* calls of this thread under way */

/* A host's thread ends.  PyGILState_Release would look for its own thread-specific data, which may be gone by now. */
void on_thread_end(void *value)
{
    Thread *thread = value;
    if (loaded && thread->generation == python_generation() && !__atomic_load_n(&shared->closing, __ATOMIC_SEQ_CST) &&
        api.Py_IsInitialized()) {
        api.PyEval_RestoreThread(thread->state);
        api.PyThreadState_Clear(thread->state);
        api.PyThreadState_DeleteCurrent();
    }
    free(thread);
}

void python_lock(void)
{
    set_up_common();
    if (common_try_lock())
        return;
    /* The holder will need the global interpreter lock: release it while waiting. */
    int (*is_initialised)(void), (*holds)(void);
    PyThreadState *(*save)(void);
    void (*restore)(PyThreadState *);
    *(void **)&is_initialised = python_symbol("Py_IsInitialized");
    *(void **)&holds = python_symbol("PyGILState_Check");
    *(void **)&save = python_symbol("PyEval_SaveThread");
    *(void **)&restore = python_symbol("PyEval_RestoreThread");
    bool to_release = is_initialised && holds && save && restore && is_initialised() && holds();
    PyThreadState *state = to_release ? save() : NULL;
    common_lock();
    if (to_release)
        restore(state);
}

void python_unlock(void)
{
    common_unlock();
}

unsigned long python_generation(void)
{
    return __atomic_load_n(&shared->generation, __ATOMIC_SEQ_CST);
}

static void on_finalise(void)
{
    __atomic_add_fetch(&shared->generation, 1, __ATOMIC_SEQ_CST);
    shared->watched = false; /* Python forgets about it as well */
}

/* --- Calls ------------------------------------------------------------------------------------------------------ */

/* Otherwise each call would create and destroy a thread state, which costs ten times as much as a plain call. */
static void keep_thread_state(void)
{
    Thread *thread = thread_pointer();
    if (thread != NULL && thread->generation == shared->generation)
        return;
    if (thread == NULL && api.PyGILState_GetThisThreadState() != NULL)
        return; /* a thread of Python's own */
    if (thread == NULL)
        thread = malloc(sizeof *thread);
    if (thread == NULL)
        return;
    api.PyGILState_Ensure();
    thread->generation = shared->generation;
    thread->state = api.PyEval_SaveThread();
    set_thread_pointer(thread);
}

bool python_enter(unsigned long generation)
{
    __atomic_add_fetch(&shared->calls, 1, __ATOMIC_SEQ_CST);
    bool closed = __atomic_load_n(&shared->closing, __ATOMIC_SEQ_CST) && shared->closer != thread_id();
    if (closed || generation != python_generation()) {
        __atomic_sub_fetch(&shared->calls, 1, __ATOMIC_SEQ_CST);
        return false;
    }
    depth++;
    floats_take();
    keep_thread_state();
    return true;
}

void python_leave(void)
{
    depth--;
    floats_give_back();
    __atomic_sub_fetch(&shared->calls, 1, __ATOMIC_SEQ_CST);
}

/* The end of a process whose Python we started.  Python is not finalised: numpy would crash, and hosts may free
   their instances even later.  The global interpreter lock is kept, so that no other thread goes on. */
static void on_exit_of_process(void)
{
    enum { PATIENCE = 2000 }; /* ms */
    if (!api.Py_IsInitialized())
        return;
    shared->closer = thread_id();
    __atomic_store_n(&shared->closing, 1, __ATOMIC_SEQ_CST);
    for (int i = 0; i < PATIENCE && __atomic_load_n(&shared->calls, __ATOMIC_SEQ_CST) > depth; i++)
        sleep_a_millisecond();
    floats_take();
    api.PyGILState_Ensure();
    api.PyRun_SimpleString("import atexit, sys\n"
                           "atexit._run_exitfuncs()\n"
                           "for stream in (sys.stdout, sys.stderr):\n"
                           "    if stream is not None and not stream.closed:\n"
                           "        stream.flush()\n");
}

/* --- Attaching and starting ------------------------------------------------------------------------------------- */

static bool load_functions(Text *why)
{
    if (loaded) /* other threads read it */
        return true;
#define LOAD(name, result, arguments)                                                                                  \
    *(void **)&api.name = python_symbol(#name);                                                                        \
    if (api.name == NULL) {                                                                                            \
        text_add(why, "the Python in this process lacks the function %s", #name);                                      \
        return false;                                                                                                  \
    }
    FUNCTIONS(LOAD)
#undef LOAD
    loaded = true;
    return true;
}

static void set_flag(const char *name)
{
    int *flag = python_symbol(name);
    if (flag != NULL)
        *flag = 1;
}

static void set_search_path(char *entries)
{
    PyObject *list = api.PyList_New(0);
    char *rest = NULL;
    for (char *entry = strtok_r(entries, "\n", &rest); entry != NULL; entry = strtok_r(NULL, "\n", &rest)) {
        PyObject *item = api.PyUnicode_DecodeFSDefault(entry);
        if (item == NULL || api.PyList_Append(list, item) != 0)
            api.PyErr_Clear();
        api.Py_DecRef(item);
    }
    if (api.PySys_SetObject("path", list) != 0)
        api.PyErr_Clear();
    api.Py_DecRef(list);
}

/* Libraries in a bundle; others that need them find them by the name within them. */
static void preload(char *libraries)
{
    char *rest = NULL;
    for (char *path = libraries != NULL ? strtok_r(libraries, "\n", &rest) : NULL; path != NULL;
         path = strtok_r(NULL, "\n", &rest)) {
        Text reason = {0}; /* a library that needs it reports the error */
        open_library(path, &reason);
        text_free(&reason);
    }
}

/* Python runs from another FMU's runtime, which may lack packages that this FMU's has. */
static void add_bundled_packages(const char *binaries)
{
    char *folder = bundled_packages(binaries, api.Py_GetVersion());
    if (folder == NULL)
        return;
    int state = api.PyGILState_Ensure();
    PyObject *list = api.PySys_GetObject("path"), *entry = api.PyUnicode_DecodeFSDefault(folder);
    if (list == NULL || entry == NULL ||
        (api.PySequence_Contains(list, entry) == 0 && api.PyList_Append(list, entry) != 0))
        api.PyErr_Clear();
    api.Py_DecRef(entry);
    api.PyGILState_Release(state);
    free(folder);
}

static void initialise(Python *python)
{
    Belongings *kept = keep_belongings();
    set_flag("Py_IgnoreEnvironmentFlag");
    set_flag("Py_NoUserSiteDirectory");
    set_flag("Py_NoSiteFlag"); /* the search path is known already */
    set_flag("Py_UTF8Mode");   /* whatever the locale of the host */
    if (python->program != NULL)
        api.Py_SetProgramName(widened(python->program)); /* Python keeps the pointer */
    if (python->home != NULL)
        api.Py_SetPythonHome(widened(python->home));
    api.Py_InitializeEx(0);
    set_search_path(python->search);
    PyObject *module = api.PyImport_ImportModule("signal"); /* takes SIGINT over when it is first imported */
    if (module == NULL)
        api.PyErr_Clear();
    else
        api.Py_DecRef(module);
    give_back(kept);
    shared->bundled = python->home != NULL;
    at_exit_of_process(on_exit_of_process);
    api.PyEval_SaveThread();
}

static bool start_one(const Needs *needs, const char *binaries, const char *library, Text *why)
{
    Python found = {0};
    Text rejections = {0}, reason = {0};
    bool fit = find_python(needs, binaries, library, &found, &rejections);
    preload(found.preload);
    if (!fit) {
        text_add(why, "no Python was found that can run this FMU. It needs Python %s or newer with a shared libpython%s%s."
                      " Tried:%s\nName one by the environment variable PS_FMU_PYTHON=/path/to/%s,"
                      " or put one into the FMU (ps-fmu build --bundle, ps-fmu wrap --bundle)",
                 needs->python != NULL ? needs->python : "3", needs->modules != NULL ? " and with " : "",
                 needs->modules != NULL ? needs->modules : "", rejections.data != NULL ? rejections.data : "",
                 PYTHONS[0]);
    } else if (!share_python(found.library, false, &reason)) {
        text_add(why, "%s cannot be loaded: %s", found.library, reason.data);
        fit = false;
    } else {
        fit = load_functions(why);
        if (fit)
            initialise(&found);
    }
    text_free(&rejections);
    text_free(&reason);
    python_free(&found);
    return fit;
}

static bool version_fits(const Needs *needs, Text *why)
{
    const char *version = api.Py_GetVersion();
    if (needs->python == NULL || version_at_least(version, needs->python))
        return true;
    text_add(why, "this process runs Python %.*s; the FMU needs %s or newer", (int)strcspn(version, " "), version,
             needs->python);
    return false;
}

/* Call this with the lock of the interpreter, if Python runs. */
static void watch_for_finalisation(void)
{
    int state = api.PyGILState_Ensure();
    shared->watched = api.Py_AtExit(on_finalise) == 0;
    api.PyGILState_Release(state);
}

/* python_start, where `library` is a libpython that the process has loaded; NULL: none. */
static bool attach_or_start(const Needs *needs, const char *binaries, const char *library, Text *why)
{
    Text reason = {0};
    if (library != NULL && !share_python(library, true, &reason)) {
        text_add(why, "the loaded %s cannot be used: %s", library, reason.data);
        text_free(&reason);
        return false;
    }
    bool present = python_symbol("Py_IsInitialized") != NULL;
    if (present && !load_functions(why))
        return false;
    return (present && api.Py_IsInitialized()) || start_one(needs, binaries, library, why);
}

bool python_start(const Needs *needs, const char *binaries, Text *why)
{
    char *library = loaded_python();
    bool running = attach_or_start(needs, binaries, library, why);
    free(library);
    if (!running || !version_fits(needs, why))
        return false;
    if (shared->bundled)
        add_bundled_packages(binaries);
    if (!shared->watched)
        watch_for_finalisation();
    return true;
}
