// A chart of curves over a linked axis, drawn by uPlot: a pixel shows the extremes of all values that fall on it.

const CHART_HEIGHT = 250;
const PRINT_HEIGHT = 200;

class LineChart {
  constructor(packed, link, element) {
    this.link = link;
    this.packed = packed;
    this.curves = packed.curves.map((curve) => ({
      ...curve,
      low: decode(curve.low),
      high: decode(curve.high || curve.low),
    }));
    this.plotElement = make("div", { class: "plot" });
    this.readout = make("div", { class: "readout" });
    // Ticks of a straight axis carry the unit themselves.
    const unit = packed.logarithmic && prettyUnit(packed.unit) ? ` (${prettyUnit(packed.unit)})` : "";
    element.append(make("h3", {}, packed.title + unit), this.readout, this.plotElement);
    this.plot = new uPlot(this.options(), this.cut(), this.plotElement);
    listenOnChart(this.plot.over, link, (x) => this.plot.posToVal(x, "x"));
  }

  options() {
    const { link } = this;
    return {
      width: this.width, height: CHART_HEIGHT, legend: { show: false },
      cursor: {
        sync: { key: link.key, scales: ["x", null], filters: { pub: (type) => /^mouse(move|leave)$/.test(type) } },
        drag: { x: true, y: false, setScale: false },
        points: { size: 6 },
        bind: { dblclick: () => null },
      },
      scales: {
        x: { time: false, distr: link.axis.logarithmic ? 3 : 1, range: () => link.range },
        y: { distr: this.packed.logarithmic ? 3 : 1, range: (_, low, high) => this.pad(low, high) },
      },
      axes: [this.horizontal(), this.vertical()],
      series: [{}, ...this.curves.flatMap((curve) => [line(curve), line(curve)])],
      bands: this.curves.map((curve, k) => ({
        series: [2 * k + 2, 2 * k + 1], fill: () => theme.faded(curve.colour, 0.6),
      })),
      hooks: {
        drawClear: [(plot) => this.mark(plot)],
        setCursor: [(plot) => this.read(plot.cursor.idx)],
        setSelect: [(plot) => this.select(plot)],
      },
    };
  }

  /** Shade spans of the axis, and draw a line at places of it. */
  mark(plot) {
    const { ctx, bbox: { left, top, width, height } } = plot;
    const at = (value) => Math.min(Math.max(plot.valToPos(value, "x", true), left), left + width);
    for (const { spans, colour, opacity } of this.link.shaded) {
      ctx.fillStyle = theme.faded(colour, opacity);
      for (const [first, last] of spans) ctx.fillRect(at(first), top, at(last) - at(first), height);
    }
    for (const [label, value] of this.link.marked) drawLevel(plot, "x", value, "reference", label, 0);
  }

  horizontal() {
    const { label, unit, logarithmic } = this.link.axis;
    return {
      ...axisColours(), ...(logarithmic && LOGARITHMIC), label: `${label} (${prettyUnit(unit)})`, labelSize: 22, labelGap: 0, size: 30,
      values: (_, ticks) => ticks.map(logarithmic ? formatTick : (tick) => formatNumber(tick, 9)),
    };
  }

  vertical() {
    const { unit, logarithmic } = this.packed;
    const largest = (ticks) => Math.max(...ticks.map(Math.abs));
    return {
      ...axisColours(), ...(logarithmic && LOGARITHMIC),
      // Charts below one another line up unless a label needs more.
      size: (_, texts) => Math.max(this.link.columns > 1 ? 60 : 84, 18 + 7 * longest(texts || [])),
      values: (_, ticks) => {
        if (logarithmic) return ticks.map(formatTick);
        const scaled = engineering(unit, largest(ticks));
        return ticks.map((tick) => `${formatNumber(tick * scaled.factor, 6)} ${scaled.unit}`.trimEnd());
      },
    };
  }

  get width() {
    const printed = this.printWidth && (this.printWidth - 16 * (this.link.columns - 1)) / this.link.columns;
    return Math.max(printed || this.plotElement.clientWidth, 160);
  }

  /** Range of the vertical axis about what is shown. */
  pad(low, high) {
    if (low == null || high == null) return this.packed.logarithmic ? [0.1, 1] : [-1, 1];
    if (this.packed.logarithmic) return [10 ** Math.floor(Math.log10(low)), 10 ** Math.ceil(Math.log10(high) + 1e-9)];
    const margin = 0.05 * (high - low) || Math.abs(high) || 1;
    return [low - margin, high + margin];
  }

  /** What uPlot draws of the linked range: axis values, then low and high of each curve, those of a pixel as one. */
  cut() {
    const { axis, min, max } = this.link;
    const first = axis.find(min);
    const last = Math.min(axis.find(max) + 1, axis.count - 1);
    this.spans = { starts: this.splitByPixel(first, last), end: last + 1 };
    const { starts } = this.spans;
    const visible = (value) => (Number.isFinite(value) && !(this.packed.logarithmic && value <= 0) ? value : null);
    const columns = this.curves.flatMap((curve) => {
      const found = starts.map((start, k) => extremes(curve, start, this.endOf(k)));
      return [found.map(([least]) => visible(curve.low[least])), found.map(([, most]) => visible(curve.high[most]))];
    });
    return [starts.map((start) => axis.at(start)), ...columns];
  }

  /** The first place of what falls on each pixel. */
  splitByPixel(first, last) {
    const { link } = this;
    const [low, high] = link.range.map((value) => link.straight(value));
    const scale = this.width / (high - low);
    const starts = [];
    for (let place = first, before = null; place <= last; place++) {
      const pixel = Math.floor(scale * (link.straight(link.axis.at(place)) - low));
      if (pixel !== before) starts.push(place);
      before = pixel;
    }
    return starts;
  }

  /** First place after a span. */
  endOf(index) { return this.spans.starts[index + 1] ?? this.spans.end; }

  update() { this.plot.setData(this.cut()); }

  /** Fit to the element, or to a width in px. */
  resize(printWidth) {
    this.printWidth = printWidth;
    this.plot.setSize({ width: this.width, height: printWidth ? PRINT_HEIGHT : CHART_HEIGHT });
    this.update();
  }

  select(plot) {
    const { left, width } = plot.select;
    if (width < 3) return;
    const [min, max] = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.link.set(min, max);
  }

  /** Show a curve or hide it. */
  show(label, shown) {
    this.curves.forEach((curve, k) => {
      if (curve.label !== label) return;
      this.plot.setSeries(2 * k + 1, { show: shown });
      this.plot.setSeries(2 * k + 2, { show: shown });
    });
  }

  /** Say the values under the cursor: a value where the pixel holds one, its extremes where it holds more. */
  read(index) {
    this.readout.replaceChildren();
    if (index == null) return;
    const { axis } = this.link;
    const from = this.spans.starts[index];
    const to = this.endOf(index);
    this.readout.append(make("span", {}, `${formatNumber(axis.at(from), 6)} ${prettyUnit(axis.unit)}`));
    this.curves.forEach((curve, k) => {
      if (!this.plot.series[2 * k + 1].show) return;
      const text = `${curve.label} ${this.describe(curve, from, to)}`;
      this.readout.append(" ", make("span", {}, swatch(curve.colour), text));
    });
  }

  describe(curve, from, to) {
    const { low, high } = curve;
    const [least, most] = extremes(curve, from, to);
    const text = (value) => formatQuantity(value, this.packed.unit);
    if (text(low[least]) === text(high[most])) return text(low[least]);
    // Of a spectrum one wants to know where in the span the line is.
    if (this.packed.logarithmic && this.link.axis.logarithmic) {
      return `up to ${text(high[most])} at ${formatNumber(this.link.axis.at(most), 5)} ${this.link.axis.unit}`;
    }
    return `${text(low[least])} \u2026 ${text(high[most])}`;
  }
}

/** Places of the least and the largest value in [from, to); a gap (NaN) gives way to any value. */
function extremes({ low, high }, from, to) {
  let [least, most] = [from, from];
  for (let i = from + 1; i < to; i++) {
    if (low[i] < low[least] || low[least] !== low[least]) least = i;
    if (high[i] > high[most] || high[most] !== high[most]) most = i;
  }
  return [least, most];
}

function longest(texts) {
  return Math.max(0, ...texts.map((text) => text.length));
}

/** How a curve is drawn. */
function line({ colour, drawn }) {
  const stroke = () => theme.colour(colour);
  if (drawn === "dots") return { stroke, paths: () => null, points: { show: true, size: 4, fill: stroke } };
  const paths = drawn === "steps" ? uPlot.paths.stepped({ align: 1 }) : undefined;
  return { stroke, width: 1, dash: { dashed: [6, 4], dotted: [1, 3] }[drawn], paths, points: { show: false } };
}

function axisColours() {
  const grid = { stroke: () => theme.colour("grid"), width: 1 };
  return { stroke: () => theme.colour("text"), grid, ticks: grid, font: "12px system-ui", labelFont: "12px system-ui" };
}

/** Ticks of a logarithmic axis: uPlot's own end at 1e-24, and densities go further down. */
const LOGARITHMIC = {
  splits: (_plot, _axis, min, max) => placeTicks(min, max),
  filter: (_plot, ticks) => ticks,
};

/** Powers of ten over many decades, 1, 2, 5 times them over one or two, equal steps over less. */
function placeTicks(min, max) {
  const decades = Math.log10(max / min);
  if (decades < 0.8) {
    const step = roundStep((max - min) / 6);
    const first = Math.ceil(min / step);
    return Array.from({ length: Math.floor(max / step) - first + 1 }, (_, k) => (first + k) * step);
  }
  const every = Math.ceil(decades / 7);
  const ticks = [];
  for (let power = Math.floor(Math.log10(min)); power <= Math.ceil(Math.log10(max)); power++) {
    if (power % every !== 0) continue;
    for (const step of decades < 2.2 ? [1, 2, 5] : [1]) ticks.push(step * 10 ** power);
  }
  return ticks.filter((tick) => tick >= min * (1 - 1e-9) && tick <= max * (1 + 1e-9));
}

/** A tick of a logarithmic axis as text. */
function formatTick(tick) {
  const exponent = Math.round(Math.log10(tick));
  const isPower = Math.abs(tick / 10 ** exponent - 1) < 1e-6;
  return isPower && Math.abs(exponent) > 2 ? formatPower(exponent) : formatNumber(tick, 4);
}
