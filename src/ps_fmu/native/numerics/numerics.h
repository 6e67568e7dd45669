/* Noise, wheels, recordings and instruments: functions of an array of times or samples, for Python (library.py), and
   elements of steps, which take no lock and no memory and call no Python.

   Complex numbers are pairs of doubles, arrays are C-contiguous.  What a structure keeps from one call to the next is a
   cache: a function of its constants and of the key that lies beside it.  So two threads must not share one. */
#ifndef NUMERICS_H
#define NUMERICS_H

#include <stdint.h>

#include "../kernel/core.h"

enum { CHANNELS = 6 /* of a wrench */, NODES = 6 /* of an interpolation */, LANES = 8 /* worked on together */ };

#define NONE INT64_MIN /* the number of no block */

/* One or two tables of rows (n, CHANNELS) on one grid, to be added. */
typedef struct {
    const double *one, *other; /* other: NULL if there is none */
    int64_t n, shift_one, shift_other;
    double start, rate; /* s, Hz */
} Tables;

/* Lines that go to bins side by side. */
typedef struct {
    int64_t first, end; /* lines */
    int64_t bin;        /* of the first */
    int64_t mirrored;   /* bins descend, and conjugates go there */
} Run;

/* What all blocks of noise have in common.  A block has CHANNELS / n_terms channels in each of its groups.  Its terms
   are (groups, n, 2, LANES): real and imaginary parts of each line, those of a group side by side, term by term. */
typedef struct {
    const double *share; /* (sources, n) */
    const double *gains; /* complex (n_terms, n) */
    const double *turns; /* complex (phases, n) */
    const double *roots; /* exp(2 pi i k / points), (points) */
    const Run *runs;
    int64_t n, n_terms, phases, points, n_runs;
} Lines;

/* exp(i a) exp(i b), or exp(i a) exp(-i b), of two that are there already. */
typedef struct {
    int64_t one, other, conjugate;
} Product;

/* A force and a torque that turn with the multiples of an angle, each the sum of lines a exp(i multiple angle). */
typedef struct {
    const double *multiples;       /* turns per radian, (n_multiples) */
    const Product *products;       /* what comes after those, (n_products) */
    const int64_t *which;          /* of all these, of each line of the force and, behind them, of the torque, (n_lines) */
    const double *amplitudes;      /* complex (3, n_lines) */
    int64_t n_multiples, n_products, n_force, n_lines;
    double along[4][CHANNELS];     /* of the real and imaginary parts of force and torque */
} Turning;

/* How a wheel's speed goes, and over which time it is faded in: constant, linear, constant (rad/s, s); or linear between
   rows, with the slope of each segment (rad/s2), the angle from the first row to each, and that to t = 0 (rad). */
typedef struct {
    double initial, final, start, duration, rise_time;
    const double *times, *speeds, *slopes, *turned;
    int64_t n_rows; /* 0: there is no table */
    double turned_before;
} Profile;

/* Adds force and torque at ascending times (n), s, to rows (n, CHANNELS). */
typedef void AddRows(void *source, const double *time, int64_t n, double *rows);

typedef struct {
    Turning turning;
    Profile profile;
    double *room; /* (n_multiples + n_products, 2, PART) */
} Wheel;

typedef struct {
    double wrench[CHANNELS], frequency, phase, rise_time; /* Hz, turns, s */
} Tone;

typedef struct {
    double wrench[CHANNELS], initial, final, start, duration, rise_time; /* Hz, s */
    double rate; /* of an exponential sweep, 1/s; 0: it is linear */
} Chirp;

/* What is read while a layer of lines rises, and afterwards. */
typedef struct {
    Tables rising, steady;
} RisingTable;

typedef struct {
    const RisingTable *tables;
    int64_t n_tables;
    double rise_time;
} Multisine;

/* A wrench (n, CHANNELS) that is linear between ascending times (n), n >= 2. */
typedef struct {
    const double *time, *wrench;
    int64_t n;
} Track;

typedef struct {
    Track first, steady; /* the first pass, and all others */
    int64_t repeats, has_first;
} Recording;

enum { BLOCKS = 3 /* of a layer: two are alive, and the next one is under way */ };

/* A layer of noise (gaussian.py), and its blocks: number i lives from i - 1 to i + 1 half periods. */
typedef struct {
    Lines lines;
    const double *factor;    /* (CHANNELS, sources) */
    const double *windows;   /* of a block that does not rise, (phases, n_terms, points) */
    double *draws, *terms, *room, *sizes; /* (2 sources n + 3), of draw_lines, (2, points / 2 + 1, 2, LANES), (n_terms, points) */
    double *rows[BLOCKS];    /* (points phases, CHANNELS) */
    uint32_t *words;         /* that random numbers belong to; the last one is the number of a block */
    int64_t n_words, sources;
    double power, rate, period, rise_time;
    int64_t number[BLOCKS];  /* of the block in each of the `rows`; NONE: of none */
    int64_t making, done;    /* the block under way, NONE: there is none; how many parts of it are made */
    double *samples;         /* in `room`: a transform under way, whose radices so far have this product */
    int64_t product;
} NoiseLayer;

typedef struct {
    NoiseLayer *layers;
    int64_t n_layers;
} Noise;

typedef struct {
    AddRows *add;
    void *source;
} AddedSource;

/* The highest frequency of a source, Hz, for warnings of steps that are too long for it. */
typedef struct {
    double frequency;
    const char *what; /* a line; "": noise up to there */
} Alias;

enum { ROWS_AT_ONCE = 32, MOST_TEXT = 400 };

/* The sum of the sources, as an element of a step. */
typedef struct {
    const AddedSource *sources;
    int64_t n_sources;
    const Noise *noise;          /* that is made ahead; NULL: there is none */
    int64_t target, start_place; /* in the buffer: of the wrench, and of the time from which all is counted */
    double latest, shortest;     /* time; half of the shortest period of the noise; s */
    const Alias *aliases;
    int64_t n_aliases, next_alias;
    double checked_step;         /* all aliases are told of for steps up to this size, s */
    double origin, step, start;  /* of the rows */
    int64_t first, end;          /* counts of steps that there are rows of */
    double rows[ROWS_AT_ONCE * CHANNELS];
} Source;

enum {
    PROCESSES = 6,  /* of a drift: Gauss and Markov's, and a random walk */
    PLACES = 64,    /* of a block of a drift */
    GRIDS = 6,      /* of places: each has PLACES times the interval of the one below */
    WIDEST = 1,     /* tells the random numbers of the drift apart; those of the grids come after it */
    WHITE = 256,    /* samples of a block of white noise */
    WHITE_ROWS = 512,
    TRACKED = 128,
    AT_ONCE = 16,   /* samples drawn at once, of each half of a block */
    SENSORS = 15    /* channels of the inertial sensors; the last three are rate sensors */
};

/* Recursions over a block of a grid; see set_grid. */
typedef struct {
    double decay[PROCESSES], kick[PROCESSES], power[PROCESSES], total[PROCESSES], weight[PLACES][PROCESSES];
} Bridge;

/* Errors of samples at one interval. */
typedef struct {
    double interval, deviation;  /* s; of the white noise */
    int64_t stride;              /* samples between two places of the drift */
    int64_t block, drawn;        /* of the white noise; a bit for each group of samples that is there */
    int64_t number[GRIDS][2], made[GRIDS][2]; /* blocks of each grid, and how many sensors of them are made */
    double *white;               /* (sensors, WHITE) */
    double *paths;               /* of the grids but the first, (GRIDS - 1, 2, sensors, PLACES + 1, PROCESSES) */
    double *sums;                /* of the first, (2, sensors, 2, PLACES): values, and growth to the next place */
    Bridge grids[GRIDS];
} ErrorStream;

/* Random errors of sensors that share a model. */
typedef struct {
    double density, slow, walk;  /* of the white noise; deviation of each process; of the random walk */
    double drift_interval, correlation_times[PROCESSES - 1]; /* s */
    int64_t sensors, drifts;     /* drifts: 0 if there is none */
    uint32_t white_words[4], drift_words[4];
    ErrorStream *streams;
    int64_t n_streams, oldest;
} Errors;

/* White noise of a driver. */
typedef struct {
    uint32_t *words;             /* the last one is the number of a block */
    int64_t n_words, channels;   /* at most 4 */
    int64_t block, drawn;
    double *rows;                /* (WHITE_ROWS, channels), room for 8 more */
} White;

typedef struct {
    double bandwidth, order;     /* Hz */
    double state[2][2], input[2];
} Lowpass;

/* Places are those in the buffer; see step_inertial. */
typedef struct {
    int64_t states, readings, motion, start, met, saturated;
    const int64_t *enabled;
    int64_t n_enabled;
    const double *rows, *products, *gain, *bias, *range; /* (SENSORS, 9), (SENSORS, 6), (SENSORS) */
    const char *const *names;
    double ranges[2], sample_time, last_sample;
    double step;                 /* of the low-passes, s */
    Lowpass lowpass[2];          /* of accelerometers, of rate sensors */
    Errors errors[2];
} InertialSensors;

/* Places are those in the buffer; see step_tracker. */
typedef struct {
    int64_t place, sampled, acquired, error, lock, visible, start, payload, target;
    double acquisition_share, acquisition_time, sample_time, deviation[3];
    int64_t measured[3], noisy, has_warned;
    uint32_t words[4];
    int64_t n_words, sample;     /* of `noise` */
    double noise[3];
} Tracker;

/* Places are those in the buffer; see step_coils. */
typedef struct {
    int64_t outputs, currents, inputs, counted, start;
    double force_constant, resistance, inductance, stroke_factor, ripple, ripple_factor, ripple_phase;
    double bandwidth, compensation, supply_voltage, current_limit, resolution, noise;
    double distance, stiffness, damping, effective_mass, steps_ahead;
    double contact_time, fewest_steps, longest_step; /* half a period on a stop, s; of it at least; a stable step, s */
    double step, decay, response, gain, deviation;   /* of the circuit, for steps of this size, s */
    double warned_step;                              /* that was told of, s */
    White white;
} Coils;

typedef struct {
    const char *instructions;
    void (*add_rows)(const Tables *, const double *, int64_t, double *);
    void (*draw_lines)(const Lines *, const double *, const double *, int64_t, double, double *, int64_t, int64_t);
    void (*draw_keyed)(const uint32_t *, int64_t, int64_t, int64_t, double *);
    void (*add_sources)(const Source *, const double *, int64_t, double *);
    void (*make_errors)(Errors *, double, const int64_t *, int64_t, double *, int64_t);
    void (*make_white)(White *, int64_t, int64_t, double *);
    void (*find_tracker_noise)(const uint32_t *, int64_t, int64_t, double *);
    int64_t (*explain_alias)(const Alias *, double, char *);
    double (*exponential_less_one)(double);
    AddRows *add_noise, *add_wheel, *add_tone, *add_chirp, *add_multisine, *add_recording;
    Function *step_source, *step_inertial, *step_tracker, *step_coils;
} Arithmetic;

extern const Arithmetic arithmetic_sse2, arithmetic_avx2, arithmetic_avx512;

#endif
