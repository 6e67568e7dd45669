// Extremes of a signal over spans of 1, 2, 4, ... values, so that a million values are drawn from a few thousand.

/** One value or one pair of extremes for each place of the axis. */
class Pyramid {
  constructor(low, high) {
    this.levels = [{ low, high: high || low }];
    while (this.levels.at(-1).low.length > 2) this.levels.push(halve(this.levels.at(-1)));
  }

  /** Places [first, last] in at most `most` spans: width of a span, and the first span. */
  choose(first, last, most) {
    let level = 0;
    while (((last - first + 1) >> level) > most && level < this.levels.length - 1) level++;
    return { level, width: 2 ** level, begin: first >> level, end: last >> level };
  }

  /** Places of the least and the largest value in [from, to). */
  extremes(from, to) {
    const { low, high } = this.levels[0];
    let [least, most] = [from, from];
    for (let i = from + 1; i < to; i++) {
      if (low[i] < low[least] || low[least] !== low[least]) least = i;
      if (high[i] > high[most] || high[most] !== high[most]) most = i;
    }
    return [least, most];
  }
}

function halve({ low, high }) {
  const count = Math.ceil(low.length / 2);
  const lower = new Float32Array(count);
  const upper = new Float32Array(count);
  const odd = low.length % 2;
  for (let i = 0, k = 0; i < count - odd; i++, k += 2) {
    // The second gives way to the first unless it is beyond it; a gap (NaN) gives way to any value.
    lower[i] = low[k + 1] < low[k] || low[k] !== low[k] ? low[k + 1] : low[k];
    upper[i] = high[k + 1] > high[k] || high[k] !== high[k] ? high[k + 1] : high[k];
  }
  if (odd) {
    lower[count - 1] = low[low.length - 1];
    upper[count - 1] = high[high.length - 1];
  }
  return { low: lower, high: upper };
}
