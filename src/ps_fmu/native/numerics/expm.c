/* exp(A h) by a series of phi(X) = (exp(X) - 1) / X: a step that is short against all that A contains is summed, a longer
   one is halved until it is short, and doubled by phi(2 X) = phi(X) (exp(X) + 1) / 2 (N. J. Higham, Functions of
   Matrices, SIAM 2008, sections 10.3 and 10.7.4).  With integrals of higher order likewise: phi2(X) = (phi(X) - 1) / X,
   phi2(2 X) = (2 phi2(X) + phi(X)^2) / 4.  It needs neither an inverse of A, which a free mass does not have, nor a
   solution of equations, and each matrix is the product of two others, column by column. */
#include "expm.h"

#include "../kernel/kernel.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

enum { LANES = 8 };

/* Largest norm of A h, balanced, up to which the series has all digits: its first missing term is 8e-17. */
static const double SHORT = 0.8;

/* Each doubling costs a binary digit of what is slow: after so many, 1e-7 of it is left to chance. */
enum { MOST_HALVINGS = 30 };

/* Of the balancing; the plant needs two.  Couplings of 1e300 in one direction only need ten. */
enum { MOST_SWEEPS = 20 };

/* Part in the norm of A h, balanced, of what acts in one direction only. */
static const double LITTLE = 0.01;

/* 1 / k! from k = 1 on. */
static const double FACTORS[] = {
    1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0, 1.0 / 362880.0,
    1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0, 1.0 / 6227020800.0, 1.0 / 87178291200.0,
    1.0 / 1307674368000.0, 1.0 / 20922789888000.0, 1.0 / 355687428096000.0,
};

/* The stages, in their order; powers and sums by M. Paterson and L. Stockmeyer, SIAM J. Comput. 2, 1973. */
enum {
    BALANCE, SCALE, SQUARE, CUBE, FOURTH, SUM_LAST, SUM_2, SUM_1, SUM_0, INTEGRATE, EXPONENTIATE,
    DOUBLE_RAMP, DOUBLE_HELD, DOUBLE_EXPONENTIAL, GIVE_EXPONENTIAL, GIVE_HELD, GIVE_RAMP, DONE
};

/* Matrices in the room, by number, before scale, its inverse, and three columns.  X4 and SPARE, X2 and X3 take turns in
   the doublings; phi2 is in Q. */
enum { X, X2, X3, X4, P, Q, SPARE, MATRICES };

int64_t discretise_room(int64_t n)
{
    const int64_t stride = (n + LANES - 1) / LANES * LANES;
    return MATRICES * n * stride + 5 * stride;
}

void discretise_begin(Discretisation *d)
{
    d->stage = BALANCE;
    d->column = d->halvings = d->doublings = d->sweeps = 0;
    d->largest = INFINITY;
}

static double *matrix(const Discretisation *d, int64_t number)
{
    return d->room + number * d->n * d->stride;
}

static double *column_of(const Discretisation *d, int64_t number, int64_t j)
{
    return matrix(d, number) + j * d->stride;
}

static double *scale_of(const Discretisation *d)
{
    return matrix(d, MATRICES);
}

static double *back_of(const Discretisation *d)
{
    return scale_of(d) + d->stride;
}

/* log2 of a number above 0, within 0.09. */
static double find_log2(double x)
{
    int64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (double)bits / 4503599627370496.0 - 1023.0;
}

/* 2 to the power of a whole number from -1022 to 1023. */
static double find_power(double exponent)
{
    const int64_t bits = ((int64_t)exponent + 1023) << 52;
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static double round_to_whole(double x)
{
    return (double)(int64_t)(x < 0.0 ? x - 0.5 : x + 0.5);
}

/* One sweep of the search for powers of two that give rows and columns of A about the same size (E. E. Osborne, J. ACM 7,
   1960): nothing is rounded, so that the results have the same bits whatever they are.  All rows and columns at once,
   each by half of what it lacks: with all of it, two that share an element would swap their sizes for ever.  It ends where
   the norm is small enough for the series, or once no factor is larger than two: further ones hardly change the norm.
   Where a row is zero, its column may be scaled at will and comes to a little, and likewise a row whose column is zero.
   DISCRETISE_ON: another sweep. */
static int64_t balance(Discretisation *d)
{
    const int64_t n = d->n, stride = d->stride;
    const double little = LITTLE / d->step;
    double *scale = scale_of(d), *back = back_of(d), *rows = back + stride, *columns = rows + stride;
    double *largest = columns + stride, size = 0.0;
    int finite = 1;
    if (d->sweeps == 0)
        for (int64_t j = 0; j < n; j++) {
            scale[j] = back[j] = 1.0;
            for (int64_t i = 0; i < n; i++)
                finite &= fabs(d->A[j * stride + i]) <= DBL_MAX;
        }
    memset(rows, 0, sizeof *rows * (size_t)stride);
    memset(largest, 0, sizeof *largest * (size_t)stride);
    for (int64_t j = 0; j < n; j++) {
        const double *a = d->A + j * stride, by = scale[j];
        double sum = 0.0, most = 0.0;
        for (int64_t i = 0; i < n; i++) {
            const double element = i == j ? 0.0 : fabs(a[i]);
            rows[i] += element * by;
            sum += element * back[i];
            largest[i] = element > largest[i] ? element : largest[i];
            most = element > most ? element : most;
        }
        columns[j] = sum * by + (most > 0.0 ? 0.0 : -1.0);
    }
    for (int64_t i = 0; i < n; i++) {
        /* Sums of elements as small as 1e-300 may underflow to zero, which has no logarithm. */
        const bool has_column = columns[i] >= 0.0;
        rows[i] = rows[i] * back[i] + (largest[i] > 0.0 ? DBL_MIN : little);
        columns[i] = has_column ? columns[i] + DBL_MIN : little;
        const double sum = columns[i] + fabs(d->A[i * stride + i]);
        size = sum > size || sum != sum ? sum : size;
    }
    size *= d->step;
    if (!finite || size != size)
        return DISCRETISE_FAILED;
    if (size <= SHORT || !(d->largest > 1.0) || d->sweeps > MOST_SWEEPS) {
        double most = SHORT;
        while (d->halvings <= MOST_HALVINGS && size > most) {
            most *= 2.0;
            d->halvings++;
        }
        return d->halvings > MOST_HALVINGS ? DISCRETISE_FAILED : DISCRETISE_DONE;
    }
    d->largest = 0.0;
    for (int64_t i = 0; i < n; i++) {
        const double step = round_to_whole(0.25 * (find_log2(rows[i]) - find_log2(columns[i])));
        scale[i] *= find_power(step);
        back[i] = 1.0 / scale[i];
        d->largest = fabs(step) > d->largest ? fabs(step) : d->largest;
        finite &= scale[i] <= DBL_MAX && back[i] <= DBL_MAX;
    }
    d->sweeps++;
    return finite ? DISCRETISE_ON : DISCRETISE_FAILED;
}

/* w <- left x, where left is a matrix of the room. */
static bool times(const Discretisation *d, int64_t left, const double *x, double *w)
{
    return kernel_product(matrix(d, left), d->stride, x, d->n, w);
}

/* Where the results of so many doublings are, and where those of the next one go. */
typedef struct {
    int64_t exponential, next_exponential, phi, next_phi;
} Turn;

static Turn find_turn(int64_t doubled)
{
    return doubled % 2 != 0 ? (Turn){X3, X2, X4, SPARE} : (Turn){X2, X3, SPARE, X4};
}

/* Column j of the sum of powers that belong to row `row` of the factors; `first`: of the series. */
static void add_powers(const Discretisation *d, int64_t row, int64_t first, int64_t j, double *w)
{
    const double *f = FACTORS + 4 * row + first;
    const double *x = column_of(d, X, j), *x2 = column_of(d, X2, j), *x3 = column_of(d, X3, j);
    for (int64_t i = 0; i < d->n; i++)
        w[i] += f[1] * x[i] + f[2] * x2[i] + f[3] * x3[i];
    w[j] += f[0];
}

/* One column of a stage; false: a number is not finite. */
static bool make_column(Discretisation *d, int64_t j)
{
    const int64_t n = d->n, stride = d->stride;
    const double *scale = scale_of(d), *back = back_of(d);
    const Turn turn = find_turn(d->doublings);
    const int64_t first = d->ramp != NULL ? 1 : 0;
    double *const spare = scale_of(d) + 2 * stride;
    switch (d->stage) {
    case SCALE: {
        const double by = d->step * find_power(-(double)d->halvings);
        double *x = column_of(d, X, j);
        memset(x, 0, sizeof *x * (size_t)stride);
        for (int64_t i = 0; i < n; i++)
            x[i] = d->A[j * stride + i] * (by * scale[j]) * back[i];
        return true;
    }
    case SQUARE:
        return times(d, X, column_of(d, X, j), column_of(d, X2, j));
    case CUBE:
        return times(d, X2, column_of(d, X, j), column_of(d, X3, j));
    case FOURTH:
        return times(d, X2, column_of(d, X2, j), column_of(d, X4, j));
    case SUM_LAST:
        memset(column_of(d, P, j), 0, sizeof(double) * (size_t)stride);
        add_powers(d, 3, first, j, column_of(d, P, j));
        return true;
    case SUM_2:
    case SUM_1:
    case SUM_0: {
        const int64_t row = SUM_0 - d->stage, from = row % 2 == 0 ? P : Q, to = row % 2 == 0 ? Q : P;
        if (!times(d, from, column_of(d, X4, j), column_of(d, to, j)))
            return false;
        add_powers(d, row, first, j, column_of(d, to, j));
        return true;
    }
    case INTEGRATE: /* Q is phi, or phi2 */
        if (d->ramp == NULL) {
            memcpy(column_of(d, SPARE, j), column_of(d, Q, j), sizeof(double) * (size_t)stride);
            return true;
        }
        if (!times(d, X, column_of(d, Q, j), column_of(d, SPARE, j)))
            return false;
        column_of(d, SPARE, j)[j] += 1.0;
        return true;
    case EXPONENTIATE:
        if (!times(d, X, column_of(d, SPARE, j), column_of(d, X2, j)))
            return false;
        column_of(d, X2, j)[j] += 1.0;
        return true;
    case DOUBLE_RAMP: {
        if (d->ramp == NULL)
            return true;
        double *w = column_of(d, Q, j);
        if (!times(d, turn.phi, column_of(d, turn.phi, j), spare))
            return false;
        for (int64_t i = 0; i < n; i++)
            w[i] = 0.5 * w[i] + 0.25 * spare[i];
        return true;
    }
    case DOUBLE_HELD: {
        const double *phi = column_of(d, turn.phi, j);
        double *w = column_of(d, turn.next_phi, j);
        if (!times(d, turn.phi, column_of(d, turn.exponential, j), w))
            return false;
        for (int64_t i = 0; i < n; i++)
            w[i] = 0.5 * (w[i] + phi[i]);
        return true;
    }
    case DOUBLE_EXPONENTIAL:
        return times(d, turn.exponential, column_of(d, turn.exponential, j), column_of(d, turn.next_exponential, j));
    case GIVE_EXPONENTIAL: {
        const double *x = column_of(d, turn.exponential, j);
        double *w = d->exponential + j * stride;
        int finite = 1;
        for (int64_t i = 0; i < n; i++) {
            w[i] = x[i] * scale[i] * back[j];
            finite &= fabs(w[i]) <= DBL_MAX;
        }
        return finite;
    }
    default: { /* GIVE_HELD, GIVE_RAMP */
        double *w = (d->stage == GIVE_HELD ? d->held : d->ramp) + j * stride, *driven = spare;
        memset(driven, 0, sizeof *driven * (size_t)stride);
        int finite = 1;
        for (int64_t i = 0; i < n; i++) {
            driven[i] = d->B[j * stride + i] * (d->step * back[i]);
            finite &= fabs(driven[i]) <= DBL_MAX;
        }
        if (!finite || !times(d, d->stage == GIVE_HELD ? turn.phi : Q, driven, w))
            return false;
        for (int64_t i = 0; i < n; i++) {
            w[i] *= scale[i];
            finite &= fabs(w[i]) <= DBL_MAX;
        }
        return finite;
    }
    }
}

/* Go to the next stage, in its first column. */
static void advance(Discretisation *d)
{
    d->column = 0;
    if (d->stage == DOUBLE_EXPONENTIAL) {
        d->doublings++;
        d->stage = DOUBLE_RAMP - 1;
    }
    d->stage++;
    if (d->stage == DOUBLE_RAMP && d->doublings == d->halvings)
        d->stage = GIVE_EXPONENTIAL;
    if (d->stage == GIVE_RAMP && d->ramp == NULL)
        d->stage = DONE;
}

int64_t discretise(Discretisation *d, int64_t budget)
{
    const int64_t cost = d->n * d->stride;
    for (int64_t spent = 0; d->n > 0 && d->stage != DONE && spent < budget; spent += cost) {
        if (d->stage == BALANCE) {
            const int64_t found = balance(d);
            if (found == DISCRETISE_FAILED)
                return DISCRETISE_FAILED;
            if (found == DISCRETISE_DONE)
                advance(d);
            continue;
        }
        if (d->column < (d->stage >= GIVE_HELD ? d->m : d->n) && !make_column(d, d->column++))
            return DISCRETISE_FAILED;
        while (d->stage != DONE && d->column >= (d->stage >= GIVE_HELD ? d->m : d->n))
            advance(d);
    }
    return d->n == 0 || d->stage == DONE ? DISCRETISE_DONE : DISCRETISE_ON;
}

/* --- Blocks ----------------------------------------------------------------------------------------------------- */

/* Groups in a block: their sums stay in registers. */
enum { LARGEST = 8 };

/* Costs in units of a group with a column, as measured with registers of eight doubles (0.1 to 0.2 ns): to fetch and test
   an operand; to begin a block, and to store its results.  Half as much again for a block would keep the map of
   FeedforwardIsolator whole, which takes 15 ns more than its three blocks. */
enum { OF_COLUMN = 1, OF_BLOCK = 20 };

static int64_t count_bits(uint64_t word)
{
    return __builtin_popcountll(word);
}

/* Which columns each group of rows uses, as bits, `width` words a group. */
static void find_used(const double *by_columns, int64_t n, int64_t groups, int64_t width, uint64_t *used)
{
    memset(used, 0, sizeof *used * (size_t)(groups * width));
    for (int64_t j = 0; j < n; j++)
        for (int64_t group = 0; group < groups; group++, by_columns += LANES) {
            uint64_t any = 0, bits[LANES];
            memcpy(bits, by_columns, sizeof bits);
            for (int64_t k = 0; k < LANES; k++)
                any |= bits[k];
            used[group * width + j / 64] |= (uint64_t)(any << 1 != 0) << j % 64;
        }
}

int64_t make_blocks(const double *by_columns, int64_t n, int64_t stride, const BlockRoom *room, Map *map)
{
    const int64_t groups = stride / LANES, width = n / 64 + 1;
    uint64_t *const used = (uint64_t *)room->words, *const joined = used + groups * width;
    int64_t *const begins = room->words + (groups + 1) * width; /* of the last block, where blocks end there */
    find_used(by_columns, n, groups, width, used);
    /* The cheapest division of all groups into neighbours. */
    room->costs[0] = 0.0;
    for (int64_t last = 1; last <= groups; last++) {
        memset(joined, 0, sizeof *joined * (size_t)width);
        room->costs[last] = INFINITY;
        for (int64_t first = last - 1; first >= 0 && first >= last - LARGEST; first--) {
            int64_t columns = 0;
            for (int64_t k = 0; k < width; k++) {
                joined[k] |= used[first * width + k];
                columns += count_bits(joined[k]);
            }
            const double cost = room->costs[first] + (double)(OF_BLOCK + columns * (OF_COLUMN + last - first));
            if (cost < room->costs[last]) {
                room->costs[last] = cost;
                begins[last] = first;
            }
        }
    }
    map->n_blocks = 0;
    for (int64_t last = groups; last > 0; last = begins[last])
        map->n_blocks++;
    Block *block = room->blocks + map->n_blocks;
    for (int64_t last = groups; last > 0; last = begins[last])
        *--block = (Block){.row = begins[last] * LANES, .n_rows = (last - begins[last]) * LANES};
    int64_t column = 0, number = 0;
    for (; block < room->blocks + map->n_blocks; block++) {
        block->column = column;
        block->number = number;
        for (int64_t j = 0; j < n; j++) {
            bool any = false;
            for (int64_t k = 0; k < block->n_rows / LANES; k++)
                any |= used[(block->row / LANES + k) * width + j / 64] >> j % 64 & 1;
            if (!any)
                continue;
            room->columns[column++] = (int32_t)j;
            memcpy(room->numbers + number, by_columns + j * stride + block->row, sizeof(double) * (size_t)block->n_rows);
            number += block->n_rows;
        }
        block->n_columns = column - block->column;
    }
    map->blocks = room->blocks;
    map->columns = room->columns;
    map->numbers = room->numbers;
    return number;
}

/* --- Maps of held inputs ---------------------------------------------------------------------------------------- */

static HeldMap *find_map(HeldMaps *held, double step)
{
    for (HeldMap *map = held->maps; map < held->maps + HELD_MAPS; map++)
        if (map->step == step)
            return map;
    return NULL;
}

/* The map of a step of this size, in place of the oldest; NULL: there is none. */
static HeldMap *make_map(HeldMaps *held, double step)
{
    Discretisation *work = &held->work;
    HeldMap *made = &held->maps[held->oldest];
    made->step = 0.0;
    work->step = step;
    work->exponential = made->by_columns;
    work->held = made->by_columns + work->n * work->stride;
    discretise_begin(work);
    if (discretise(work, INT64_MAX) != DISCRETISE_DONE)
        return NULL;
    make_blocks(made->by_columns, work->n + work->m, work->stride, &made->room, &made->map);
    made->step = step;
    held->oldest = (held->oldest + 1) % HELD_MAPS;
    return made;
}

int64_t use_held_map(void *arguments, Core *core)
{
    HeldMap *found = find_map(arguments, core->step);
    if (found == NULL)
        found = make_map(arguments, core->step);
    if (found == NULL) {
        write_message(core, MESSAGE_REFUSAL, "the step of %g s is so long that few digits of its results would be right",
                      core->step);
        return CALL_REFUSED;
    }
    core->maps[0] = found->map;
    return CALL_DONE;
}
