// Points of cases over two of their numbers, and the distribution of one of them, drawn by uPlot.

const CASE_HEIGHT = 320;
const MOST_BINS = 60;
/** A case is pointed at from within so many px. */
const NEAR = 24;

/** Engineering factor and unit of a column, by its largest magnitude. */
function scaleColumn(column) {
  const finite = column.numbers.filter(Number.isFinite);
  const largest = finite.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  return column.levels.length ? { factor: 1, unit: "" } : engineering(column.unit, largest);
}

function labelColumn(column) {
  const { unit } = scaleColumn(column);
  return unit ? `${column.title} (${unit})` : column.title;
}

/** The value of a column as text: that of a level where there are levels. */
function describeValue(column, value) {
  if (!Number.isFinite(value)) return "\u2013";
  return column.levels.length ? column.levels[Math.round(value)] : formatQuantity(value, column.unit);
}

/** The two ends of a text that is too long for an axis: its unit is at the end. */
function shorten(text) {
  return text.length > 44 ? `${text.slice(0, 18)} \u2026 ${text.slice(-22)}` : text;
}

function caseAxis(column, more) {
  const values = column.levels.length
    ? (_, ticks) => ticks.map((tick) => (Number.isInteger(tick) ? column.levels[tick] ?? "" : ""))
    : (_, ticks) => ticks.map((tick) => formatNumber(tick, 6));
  return { ...axisColours(), label: shorten(labelColumn(column)), labelSize: 22, labelGap: 0, values, ...more };
}

/** About what there is; a single value has room on both sides. */
function padRange(_, low, high) {
  if (low == null) return [0, 1];
  const margin = 0.04 * (high - low) || Math.abs(high) * 0.1 || 1;
  return [low - margin, high + margin];
}

/** A line across the plot at a value of its axis, drawn on the canvas, with a text. */
function drawLevel(plot, axis, value, colour, label, place) {
  const { left, top, width, height } = plot.bbox;
  const at = plot.valToPos(value, axis, true);
  const end = axis === "x" ? left + width : top + height;
  if (!(at >= (axis === "x" ? left : top) && at <= end)) return;
  const { ctx } = plot;
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = theme.colour(colour);
  ctx.lineWidth = 1.5 * devicePixelRatio;
  ctx.setLineDash(colour === "bad" ? [] : [5 * devicePixelRatio, 4 * devicePixelRatio]);
  ctx.beginPath();
  ctx.moveTo(axis === "x" ? at : left, axis === "x" ? top : at);
  ctx.lineTo(axis === "x" ? at : left + width, axis === "x" ? top + height : at);
  ctx.stroke();
  ctx.font = `${12 * devicePixelRatio}px system-ui`;
  ctx.textAlign = "left";
  const wide = ctx.measureText(label).width;
  const x = axis === "y" ? left + width - wide - 6 : Math.min(at + 4, left + width - wide);
  ctx.fillText(label, x, axis === "y" ? at - 5 : top + (14 + 15 * place) * devicePixelRatio);
  ctx.restore();
}

class CaseScatter {
  /** `chosen` says which columns: { x, y }; `point` takes the place of a case under the pointer, or null. */
  constructor(chosen, element, point, pin) {
    Object.assign(this, { chosen, element, marked: [] });
    this.make();
    element.addEventListener("mousemove", (event) => point(this.find(event)));
    element.addEventListener("mouseleave", () => point(null));
    element.addEventListener("click", (event) => pin(this.find(event)));
  }

  get width() { return Math.max(this.printWidth || this.element.clientWidth, 160); }

  /** Draw anew: other columns have other axes. */
  make() {
    this.plot?.destroy();
    const { x, y } = this.chosen();
    const [across, up] = [scaleColumn(x).factor, scaleColumn(y).factor];
    this.order = [...x.numbers.keys()].filter((k) => Number.isFinite(x.numbers[k]) && Number.isFinite(y.numbers[k]))
      .sort((a, b) => x.numbers[a] - x.numbers[b]);
    this.x = this.order.map((k) => x.numbers[k] * across);
    this.y = this.order.map((k) => y.numbers[k] * up);
    const limit = y.limit === null ? Infinity : y.limit * up;
    const side = (above) => this.y.map((value) => ((value > limit) === above ? value : null));
    const dots = (colour) => ({
      paths: () => null,
      points: { show: true, size: this.order.length > 2000 ? 4 : 6, width: 0, fill: () => theme.faded(colour, 0.7) },
    });
    this.plot = new uPlot({
      width: this.width, height: CASE_HEIGHT, legend: { show: false },
      cursor: { points: { show: false }, drag: { x: true, y: true, uni: 20 }, y: false, x: false },
      scales: { x: { time: false, range: padRange }, y: { range: padRange } },
      axes: [caseAxis(x, { size: 30 }), caseAxis(y, { size: 64 })],
      series: [{}, dots("active"), dots("passive")],
      hooks: { draw: [(plot) => this.drawMarks(plot, limit)] },
    }, [this.x, side(false), side(true)], this.element);
  }

  drawMarks(plot, limit) {
    if (Number.isFinite(limit)) drawLevel(plot, "y", limit, "bad", "limit", 0);
    const { ctx } = plot;
    ctx.save();
    ctx.lineWidth = 2 * devicePixelRatio;
    ctx.strokeStyle = theme.colour("text");
    for (const place of this.marked) {
      const k = this.order.indexOf(place);
      if (k < 0) continue;
      ctx.beginPath();
      ctx.arc(plot.valToPos(this.x[k], "x", true), plot.valToPos(this.y[k], "y", true), 6 * devicePixelRatio, 0, 7);
      ctx.stroke();
    }
    ctx.restore();
  }

  /** Ring these cases. */
  mark(places) {
    this.marked = places;
    this.plot.redraw(false);
  }

  /** Place of the case that is nearest to the pointer; null if none is near. */
  find(event) {
    const box = this.plot.over.getBoundingClientRect();
    const [left, top] = [event.clientX - box.left, event.clientY - box.top];
    let [best, found] = [NEAR ** 2, null];
    this.order.forEach((place, k) => {
      const away = (this.plot.valToPos(this.x[k], "x") - left) ** 2 + (this.plot.valToPos(this.y[k], "y") - top) ** 2;
      if (away < best) [best, found] = [away, place];
    });
    return found;
  }

  resize(printWidth) {
    this.printWidth = printWidth;
    this.plot.setSize({ width: this.width, height: CASE_HEIGHT });
  }
}

class CaseDistribution {
  constructor(chosen, element) {
    Object.assign(this, { chosen, element, cumulative: false });
    this.make();
  }

  get width() { return Math.max(this.printWidth || this.element.clientWidth, 160); }

  make() {
    this.plot?.destroy();
    const { y } = this.chosen();
    const { factor } = scaleColumn(y);
    const values = y.numbers.filter(Number.isFinite).map((value) => value * factor).sort();
    const paths = this.cumulative ? uPlot.paths.stepped({ align: 1 }) : uPlot.paths.bars({ size: [1, Infinity], align: 1, gap: 1 });
    const colour = () => theme.faded("reference", this.cumulative ? 0.9 : 0.5);
    const marks = [...y.marks.map((mark) => ({ ...mark, colour: "active" })),
      ...(y.limit === null ? [] : [{ label: "limit", value: y.limit, colour: "bad" }])];
    const ends = [values[0], values[values.length - 1], ...(y.limit === null ? [] : [y.limit * factor])];
    this.plot = new uPlot({
      width: this.width, height: CASE_HEIGHT, legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, range: () => padRange(null, Math.min(...ends), Math.max(...ends)) },
        y: { range: (_, _low, high) => [0, this.cumulative ? 1.02 : (high || 1) * 1.25] }, // room for the labels
      },
      axes: [caseAxis(y, { size: 30 }), { ...axisColours(), label: this.cumulative ? "share of the cases" : "cases", labelSize: 22, size: 52 }],
      series: [{}, { paths, stroke: colour, fill: this.cumulative ? null : colour, width: this.cumulative ? 2 : 0, points: { show: false } }],
      hooks: { draw: [(plot) => marks.forEach((mark, k) => drawLevel(plot, "x", mark.value * factor, mark.colour, mark.label, k))] },
    }, values.length ? (this.cumulative ? accumulate(values) : count(values)) : [[0], [0]], this.element);
  }

  resize(printWidth) {
    this.printWidth = printWidth;
    this.plot.setSize({ width: this.width, height: CASE_HEIGHT });
  }
}

/** Left edges of equal bins, and the values in each; an empty bin closes them. */
function count(values) {
  const bins = Math.min(MOST_BINS, Math.max(5, Math.round(2 * Math.cbrt(values.length))));
  const low = values[0];
  const width = (values[values.length - 1] - low) / bins || Math.abs(low) * 0.01 || 1;
  const counts = new Array(bins + 1).fill(0);
  for (const value of values) counts[Math.min(Math.floor((value - low) / width), bins - 1)] += 1;
  return [counts.map((_, k) => low + k * width), counts];
}

/** Values in ascending order, and the share of all that is not above each. */
function accumulate(values) {
  return [[...values], [...values].map((_, k) => (k + 1) / values.length)];
}
