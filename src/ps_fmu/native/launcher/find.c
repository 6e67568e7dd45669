#include "find.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"

enum {
    PROBE_TIMEOUT = 30,  /* s */
    MOST_ON_PATH = 8,    /* interpreters on PATH that are tried */
    MOST_OUTPUT = 1 << 16 /* bytes */
};

/* A candidate runs this and describes itself in lines key=value.  "missing" is the reason why it cannot be used.  It is
   started with -I: without that, Python would import modules from the current directory of the host. */
static const char PROBE[] =
    "import importlib.util, os, site, sys, sysconfig\n"
    "get = sysconfig.get_config_var\n"
    "version = '%d.%d' % sys.version_info[:2]\n"
    "if os.name == 'nt':\n"
    "    import _winapi\n"
    "    library = _winapi.GetModuleFileName(sys.dllhandle)\n"
    "    folders = [os.path.dirname(library)]\n"
    "    shared = [library] if os.path.isfile(folders[0] + '/python3.dll') else []\n"
    "else:\n"
    "    folders = [get('LIBDIR') or '', sys.base_prefix + '/lib', os.path.dirname(os.path.realpath(sys.executable))]\n"
    "    folders += [folders[0] + '/' + (get('MULTIARCH') or '')]\n"
    "    names = [get('INSTSONAME') or '', get('LDLIBRARY') or '', 'libpython' + version + '.so.1.0']\n"
    "    shared = [f + '/' + n for f in folders for n in names if '.so' in n and os.path.isfile(f + '/' + n)]\n"
    "    with open('/proc/self/maps') as maps:\n"
    "        shared = [m.split(None, 5)[5].strip() for m in maps if '/libpython' + version + '.so' in m] + shared\n"
    /* -I leaves out the user's own packages as well: put them where they are without it. */
    "user, own = site.getusersitepackages(), sys.path[:]\n"
    "is_owner = os.name == 'nt' or os.getuid() == os.geteuid()\n"
    "if is_owner and sys.base_prefix in site.PREFIXES and os.path.isabs(user) and os.path.isdir(user):\n"
    "    site.addsitedir(user)\n"
    "    at = min([own.index(entry) for entry in site.getsitepackages() if entry in own] or [len(own)])\n"
    "    sys.path[:] = own[:at] + sys.path[len(own):] + own[at:]\n"
    "search = [entry for entry in sys.path if os.path.isabs(entry)]\n"
    "sys.path[:] = search\n"
    "absent = [name for name in sys.argv[1:] if importlib.util.find_spec(name) is None]\n"
    "missing = ''\n"
    "if absent: missing = 'lacks ' + ', '.join(absent)\n"
    "elif get('Py_GIL_DISABLED'): missing = 'a build without the global interpreter lock'\n"
    "elif sys.maxsize < 2**32: missing = 'a 32-bit build'\n"
    "elif not shared: missing = '%s (looked in %s)' % (\n"
    "    'comes without python3.dll' if os.name == 'nt' else 'built without a shared libpython', ', '.join(folders))\n"
    "sys.stdout.buffer.write(os.fsencode('\\nversion=%s\\nprogram=%s\\nmissing=%s\\nlibrary=%s\\nentries=%s\\n'\n"
    "    % (version, sys.executable, missing, shared[0] if shared else '', os.pathsep.join(search))))\n"
    "sys.stdout.buffer.write(b'complete=1\\n')\n";

bool version_at_least(const char *version, const char *oldest)
{
    int major, minor, wanted_major, wanted_minor;
    if (sscanf(oldest, "%d.%d", &wanted_major, &wanted_minor) != 2)
        return true;
    if (sscanf(version, "%d.%d", &major, &minor) != 2)
        return false;
    return major > wanted_major || (major == wanted_major && minor >= wanted_minor);
}

void python_free(Python *python)
{
    free(python->library);
    free(python->program);
    free(python->home);
    free(python->version);
    free(python->search);
    free(python->preload);
    memset(python, 0, sizeof *python);
}

/* --- Candidates -------------------------------------------------------------------------------------------------- */

/* Run the probe.  False with a reason if it did not run to its end. */
static bool run_probe(const char *program, const Needs *needs, Text *output, Text *reason)
{
    char *arguments[64] = {(char *)program, "-I", "-c", (char *)PROBE};
    char *modules = strdup(needs->modules != NULL ? needs->modules : ""), *rest = NULL;
    size_t n = 4;
    for (char *name = modules != NULL ? strtok_r(modules, " ", &rest) : NULL; name != NULL && n < 63;
         name = strtok_r(NULL, " ", &rest))
        arguments[n++] = name;
    bool run = run_program(arguments, PROBE_TIMEOUT, MOST_OUTPUT, output, reason);
    free(modules);
    return run;
}

static const char *last_line(Text *text)
{
    while (text->used > 0 && strchr("\r\n", text->data[text->used - 1]) != NULL)
        text->data[--text->used] = '\0';
    const char *newline = text->used > 0 ? strrchr(text->data, '\n') : NULL;
    return newline != NULL ? newline + 1 : text->used > 0 ? text->data : "nothing";
}

/* Judge an interpreter by what it says about itself. */
static void judge(const Needs *needs, const char *library, Text *output, Python *found, Text *reason)
{
    char *complete = line_value(output->data, "complete"), *missing = line_value(output->data, "missing");
    found->version = line_value(output->data, "version");
    found->program = line_value(output->data, "program");
    found->library = line_value(output->data, "library");
    found->search = line_value(output->data, "entries");
    for (char *at = found->search; at != NULL && *at != '\0'; at++)
        if (*at == LIST_SEPARATOR[0])
            *at = '\n';
    if (complete == NULL || missing == NULL || found->library == NULL || found->search == NULL)
        text_add(reason, "failed, its last words: %s", last_line(output));
    else if (needs->python != NULL && !version_at_least(found->version, needs->python))
        text_add(reason, "Python %s, %s or newer is needed", found->version, needs->python);
    else if (missing[0] != '\0')
        text_add(reason, "Python %s, %s", found->version, missing);
    else if (library != NULL && !same_file(library, found->library))
        text_add(reason, "belongs to %s, but the process has loaded %s already", found->library, library);
    free(complete);
    free(missing);
}

static bool try_interpreter(const char *program, const char *origin, const Needs *needs, const char *library,
                            Python *found, Text *why)
{
    Text output = {0}, reason = {0};
    if (!is_absolute(program)) /* the current directory is the host's, and anything may be in it */
        text_add(&reason, "is not an absolute path");
    else if (!is_program(program))
        add_system_error(&reason);
    else if (run_probe(program, needs, &output, &reason))
        judge(needs, library, &output, found, &reason);
    bool fit = reason.used == 0;
    if (!fit) {
        text_add(why, "\n  %s: %s: %s", origin, program, reason.data);
        python_free(found);
    }
    text_free(&output);
    text_free(&reason);
    return fit;
}

/* Entries "a:b" of a bundle's notes as full paths, one per line.  False if one is missing. */
static bool full_paths(const char *home, const char *notes, const char *key, char **paths, Text *why)
{
    char *entries = line_value(notes, key), *rest = NULL;
    Text result = {0};
    bool complete = entries != NULL;
    for (char *entry = complete ? strtok_r(entries, ":", &rest) : NULL; entry != NULL; entry = strtok_r(NULL, ":", &rest)) {
        if (!has_file(home, entry)) {
            text_add(why, "\n  runtime in the FMU: %s/%s is missing", home, entry);
            complete = false;
        }
        text_add(&result, "%s/%s\n", home, entry);
    }
    free(entries);
    *paths = result.data;
    return complete;
}

static char *bundle_notes(const char *home)
{
    char *path = formatted("%s/bundle.txt", home), *notes = path != NULL ? file_text(path) : NULL;
    free(path);
    return notes;
}

/* The Python in the folder "python" beside this library, which bundle.txt describes. */
static bool try_bundle(const char *binaries, const char *library, Python *found, Text *why)
{
    char *home = formatted("%s/python", binaries), *notes = home != NULL ? bundle_notes(home) : NULL;
    bool fit = false;
    if (notes == NULL) {
        text_add(why, "\n  runtime in the FMU: none");
    } else if (library != NULL) {
        text_add(why, "\n  runtime in the FMU: not used, since the process has loaded %s already", library);
    } else { /* every part must be there: without its standard library, Python ends the process */
        fit = full_paths(home, notes, "library", &found->library, why) &&
              full_paths(home, notes, "entries", &found->search, why) &&
              full_paths(home, notes, "preload", &found->preload, why);
    }
    if (fit) {
        found->library[strcspn(found->library, "\n")] = '\0';
        found->version = line_value(notes, "version");
        found->home = strdup(home);
    } else {
        python_free(found);
    }
    free(home);
    free(notes);
    return fit;
}

char *bundled_packages(const char *binaries, const char *version)
{
    char *home = formatted("%s/python", binaries), *notes = home != NULL ? bundle_notes(home) : NULL;
    char *own = line_value(notes, "version"), *folder = line_value(notes, "packages");
    bool same = own != NULL && strncmp(version, own, strlen(own)) == 0;
    char *result = same && folder != NULL ? formatted("%s/%s", home, folder) : NULL;
    free(home);
    free(notes);
    free(own);
    free(folder);
    return result;
}

/* An interpreter in a folder, under one of the names that it may have there; NULL if there is none.  New memory. */
static char *interpreter_in(const char *folder)
{
    for (const char *const *name = PYTHONS; *name != NULL && is_absolute(folder); name++) {
        char *program = formatted("%s/%s", folder, *name);
        if (program != NULL && is_program(program))
            return program;
        free(program);
    }
    return NULL;
}

static bool try_path(const Needs *needs, const char *library, Python *found, Text *why)
{
    char *set = environment_value("PATH");
    char *path = strdup(set != NULL ? set : USUAL_PATH), *rest = NULL;
    char *tried[MOST_ON_PATH];
    size_t n = 0;
    bool fit = false;
    for (char *folder = path != NULL ? strtok_r(path, LIST_SEPARATOR, &rest) : NULL;
         folder != NULL && !fit && n < MOST_ON_PATH; folder = strtok_r(NULL, LIST_SEPARATOR, &rest)) {
        char *program = interpreter_in(folder);
        bool known = program == NULL;
        for (size_t i = 0; i < n && !known; i++)
            known = same_file(program, tried[i]);
        if (known) {
            free(program);
            continue;
        }
        tried[n++] = program;
        fit = try_interpreter(program, "PATH", needs, library, found, why);
    }
    if (n == 0)
        text_add(why, "\n  PATH: no %s in %s", PYTHONS[0], set != NULL ? set : "the usual places (PATH is not set)");
    for (size_t i = 0; i < n; i++)
        free(tried[i]);
    free(path);
    free(set);
    return fit;
}

static bool is_set(const char *value)
{
    return value != NULL && value[0] != '\0';
}

static bool try_environment(const Needs *needs, const char *library, Python *found, Text *why)
{
    char *folder = environment_value("VIRTUAL_ENV");
    char *program = is_set(folder) ? formatted("%s/%s", folder, VENV_PYTHON) : NULL;
    if (!is_set(folder))
        text_add(why, "\n  VIRTUAL_ENV: not set");
    bool fit = program != NULL && try_interpreter(program, "VIRTUAL_ENV", needs, library, found, why);
    free(program);
    free(folder);
    return fit;
}

static bool try_all(const Needs *needs, const char *binaries, const char *library, Python *found, Text *why)
{
    text_add(why, "\n  PS_FMU_PYTHON: not set");
    if (try_bundle(binaries, library, found, why))
        return true;
    if (needs->interpreter == NULL)
        text_add(why, "\n  interpreter noted at build: none");
    else if (try_interpreter(needs->interpreter, "interpreter noted at build", needs, library, found, why))
        return true;
    return try_environment(needs, library, found, why) || try_path(needs, library, found, why);
}

bool find_python(const Needs *needs, const char *binaries, const char *library, Python *found, Text *why)
{
    char *chosen = environment_value("PS_FMU_PYTHON");
    bool fit = is_set(chosen) /* the user has chosen: try no other */
                   ? try_interpreter(chosen, "PS_FMU_PYTHON", needs, library, found, why)
                   : try_all(needs, binaries, library, found, why);
    free(chosen);
    return fit;
}
