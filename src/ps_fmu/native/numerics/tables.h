/* Rows of tables, interpolated. */

enum { ON_GRID = 2 /* the node at the cell itself */ };

static const double SNAP = 1e-6;     /* grid steps */
static const double FARTHEST = 1e15; /* grid steps; whole numbers up to there are rounded right */
static const double SCALE[NODES] = {1.0 / -120.0, 1.0 / 24.0, 1.0 / -12.0, 1.0 / 12.0, 1.0 / -24.0, 1.0 / 120.0};

/* Cells and weights (NODES, PART) of some times.  On the grid, one weight is 1; where all are, the others are left out. */
INLINE void find_places(const Tables *t, const double *time, int64_t n, double *cell, double (*weights)[PART])
{
    double rest[PART];
    bool beside = false; /* the grid, any of them */
    for (int64_t i = 0; i < n; i++) {
        const double position = (time[i] - t->start) * t->rate;
        const double nearest = round_to_whole(position);
        const double x = fabs(position - nearest) < SNAP ? nearest : position;
        cell[i] = fabs(x) < FARTHEST ? nearest - (nearest > x ? 1.0 : 0.0) : 0.0; /* also where it is no number */
        rest[i] = x - cell[i];
        beside = beside || rest[i] != 0.0;
    }
    if (!beside) {
        for (int64_t i = 0; i < n; i++)
            weights[ON_GRID][i] = 1.0;
        return;
    }
    for (int64_t i = 0; i < n; i++) {
        double d[NODES], w[NODES];
        for (int k = 0; k < NODES; k++)
            d[k] = rest[i] - (k - 2);
        w[0] = 1.0;
        for (int k = 0; k < NODES - 1; k++)
            w[k + 1] = w[k] * d[k];
        double after = d[NODES - 1];
        for (int k = NODES - 2; k >= 0; k--) {
            w[k] = w[k] * after;
            after = after * d[k];
        }
        for (int k = 0; k < NODES; k++)
            weights[k][i] = w[k] * SCALE[k];
    }
}

INLINE int64_t wrap(int64_t row, int64_t n)
{
    row %= n;
    return row < 0 ? row + n : row;
}

/* Rows `cell` + 0 ... `n` - 1 of the sum of both tables, each with zeros up to LANES. */
INLINE void fetch(const Tables *t, int64_t cell, int n, double (*rows)[LANES])
{
    int64_t one = wrap(cell + t->shift_one, t->n), other = wrap(cell + t->shift_other, t->n);
    for (int k = 0; k < n; k++) {
        for (int c = 0; c < CHANNELS; c++)
            rows[k][c] = t->one[one * CHANNELS + c];
        one = one + 1 < t->n ? one + 1 : 0;
        if (t->other == NULL)
            continue;
        for (int c = 0; c < CHANNELS; c++)
            rows[k][c] += t->other[other * CHANNELS + c];
        other = other + 1 < t->n ? other + 1 : 0;
    }
}

INSTRUCTIONS static void add_rows(const Tables *t, const double *time, int64_t n, double *wrench)
{
    double cell[PART], weights[NODES][PART], rows[NODES][LANES] = {{0.0}};
    int64_t fetched = INT64_MIN;
    for (int64_t first = 0; first < n; first += PART) {
        const int64_t m = n - first < PART ? n - first : PART;
        find_places(t, time + first, m, cell, weights);
        for (int64_t i = 0; i < m; i++, wrench += CHANNELS) {
            const int64_t here = (int64_t)cell[i];
            double sums[LANES] = {0.0};
            if (weights[ON_GRID][i] == 1.0) { /* on the grid: all other weights are 0 */
                fetch(t, here, 1, rows);
                fetched = INT64_MIN;
                for (int c = 0; c < CHANNELS; c++)
                    wrench[c] += rows[0][c];
                continue;
            }
            if (here != fetched)
                fetch(t, here - 2, NODES, rows);
            fetched = here;
            for (int k = 0; k < NODES; k++)
                for (int c = 0; c < LANES; c++)
                    sums[c] += rows[k][c] * weights[k][i];
            for (int c = 0; c < CHANNELS; c++)
                wrench[c] += sums[c];
        }
    }
}
