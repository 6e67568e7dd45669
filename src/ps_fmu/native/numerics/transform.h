/* Spectral lines to samples: one phase of polyphase.py for LANES spectra at a time, side by side in each vector. */

typedef struct {
    Vector re[LANES / WIDTH], im[LANES / WIDTH];
} Lanes;

#define EACH for (int v = 0; v < LANES / WIDTH; v++)

INLINE Lanes add(Lanes a, Lanes b)
{
    EACH a.re[v] += b.re[v], a.im[v] += b.im[v];
    return a;
}

INLINE Lanes subtract(Lanes a, Lanes b)
{
    EACH a.re[v] -= b.re[v], a.im[v] -= b.im[v];
    return a;
}

INLINE Lanes scale(Lanes a, double factor)
{
    EACH a.re[v] *= factor, a.im[v] *= factor;
    return a;
}

/* a + i b */
INLINE Lanes add_turned(Lanes a, Lanes b)
{
    EACH a.re[v] -= b.im[v], a.im[v] += b.re[v];
    return a;
}

/* a - i b */
INLINE Lanes subtract_turned(Lanes a, Lanes b)
{
    EACH a.re[v] += b.im[v], a.im[v] -= b.re[v];
    return a;
}

INLINE Lanes conjugate(Lanes a)
{
    EACH a.im[v] = -a.im[v];
    return a;
}

INLINE Lanes multiply(Lanes a, const double *by)
{
    Lanes product;
    EACH
    {
        product.re[v] = a.re[v] * by[0] - a.im[v] * by[1];
        product.im[v] = a.re[v] * by[1] + a.im[v] * by[0];
    }
    return product;
}

/* x[k] = sum of x[j] exp(2 pi i j k / radix) */
INLINE void transform_few(Lanes *x, const int radix)
{
    if (radix == 2) {
        const Lanes a = x[0];
        x[0] = add(a, x[1]);
        x[1] = subtract(a, x[1]);
    } else if (radix == 3) {
        const double s = 0.8660254037844386; /* sin 120 deg */
        const Lanes sum = add(x[1], x[2]), turned = scale(subtract(x[1], x[2]), s);
        const Lanes middle = subtract(x[0], scale(sum, 0.5));
        x[0] = add(x[0], sum);
        x[1] = add_turned(middle, turned);
        x[2] = subtract_turned(middle, turned);
    } else if (radix == 4) {
        const Lanes a = add(x[0], x[2]), b = subtract(x[0], x[2]), c = add(x[1], x[3]), d = subtract(x[1], x[3]);
        x[0] = add(a, c);
        x[1] = add_turned(b, d);
        x[2] = subtract(a, c);
        x[3] = subtract_turned(b, d);
    } else {
        const double c1 = 0.30901699437494745, c2 = -0.8090169943749475; /* cosines and sines of 72 and 144 deg */
        const double s1 = 0.9510565162951535, s2 = 0.5877852522924731;
        const Lanes a = add(x[1], x[4]), b = add(x[2], x[3]), c = subtract(x[1], x[4]), d = subtract(x[2], x[3]);
        const Lanes near = add(x[0], add(scale(a, c1), scale(b, c2))), far = add(x[0], add(scale(a, c2), scale(b, c1)));
        const Lanes e = add(scale(c, s1), scale(d, s2)), f = subtract(scale(c, s2), scale(d, s1));
        x[0] = add(x[0], add(a, b));
        x[1] = add_turned(near, e);
        x[2] = add_turned(far, f);
        x[3] = subtract_turned(far, f);
        x[4] = subtract_turned(near, e);
    }
}

/* One pass of a transform of n numbers, after those whose radices have the product s (Stockham). */
INLINE void pass(const Lanes *from, Lanes *to, int64_t n, int64_t s, const double *roots, const int radix)
{
    const int64_t m = n / s / radix;
    for (int64_t p = 0; p < m; p++) {
        for (int64_t q = 0; q < s; q++) {
            Lanes x[5];
            for (int j = 0; j < radix; j++)
                x[j] = from[q + s * (p + m * j)];
            transform_few(x, radix);
            to[q + s * radix * p] = x[0];
            for (int k = 1; k < radix; k++)
                to[q + s * (radix * p + k)] = multiply(x[k], roots + 2 * 2 * (p * k * s));
        }
    }
}

/* Some passes of a transform of n numbers in `a`, of which those whose radices have the product *s are done; the result is
   returned, in `a` or in `b`.  `roots`: exp(2 pi i k / 2n), k < 2n. */
INSTRUCTIONS static Lanes *transform(Lanes *a, Lanes *b, int64_t n, const double *roots, int64_t *s, int64_t passes)
{
    for (; *s < n && passes > 0; passes--) {
        const int64_t left = n / *s;
        const int radix = left % 5 == 0 ? 5 : left % 4 == 0 ? 4 : left % 3 == 0 ? 3 : 2;
        switch (radix) { /* each with its own code */
        case 5: pass(a, b, n, *s, roots, 5); break;
        case 4: pass(a, b, n, *s, roots, 4); break;
        case 3: pass(a, b, n, *s, roots, 3); break;
        default: pass(a, b, n, *s, roots, 2); break;
        }
        *s *= radix;
        Lanes *other = a;
        a = b;
        b = other;
    }
    return a;
}

/* Add some lines to the spectrum of a phase. */
INLINE void fold(const Lines *l, const Lanes *terms, const double *turns, Lanes *spectrum, int64_t first, int64_t end)
{
    for (const Run *run = l->runs; run < l->runs + l->n_runs; run++) {
        const int64_t last = run->end < end ? run->end : end;
        for (int64_t i = run->first > first ? run->first : first; i < last; i++) {
            const Lanes line = multiply(terms[i], turns + 2 * i);
            Lanes *bin = spectrum + run->bin + (run->mirrored ? run->first - i : i - run->first);
            *bin = add(*bin, run->mirrored ? conjugate(line) : line);
        }
    }
}

/* The spectrum of n real numbers to that of n/2 complex ones, of which the real parts are the even ones of these. */
INLINE void pair_up(Lanes *x, int64_t half, const double *roots)
{
    EACH x[0].im[v] = x[half].im[v] = (Vector){0.0}; /* a real signal has none */
    for (int64_t k = 0; k <= half / 2; k++) {
        const Lanes a = x[k], b = conjugate(x[half - k]);
        const Lanes even = add(a, b), odd = multiply(subtract(a, b), roots + 2 * k);
        x[k] = add_turned(even, odd);
        x[half - k] = conjugate(subtract_turned(even, odd));
    }
}

/* Samples from `first` to before `end` with the sizes of their terms into rows `stride` apart, for so many terms and
   channels. */
INLINE void store(const double *samples, const double *sizes, int64_t points, int64_t first, int64_t end, double *rows,
                  int64_t stride, const int n_terms, const int channels)
{
    const double gain = 1.0 / (double)points;
    samples += first * LANES, rows += first * stride;
    for (int64_t i = first; i < end; i++, samples += LANES, rows += stride) {
        double sums[CHANNELS] = {0.0};
        for (int t = 0; t < n_terms; t++) {
            const double size = sizes[t * points + i] * gain;
            for (int c = 0; c < channels; c++)
                sums[c] += samples[t * channels + c] * size;
        }
        for (int c = 0; c < channels; c++)
            rows[c] = sums[c];
    }
}

INSTRUCTIONS static void store_samples(const Lines *l, const double *samples, int64_t phase, int64_t group,
                                       const double *sizes, int64_t first, int64_t end, double *rows)
{
    const int64_t stride = l->phases * CHANNELS;
    rows += phase * CHANNELS;
    if (l->n_terms == 1)
        store(samples, sizes, l->points, first, end, rows, stride, 1, CHANNELS);
    else
        store(samples, sizes, l->points, first, end, rows + group * (CHANNELS / 3), stride, 3, CHANNELS / 3);
}
