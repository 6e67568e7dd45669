/* A small FMI 2.0 host without Python that runs a system of FMUs, step by step as ps_fmu.cosim does (Jacobi).

   system MODE N FILE [ARGUMENT...]     N: communication steps; FILE: see read_system

   run      writes all outputs of each ARGUMENT-th step as doubles to the file ARGUMENT
   pair     two instances of each FMU, as two systems in turns; prints the outputs
   threads  eight threads, each with a system; prints the outputs of each
   reload   ten times: load, run, unload; prints the outputs of each
   states   keeps the state after N steps, also in the file ARGUMENT, and runs N steps from it: on, again, and in other
            instances from the bytes; prints the outputs
   resume   N steps from the states in the file ARGUMENT, which another process has written; prints the outputs */
#include "wired.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { THREADS = 8, RELOADS = 10 };

typedef struct {
    System system;
    long n;
} Work;

static void print(const System *s)
{
    double values[MOST_VARIABLES];
    row(s, values);
    flockfile(stdout); /* a line in one piece: other threads print, too */
    for (size_t i = 0; i < s->outputs.n; i++)
        printf("%.17g ", values[i]);
    printf("\n");
    funlockfile(stdout);
}

static void expect_equal(const System *s, const System *other)
{
    double values[MOST_VARIABLES], others[MOST_VARIABLES];
    row(s, values);
    row(other, others);
    EXPECT(memcmp(values, others, s->outputs.n * sizeof *values) == 0);
}

/* --- FMU states ------------------------------------------------------------------------------------------------- */

static void write_states(const System *s, const fmi2FMUstate *states, const char *path)
{
    FILE *file = fopen(path, "wb");
    EXPECT(file != NULL && fwrite(&s->index, sizeof s->index, 1, file) == 1);
    for (size_t i = 0; i < s->n_instances; i++) {
        size_t size;
        EXPECT(s->fmus[i].SerializedFMUstateSize(s->components[i], states[i], &size) == fmi2OK);
        fmi2Byte *bytes = malloc(size);
        EXPECT(s->fmus[i].SerializeFMUstate(s->components[i], states[i], bytes, size) == fmi2OK);
        EXPECT(fwrite(&size, sizeof size, 1, file) == 1 && fwrite(bytes, 1, size, file) == size);
        free(bytes);
    }
    EXPECT(fclose(file) == 0);
}

static void set_states(System *s, const fmi2FMUstate *states, long index)
{
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].SetFMUstate(s->components[i], states[i]) == fmi2OK);
    s->index = index;
    get_outputs(s);
}

static void free_states(const System *s, fmi2FMUstate *states)
{
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].FreeFMUstate(s->components[i], &states[i]) == fmi2OK && states[i] == NULL);
}

static void read_states(System *s, const char *path)
{
    FILE *file = fopen(path, "rb");
    fmi2FMUstate states[MOST_INSTANCES] = {NULL};
    long index;
    EXPECT(file != NULL && fread(&index, sizeof index, 1, file) == 1);
    for (size_t i = 0; i < s->n_instances; i++) {
        size_t size;
        EXPECT(fread(&size, sizeof size, 1, file) == 1);
        fmi2Byte *bytes = malloc(size);
        EXPECT(fread(bytes, 1, size, file) == size);
        EXPECT(s->fmus[i].DeSerializeFMUstate(s->components[i], bytes, size, &states[i]) == fmi2OK);
        free(bytes);
    }
    fclose(file);
    set_states(s, states, index);
    free_states(s, states);
}

static void run_from_states(System *s, long n, const char *path)
{
    System other = *s, before, after;
    fmi2FMUstate states[MOST_INSTANCES] = {NULL};
    begin(s);
    advance(s, n);
    before = *s;
    for (size_t i = 0; i < s->n_instances; i++)
        EXPECT(s->fmus[i].GetFMUstate(s->components[i], &states[i]) == fmi2OK);
    write_states(s, states, path);
    advance(s, n);
    after = *s;
    set_states(s, states, before.index);
    expect_equal(s, &before);
    advance(s, n);
    expect_equal(s, &after);
    free_states(s, states);
    begin(&other);
    advance(&other, n / 2); /* to any other state */
    read_states(&other, path);
    expect_equal(&other, &before);
    advance(&other, n);
    expect_equal(&other, &after);
    print(s);
    end(&other);
    end(s);
}

/* --- Modes ------------------------------------------------------------------------------------------------------ */

static void write_rows(System *s, long n, long every, const char *path)
{
    FILE *file = fopen(path, "wb");
    double values[MOST_VARIABLES];
    EXPECT(file != NULL && every > 0);
    begin(s);
    for (;;) {
        row(s, values);
        EXPECT(fwrite(values, sizeof *values, s->outputs.n, file) == s->outputs.n);
        if (s->index + every > n)
            break;
        advance(s, every);
    }
    end(s);
    EXPECT(fclose(file) == 0);
}

static void run_pair(System *s, long n)
{
    System other = *s;
    begin(s);
    begin(&other);
    for (long i = 0; i < n; i++) {
        advance(s, 1);
        advance(&other, 1);
        expect_equal(s, &other);
    }
    print(s);
    end(s);
    end(&other);
}

static void *run_once(void *work)
{
    Work *w = work;
    begin(&w->system);
    advance(&w->system, w->n);
    end(&w->system);
    return NULL;
}

static void run_threads(const System *s, long n)
{
    static Work works[THREADS];
    pthread_t ids[THREADS];
    for (int i = 0; i < THREADS; i++) {
        works[i] = (Work){*s, n};
        EXPECT(pthread_create(&ids[i], NULL, run_once, &works[i]) == 0);
    }
    for (int i = 0; i < THREADS; i++) {
        EXPECT(pthread_join(ids[i], NULL) == 0);
        print(&works[i].system);
    }
}

static void run_reloaded(System *s, long n)
{
    for (int i = 0; i < RELOADS; i++) {
        load_all(s);
        begin(s);
        advance(s, n);
        print(s);
        end(s);
        unload_all(s);
    }
}

static void resume(System *s, long n, const char *path)
{
    begin(s);
    read_states(s, path);
    advance(s, n);
    print(s);
    end(s);
}

int main(int argc, char **argv)
{
    static System s;
    EXPECT(argc >= 4);
    const char *mode = argv[1], *path = argv[argc - 1];
    long n = atol(argv[2]);
    handle_signals();
    read_system(argv[3], &s);
    if (strcmp(mode, "reload") == 0) {
        run_reloaded(&s, n);
    } else {
        load_all(&s);
        if (strcmp(mode, "run") == 0 && argc == 6)
            write_rows(&s, n, atol(argv[4]), path);
        else if (strcmp(mode, "pair") == 0)
            run_pair(&s, n);
        else if (strcmp(mode, "threads") == 0)
            run_threads(&s, n);
        else if (strcmp(mode, "states") == 0 && argc == 5)
            run_from_states(&s, n, path);
        else if (strcmp(mode, "resume") == 0 && argc == 5)
            resume(&s, n, path);
        else
            fail("which mode?");
    }
    expect_belongings();
    return 0;
}
