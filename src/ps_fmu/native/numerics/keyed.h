/* Random numbers that belong to whole numbers: those of numpy's Generator(Philox(SeedSequence(words))), to the bit, without
   its objects, which take longer to make than a block of numbers takes to draw. */

INLINE uint32_t mix_word(uint32_t word, uint32_t *factor, uint32_t next)
{
    word ^= *factor;
    *factor *= next;
    word *= *factor;
    return word ^ word >> 16;
}

INLINE uint32_t mix_pair(uint32_t a, uint32_t b)
{
    const uint32_t mixed = 0xca01f9ddu * a - 0x4973f715u * b;
    return mixed ^ mixed >> 16;
}

/* numpy.random.SeedSequence(words).generate_state(2, uint64) */
INLINE void find_key(const uint32_t *words, int64_t n, uint64_t key[2])
{
    uint32_t pool[4], state[4], factor = 0x43b0d7e5u;
    for (int i = 0; i < 4; i++)
        pool[i] = mix_word(i < n ? words[i] : 0, &factor, 0x931e8875u);
    for (int from = 0; from < 4; from++)
        for (int to = 0; to < 4; to++)
            if (from != to)
                pool[to] = mix_pair(pool[to], mix_word(pool[from], &factor, 0x931e8875u));
    for (int64_t from = 4; from < n; from++)
        for (int to = 0; to < 4; to++)
            pool[to] = mix_pair(pool[to], mix_word(words[from], &factor, 0x931e8875u));
    factor = 0x8b51f9ddu;
    for (int i = 0; i < 4; i++)
        state[i] = mix_word(pool[i], &factor, 0x58f38dedu);
    for (int i = 0; i < 2; i++)
        key[i] = state[2 * i] | (uint64_t)state[2 * i + 1] << 32;
}

__extension__ typedef unsigned __int128 Wide; /* a product of two words */

/* Philox4x64-10 (Salmon, Moraes, Dror, Shaw: Parallel random numbers, SC11) of the counter (count, 0, 0, 0). */
INLINE void scramble(uint64_t count, const uint64_t key[2], uint64_t x[4])
{
    uint64_t a = key[0], b = key[1], x0 = count, x1 = 0, x2 = 0, x3 = 0;
    for (int round = 0; round < 10; round++) {
        const Wide one = (Wide)0xd2e7470ee14c6c93u * x0;
        const Wide other = (Wide)0xca5a826395121157u * x2;
        x0 = (uint64_t)(other >> 64) ^ x1 ^ a;
        x2 = (uint64_t)(one >> 64) ^ x3 ^ b;
        x1 = (uint64_t)other;
        x3 = (uint64_t)one;
        __asm__("" : "+r"(x0), "+r"(x2)); /* else the compiler moves them to vectors and back: twice the time */
        a += 0x9e3779b97f4a7c15u; /* the golden ratio */
        b += 0xbb67ae8584caa73bu; /* sqrt(3) - 1 */
    }
    x[0] = x0, x[1] = x1, x[2] = x2, x[3] = x3;
}

/* n numbers from 0 to below 1, from the one at place `first` on.  Writes up to three more before and behind them. */
INLINE void draw_uniform(const uint64_t key[2], int64_t first, int64_t n, double *numbers)
{
    for (int64_t i = -(first % 4); i < n; i += 4) {
        uint64_t x[4];
        scramble((uint64_t)((first + i) / 4 + 1), key, x);
        for (int k = 0; k < 4; k++)
            numbers[i + k] = (double)(int64_t)(x[k] >> 11) * (1.0 / 9007199254740992.0);
    }
}

/* Of a row of normal numbers, whose first half are the cosines, m from place `first` of each half on. */
INSTRUCTIONS static void draw_part(const uint64_t key[2], int64_t row, int64_t half, int64_t first, int64_t m,
                                   double *cosines, double *sines)
{
    double u[PART + 8], v[PART + 8];
    draw_uniform(key, 2 * half * row + first, m, u + 4);
    draw_uniform(key, 2 * half * row + half + first, m, v + 4);
    make_normal(u + 4, v + 4, m, cosines, sines);
}

/* Normal numbers (rows, 2 half) that belong to words. */
INSTRUCTIONS static void draw_keyed(const uint32_t *words, int64_t n_words, int64_t rows, int64_t half, double *normal)
{
    uint64_t key[2];
    find_key(words, n_words, key);
    for (int64_t row = 0; row < rows; row++, normal += 2 * half) {
        for (int64_t first = 0; first < half; first += PART) {
            const int64_t m = half - first < PART ? half - first : PART;
            draw_part(key, row, half, first, m, normal + first, normal + half + first);
        }
    }
}
