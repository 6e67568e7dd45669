// Points of a plane with their hulls, x and y to the same scale.

const CLOUD_MARGIN = 46;

/** A canvas fitted to its place and the screen's pixels; returns its context, scaled to CSS pixels. */
function fitCanvas(canvas, width, height) {
  const ratio = devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return context;
}

class CloudView {
  /** `clouds` are decoded; `readout` takes the place under the pointer. */
  constructor(clouds, unit, stage, readout) {
    Object.assign(this, { clouds, unit, readout, stage, printWidth: null });
    this.canvas = make("canvas", { role: "img", "aria-label": `Points: ${clouds.map((each) => each.label).join(", ")}` });
    stage.append(this.canvas);
    const hulls = clouds.flatMap((cloud) => [...cloud.hull].map(Math.abs));
    this.reach = 1.08 * hulls.reduce((most, value) => Math.max(most, value), 0) || 1;
    this.canvas.addEventListener("pointermove", (event) => this.read(event));
    this.canvas.addEventListener("pointerleave", () => { readout.textContent = ""; });
    this.resize(null);
  }

  resize(printWidth) {
    const columns = this.stage.clientWidth > 640 ? 2 : 1;
    const width = (printWidth || this.stage.clientWidth) / (printWidth ? 2 : columns) - 8;
    this.size = Math.max(Math.min(width, 460), 200);
    this.draw();
  }

  get inner() { return this.size - 2 * CLOUD_MARGIN; }
  place(value) { return this.size / 2 + (value / this.reach) * (this.inner / 2); }

  draw() {
    const context = fitCanvas(this.canvas, this.size, this.size);
    this.drawAxes(context);
    context.save();
    context.beginPath();
    context.rect(CLOUD_MARGIN, CLOUD_MARGIN, this.inner, this.inner);
    context.clip();
    for (const cloud of this.clouds) this.drawCloud(context, cloud);
    context.restore();
  }

  drawCloud(context, { points, hull, colour }) {
    context.fillStyle = theme.faded(colour, 0.45);
    for (let i = 0; i < points.length; i += 2) {
      context.fillRect(this.place(points[i]) - 1, this.place(-points[i + 1]) - 1, 2, 2);
    }
    context.strokeStyle = theme.colour(colour);
    context.lineWidth = 1.5;
    context.beginPath();
    for (let i = 0; i < hull.length; i += 2) context.lineTo(this.place(hull[i]), this.place(-hull[i + 1]));
    context.closePath();
    context.stroke();
  }

  drawAxes(context) {
    const scaled = engineering(this.unit, this.reach);
    const step = roundStep((2 * this.reach * scaled.factor) / 5);
    const end = this.size - CLOUD_MARGIN;
    context.font = "12px system-ui";
    context.textAlign = "center";
    for (let k = -10; k <= 10; k++) {
      const at = this.place((k * step) / scaled.factor);
      if (at < CLOUD_MARGIN || at > end) continue;
      context.fillStyle = theme.colour("grid");
      context.fillRect(at, CLOUD_MARGIN, 1, this.inner);
      context.fillRect(CLOUD_MARGIN, at, this.inner, 1);
      context.fillStyle = theme.colour("text");
      context.fillText(formatNumber(k * step, 3), at, end + 16);
      context.fillText(formatNumber(-k * step, 3), CLOUD_MARGIN - 20, at + 4);
    }
    context.fillText(`x (${scaled.unit})`, this.size / 2, this.size - 8);
    context.fillText(`y (${scaled.unit})`, CLOUD_MARGIN, CLOUD_MARGIN - 10);
  }

  read(event) {
    const box = this.canvas.getBoundingClientRect();
    const back = (pixels) => ((pixels - this.size / 2) / (this.inner / 2)) * this.reach;
    const [x, y] = [back(event.clientX - box.left), -back(event.clientY - box.top)];
    const texts = [["x", x], ["y", y], ["distance", Math.hypot(x, y)]];
    this.readout.textContent = texts.map(([name, value]) => `${name} ${formatQuantity(value, this.unit, 3)}`).join("   ");
  }
}

/** The next larger of 1, 2, 5 times a power of ten. */
function roundStep(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((step) => step * power >= value * (1 - 1e-9));
}

/** All clouds of a group in one view, and the last alone, enlarged. */
function makeClouds(packed, section) {
  const clouds = packed.clouds.map((cloud) => ({ ...cloud, points: decode(cloud.points), hull: decode(cloud.hull) }));
  const readout = make("span", { class: "span" });
  const legend = clouds.map((cloud) => make("span", { class: "span" }, swatch(cloud.colour), cloud.label));
  section.querySelector(".bar").append(...legend, readout);
  const stage = section.querySelector(".stage");
  const views = [new CloudView(clouds, packed.unit, stage, readout)];
  if (clouds.length > 1) views.push(new CloudView(clouds.slice(-1), packed.unit, stage, readout));
  return views;
}
