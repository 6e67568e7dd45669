// A waterfall: amplitudes as colours over frequency and speed, with the lines of harmonics and modes.

const WATERFALL_HEIGHT = 420;
const EDGE = { left: 58, right: 12, top: 30, bottom: 44 };
/** Anchors of the colours from the smallest to the largest level: dark to light on either page. */
const HEAT = [[0, 0, 4], [40, 17, 89], [114, 31, 129], [182, 54, 121], [241, 96, 93], [254, 175, 119], [252, 253, 191]];
const MODE_COLOUR = "#7fdbff";
const CLOSE_LABELS = 16; // px

/** Red, green and blue of a level from 0 to 255. */
function heat(level) {
  const place = (level / 255) * (HEAT.length - 1);
  const below = Math.min(Math.floor(place), HEAT.length - 2);
  return [0, 1, 2].map((k) => HEAT[below][k] + (place - below) * (HEAT[below + 1][k] - HEAT[below][k]));
}

/** The levels (rows x bins, lowest row first) as an image whose lowest row is at the bottom. */
function paintLevels(levels, bins, rows) {
  const canvas = make("canvas");
  Object.assign(canvas, { width: bins, height: rows });
  const context = canvas.getContext("2d");
  const image = context.createImageData(bins, rows);
  const palette = Array.from({ length: 256 }, (_, level) => heat(level));
  for (let row = 0; row < rows; row++) {
    for (let bin = 0; bin < bins; bin++) {
      const to = 4 * ((rows - 1 - row) * bins + bin);
      image.data.set(palette[levels[row * bins + bin]], to);
      image.data[to + 3] = 255;
    }
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

class WaterfallView {
  /** `shared` is what all panels of the waterfall have in common, `readout` takes what is under the pointer. */
  constructor(panel, shared, link, stage, readout) {
    Object.assign(this, { panel, shared, link, stage, readout, printWidth: null });
    this.levels = decodeBytes(panel.levels);
    this.image = paintLevels(this.levels, link.axis.count, shared.ordinate.count);
    this.canvas = make("canvas", { role: "img", tabindex: "0", "aria-label": `Waterfall, ${panel.case}` });
    stage.append(make("div", {}, make("h3", {}, panel.case), this.canvas));
    this.canvas.addEventListener("pointermove", (event) => this.read(event));
    this.canvas.addEventListener("pointerleave", () => { readout.textContent = ""; });
    listenOnChart(this.canvas, link, (x) => this.valueAt(x));
    listenToKeys(this.canvas, link);
    this.listenToDrag();
    this.resize(null);
  }

  resize(printWidth) {
    const columns = printWidth || this.stage.clientWidth > 640 ? Math.min(this.shared.panels, 2) : 1;
    this.width = Math.max(((printWidth || this.stage.clientWidth) - 16 * (columns - 1)) / columns - 2, 220);
    this.draw();
  }

  update() { this.draw(); }

  get inner() { return { width: this.width - EDGE.left - EDGE.right, height: WATERFALL_HEIGHT - EDGE.top - EDGE.bottom }; }
  x(frequency) { return EDGE.left + ((frequency - this.link.min) / (this.link.max - this.link.min)) * this.inner.width; }
  y(value) {
    const { first, last } = this.shared.ordinate;
    return EDGE.top + (1 - (value - first) / (last - first || 1)) * this.inner.height;
  }
  valueAt(x) { return this.link.min + ((x - EDGE.left) / this.inner.width) * (this.link.max - this.link.min); }

  draw() {
    const context = fitCanvas(this.canvas, this.width, WATERFALL_HEIGHT);
    context.save();
    context.beginPath();
    context.rect(EDGE.left, EDGE.top, this.inner.width, this.inner.height);
    context.clip();
    this.drawImage(context);
    this.drawLines(context);
    context.restore();
    this.drawModes(context);
    this.drawMark(context);
    this.drawAxes(context);
  }

  drawImage(context) {
    const { axis, min, max } = this.link;
    const bin = (frequency) => (frequency - axis.first) / (axis.step || 1) + 0.5;
    context.imageSmoothingEnabled = false;
    context.drawImage(
      this.image, bin(min), 0, bin(max) - bin(min), this.image.height,
      EDGE.left, EDGE.top, this.inner.width, this.inner.height,
    );
  }

  drawLines(context) {
    context.setLineDash([1, 4]);
    context.strokeStyle = "#ffffffb0";
    context.fillStyle = "#ffffff";
    context.font = "11px system-ui";
    context.textAlign = "right";
    const placed = [];
    for (const { order, frequency } of this.shared.lines) {
      context.beginPath();
      let end = null;
      frequency.forEach((value, row) => {
        const at = [this.x(value), this.y(this.shared.ordinate.at(row))];
        context.lineTo(...at);
        if (at[0] > EDGE.left && at[0] < this.width - EDGE.right - 2 && (!end || at[0] > end[0])) end = at;
      });
      context.stroke();
      if (!end || placed.some(([x, y]) => Math.abs(x - end[0]) < 2 * CLOSE_LABELS && Math.abs(y - end[1]) < CLOSE_LABELS)) continue;
      placed.push(end);
      context.fillText(formatNumber(order), end[0] - 4, Math.max(end[1], EDGE.top + 6) + 8);
    }
    context.setLineDash([]);
  }

  drawModes(context) {
    context.font = "11px system-ui";
    context.textAlign = "left";
    const inside = this.shared.modes.filter(({ frequency }) => frequency >= this.link.min && frequency <= this.link.max);
    context.fillStyle = MODE_COLOUR;
    for (const { frequency } of inside) context.fillRect(this.x(frequency) - 0.5, EDGE.top, 1, this.inner.height);
    context.fillStyle = theme.colour("text");
    let free = 2;
    for (const group of this.groupModes(inside)) {
      const name = nameGroup(group);
      const width = context.measureText(name).width;
      const begin = Math.min(Math.max(this.x(group[0].frequency), free), this.width - width - 2);
      // Where there is no room the name is in the readout alone.
      if (begin < free || begin > this.x(group[0].frequency) + 3 * CLOSE_LABELS) continue;
      context.fillText(name, begin, EDGE.top - 8);
      free = begin + width + 8;
    }
  }

  /** Neighbours share a name. */
  groupModes(modes) {
    const groups = [];
    for (const mode of modes) {
      const last = groups.at(-1);
      if (last && this.x(mode.frequency) - this.x(last[0].frequency) < CLOSE_LABELS) last.push(mode);
      else groups.push([mode]);
    }
    return groups;
  }

  drawMark(context) {
    const { mark } = this.panel;
    if (!mark || mark.frequency < this.link.min || mark.frequency > this.link.max) return;
    context.strokeStyle = "#ffffff";
    context.lineWidth = 2;
    context.beginPath();
    context.arc(this.x(mark.frequency), this.y(mark.ordinate), 7, 0, 2 * Math.PI);
    context.stroke();
  }

  drawAxes(context) {
    const { ordinate } = this.shared;
    const bottom = EDGE.top + this.inner.height;
    context.fillStyle = theme.colour("text");
    context.font = "12px system-ui";
    context.textAlign = "center";
    for (const tick of listTicks(this.link.min, this.link.max, this.inner.width / 70)) {
      context.fillRect(this.x(tick), bottom, 1, 4);
      context.fillText(formatNumber(tick, 6), this.x(tick), bottom + 18);
    }
    context.fillText(`frequency (${this.link.axis.unit})`, EDGE.left + this.inner.width / 2, bottom + 36);
    context.textAlign = "right";
    for (const tick of listTicks(ordinate.first, ordinate.last, this.inner.height / 50)) {
      context.fillRect(EDGE.left - 4, this.y(tick), 4, 1);
      context.fillText(formatNumber(tick, 6), EDGE.left - 7, this.y(tick) + 4);
    }
    context.save();
    context.translate(12, EDGE.top + this.inner.height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(`${ordinate.label} (${ordinate.unit})`, 0, 0);
    context.restore();
  }

  /** A mouse or a pen selects a span of frequencies. */
  listenToDrag() {
    let from = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      from = event.pointerType === "touch" || event.button !== 0 ? null : event.offsetX;
    });
    this.canvas.addEventListener("pointerup", (event) => {
      const to = event.offsetX;
      if (from !== null && Math.abs(to - from) > 5) {
        this.link.set(this.valueAt(Math.min(from, to)), this.valueAt(Math.max(from, to)));
      }
      from = null;
    });
  }

  read(event) {
    const { shared, link } = this;
    const { ordinate } = shared;
    const frequency = this.valueAt(event.offsetX);
    const share = 1 - (event.offsetY - EDGE.top) / this.inner.height;
    if (frequency < link.min || frequency > link.max || share < 0 || share > 1) {
      this.readout.textContent = "";
      return;
    }
    const value = ordinate.first + share * (ordinate.last - ordinate.first);
    const row = Math.min(Math.round(share * (ordinate.count - 1)), ordinate.count - 1);
    const bin = Math.min(Math.max(Math.round((frequency - link.axis.first) / (link.axis.step || 1)), 0), link.axis.count - 1);
    const decibels = (this.levels[row * link.axis.count + bin] / 255 - 1) * shared.rangeDb;
    const amplitude = formatQuantity(shared.largest * 10 ** (decibels / 20), shared.unit, 3);
    const least = decibels <= -shared.rangeDb ? "below " : "";
    const near = (list, of) => list.reduce((best, each) => (Math.abs(of(each) - frequency) < Math.abs(of(best) - frequency) ? each : best));
    const reach = 8 * ((link.max - link.min) / this.inner.width);
    const names = [];
    const line = shared.lines.length && near(shared.lines, (each) => each.frequency[row]);
    if (line && Math.abs(line.frequency[row] - frequency) < reach) names.push(`${formatNumber(line.order)} \u00d7 ${line.wheel}`);
    const mode = shared.modes.length && near(shared.modes, (each) => each.frequency);
    if (mode && Math.abs(mode.frequency - frequency) < reach) names.push(`${mode.name} (${formatNumber(mode.frequency)} Hz)`);
    this.readout.textContent = [
      `${formatNumber(frequency, 4)} Hz, ${formatNumber(value, 4)} ${ordinate.unit}: ${this.panel.case} ${least}${amplitude}`, ...names,
    ].join("; ");
  }
}

/** The name of a single mode, or the kinds of several: "bus modes, fine legs". */
function nameGroup(modes) {
  if (modes.length === 1) return modes[0].name;
  const kinds = new Set(modes.map(({ name }) => name.replace(/ [^ ]*$/, "")));
  return [...kinds].map((kind) => (kind.endsWith("mode") ? `${kind}s` : kind)).join(", ");
}

/** Round values from first to last, about so many. */
function listTicks(first, last, count) {
  const step = roundStep((last - first) / Math.max(count, 2) || 1);
  const ticks = [];
  for (let k = Math.ceil(first / step - 1e-9); k * step <= last + 1e-9 * step; k++) ticks.push(k * step);
  return ticks;
}

/** The panels of a waterfall over one range of frequencies, with its bar. */
function makeWaterfall(packed, section) {
  const readout = make("span", { class: "span" });
  const link = new LinkedAxis(new Axis(packed.frequency), () => {});
  const shared = {
    ...packed, panels: packed.panels.length, ordinate: new Axis(packed.ordinate),
    lines: packed.lines.map((line) => ({ ...line, frequency: decode(line.frequency) })),
  };
  section.querySelector(".bar").append(...makeZoomButtons("the picture", link, true));
  section.querySelector(".stage").before(make("div", { class: "readout" }, readout), makeKey(shared));
  const stage = section.querySelector(".stage");
  link.views = packed.panels.map((panel) => new WaterfallView(panel, shared, link, stage, readout));
  link.set(link.axis.first, packed.shown);
  return link.views;
}

/** What the colours mean. */
function makeKey({ largest, unit, rangeDb }) {
  const colours = HEAT.map((colour) => `rgb(${colour.join(" ")})`).join(", ");
  const strip = make("span", { class: "heat" });
  strip.style.background = `linear-gradient(to right, ${colours})`;
  const lowest = largest * 10 ** (-rangeDb / 20);
  return make("div", { class: "key span" }, formatQuantity(lowest, unit, 3), strip, `${formatQuantity(largest, unit, 3)} (${rangeDb} dB)`);
}
