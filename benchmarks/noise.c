#include "noise.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { CHANNELS = 6, LAYERS = 2, KEPT = 2, NODES = 6 };

typedef struct {
    double re, im;
} Complex;

typedef struct {
    int64_t points, n_lines, first_line, n_terms, sources, n_keys;
    double rate, hop; /* Hz, s */
} Sizes;

typedef struct {
    Sizes is;
    double *share;    /* (lines) */
    Complex *gains;   /* (terms, lines) */
    double *factor;   /* (CHANNELS, sources) */
    double *weights;  /* (3, terms, points): of the first block, of the second, and of all others */
    uint64_t *keys;   /* (blocks, 2): of their random numbers */
    Complex *roots;   /* (points) */
    Complex *lines, *spectrum, *other;
    double *rows[KEPT]; /* (points, CHANNELS) */
    int64_t made[KEPT]; /* numbers of the blocks */
} Layer;

struct Noise {
    Layer layers[LAYERS];
};

/* --- Random numbers ------------------------------------------------------------------------------------------ */

typedef struct {
    uint64_t counter, key[2], numbers[4];
    int left;
} Random;

/* Philox 4x64 with ten rounds (Salmon et al., SC11, 2011). */
static void draw_four(Random *r)
{
    uint64_t c[4] = {++r->counter, 0, 0, 0}, k0 = r->key[0], k1 = r->key[1];
    for (int round = 0; round < 10; round++) {
        const unsigned __int128 a = (unsigned __int128)0xD2E7470EE14C6C93u * c[0];
        const unsigned __int128 b = (unsigned __int128)0xCA5A826395121157u * c[2];
        const uint64_t next[4] = {(uint64_t)(b >> 64) ^ c[1] ^ k0, (uint64_t)b, (uint64_t)(a >> 64) ^ c[3] ^ k1,
                                  (uint64_t)a};
        memcpy(c, next, sizeof c);
        k0 += 0x9E3779B97F4A7C15u;
        k1 += 0xBB67AE8584CAA73Bu;
    }
    memcpy(r->numbers, c, sizeof c);
    r->left = 4;
}

static double draw(Random *r)
{
    if (r->left == 0)
        draw_four(r);
    return (double)(r->numbers[4 - r->left--] >> 11) * 0x1p-53;
}

/* --- Transform ----------------------------------------------------------------------------------------------- */

static Complex times(Complex a, Complex b)
{
    return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

/* x[k] = sum of x[j] exp(2 pi i j k / n) by radices 5, 4, 3, 2, from `a` and back into it or into `b`. */
static Complex *transform(Complex *a, Complex *b, int64_t n, const Complex *roots)
{
    for (int64_t done = 1; done < n;) {
        const int64_t left = n / done, radix = left % 5 == 0 ? 5 : left % 4 == 0 ? 4 : left % 3 == 0 ? 3 : 2;
        const int64_t m = left / radix;
        for (int64_t p = 0; p < m; p++)
            for (int64_t q = 0; q < done; q++)
                for (int64_t k = 0; k < radix; k++) {
                    Complex sum = a[q + done * p];
                    for (int64_t j = 1; j < radix; j++) {
                        const Complex term = times(a[q + done * (p + m * j)], roots[n / radix * (j * k % radix)]);
                        sum.re += term.re;
                        sum.im += term.im;
                    }
                    b[q + done * (radix * p + k)] = times(sum, roots[done * p * k]);
                }
        done *= radix;
        Complex *other = a;
        a = b;
        b = other;
    }
    return a;
}

/* --- Blocks -------------------------------------------------------------------------------------------------- */

/* Amplitudes of all lines, (CHANNELS, lines). */
static void draw_lines(Layer *layer, int64_t index)
{
    const Sizes *is = &layer->is;
    Random random = {0, {layer->keys[2 * index], layer->keys[2 * index + 1]}, {0}, 0};
    const int64_t n = is->n_lines;
    double *u = malloc(2 * (size_t)(is->sources * n) * sizeof *u), *v = u + is->sources * n;
    for (int64_t i = 0; i < 2 * is->sources * n; i++)
        u[i] = draw(&random);
    memset(layer->lines, 0, (size_t)(CHANNELS * n) * sizeof(Complex));
    for (int64_t s = 0; s < is->sources; s++)
        for (int64_t i = 0; i < n; i++) {
            const double size = sqrt(-2.0 / (2.0 * is->hop) * log1p(-u[s * n + i])) * layer->share[i];
            const double angle = 2.0 * M_PI * v[s * n + i], re = size * cos(angle), im = size * sin(angle);
            for (int c = 0; c < CHANNELS; c++) {
                layer->lines[c * n + i].re += layer->factor[c * is->sources + s] * re;
                layer->lines[c * n + i].im += layer->factor[c * is->sources + s] * im;
            }
        }
    free(u);
}

/* Add a term of two channels to the rows: one transform gives both, as its real and its imaginary part. */
static void add_term(Layer *layer, int channel, int64_t term, const double *weights, double *rows)
{
    const Sizes *is = &layer->is;
    const Complex *one = layer->lines + channel * is->n_lines, *two = one + is->n_lines;
    memset(layer->spectrum, 0, (size_t)is->points * sizeof(Complex));
    for (int64_t i = 0; i < is->n_lines; i++) {
        const Complex gain = layer->gains[term * is->n_lines + i];
        const Complex a = times(one[i], gain), b = times(two[i], gain);
        const int64_t k = is->first_line + i;
        layer->spectrum[k] = (Complex){0.5 * (a.re - b.im), 0.5 * (a.im + b.re)};
        layer->spectrum[is->points - k] = (Complex){0.5 * (a.re + b.im), 0.5 * (b.re - a.im)};
    }
    const Complex *samples = transform(layer->spectrum, layer->other, is->points, layer->roots);
    for (int64_t i = 0; i < is->points; i++) {
        rows[i * CHANNELS + channel] += samples[i].re * weights[i];
        rows[i * CHANNELS + channel + 1] += samples[i].im * weights[i];
    }
}

/* Rows of block `index`, which lives for two hops. */
static const double *find_block(Layer *layer, int64_t index)
{
    const Sizes *is = &layer->is;
    const int place = (int)(index % KEPT);
    double *rows = layer->rows[place];
    if (layer->made[place] == index)
        return rows;
    draw_lines(layer, index);
    memset(rows, 0, (size_t)(is->points * CHANNELS) * sizeof *rows);
    const double *weights = layer->weights + (index < 2 ? index : 2) * is->n_terms * is->points;
    for (int channel = 0; channel < CHANNELS; channel += 2)
        for (int64_t term = 0; term < is->n_terms; term++)
            add_term(layer, channel, term, weights + term * is->points, rows);
    layer->made[place] = index;
    return rows;
}

/* --- Rows ---------------------------------------------------------------------------------------------------- */

static void add_layer(Layer *layer, double time, double *wrench)
{
    const Sizes *is = &layer->is;
    const int64_t index = (int64_t)floor(time / is->hop);
    const double *older = find_block(layer, index), *newer = find_block(layer, index + 1);
    const double position = (time - (double)index * is->hop) * is->rate;
    const bool on_grid = fabs(position - rint(position)) < 1e-6;
    const int64_t cell = (int64_t)(on_grid ? rint(position) : floor(position)), half = is->points / 2;
    for (int node = 0; node < NODES; node++) {
        double weight = 1.0;
        for (int other = 0; other < NODES; other++)
            if (other != node)
                weight *= (position - (double)cell - (other - 2)) / (node - other);
        if (on_grid)
            weight = node == 2 ? 1.0 : 0.0;
        if (weight == 0.0)
            continue;
        const double *a = older + (cell + node - 2 + half) % is->points * CHANNELS;
        const double *b = newer + (cell + node - 2 + is->points) % is->points * CHANNELS;
        for (int c = 0; c < CHANNELS; c++)
            wrench[c] += weight * (a[c] + b[c]);
    }
}

void noise_compute(Noise *noise, double time, double *wrench)
{
    memset(wrench, 0, CHANNELS * sizeof *wrench);
    for (int i = 0; i < LAYERS; i++)
        add_layer(&noise->layers[i], time, wrench);
}

/* --- File ---------------------------------------------------------------------------------------------------- */

static void *take(FILE *file, int64_t n, size_t size)
{
    void *memory = malloc((size_t)n * size);
    if (memory != NULL && fread(memory, size, (size_t)n, file) == (size_t)n)
        return memory;
    free(memory);
    return NULL;
}

static bool read_layer(Layer *layer, FILE *file)
{
    Sizes *is = &layer->is;
    if (fread(is, sizeof *is, 1, file) != 1)
        return false;
    layer->share = take(file, is->n_lines, sizeof(double));
    layer->gains = take(file, is->n_terms * is->n_lines, sizeof(Complex));
    layer->factor = take(file, CHANNELS * is->sources, sizeof(double));
    layer->weights = take(file, 3 * is->n_terms * is->points, sizeof(double));
    layer->keys = take(file, 2 * is->n_keys, sizeof(uint64_t));
    layer->roots = take(file, is->points, sizeof(Complex));
    layer->lines = malloc((size_t)(CHANNELS * is->n_lines) * sizeof(Complex));
    layer->spectrum = malloc((size_t)is->points * sizeof(Complex));
    layer->other = malloc((size_t)is->points * sizeof(Complex));
    for (int i = 0; i < KEPT; i++) {
        layer->rows[i] = malloc((size_t)(is->points * CHANNELS) * sizeof(double));
        layer->made[i] = -1;
    }
    return layer->roots != NULL;
}

Noise *noise_read(FILE *file)
{
    Noise *noise = calloc(1, sizeof *noise);
    for (int i = 0; i < LAYERS; i++)
        if (!read_layer(&noise->layers[i], file)) {
            noise_free(noise);
            return NULL;
        }
    return noise;
}

void noise_free(Noise *noise)
{
    for (Layer *l = noise->layers; l < noise->layers + LAYERS; l++) {
        void *all[] = {l->share, l->gains, l->factor, l->weights, l->keys, l->roots, l->lines, l->spectrum, l->other,
                       l->rows[0], l->rows[1]};
        for (size_t i = 0; i < sizeof all / sizeof *all; i++)
            free(all[i]);
    }
    free(noise);
}
